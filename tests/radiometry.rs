//! Response, noise and merge from the command line, on real and on made pictures.

mod common;
#[path = "common/data.rs"]
mod data;
#[cfg(feature = "raw")]
#[path = "../raw/tests/common/dng.rs"]
mod dng;

use common::diaphane;
use data::data;
use std::path::Path;
use tempfile::tempdir;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Deviates that are normal enough: twelve uniform ones of a small generator (Marsaglia 2003).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// A 16-bit PNG of a sensor of 0.5 DN an electron, 4 electrons of read noise, black 100 DN.
fn shot(path: &Path, electrons: f64, noise: &mut Noise) {
    let picture = image::ImageBuffer::from_fn(64, 64, |_, _| {
        let sigma = (electrons + 16.0).sqrt();
        image::Luma([(100.0 + 0.5 * (electrons + sigma * noise.next())).round().max(0.0) as u16])
    });
    picture.save(path).unwrap();
}

#[test]
fn a_response_from_real_photographs() {
    let Some(images) = data("hdr/frobisher") else { return };
    let folder = tempdir().unwrap();
    let output = folder.path().join("canon.json");
    let command = ["calibrate", "response", "--images", text(&images), "--output", text(&output)];
    let run = diaphane(command);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(run.json["strictly_increasing"], true);
    assert_eq!(run.json["identity"], false);
    let medians = run.json["median_log2_error"].as_array().unwrap();
    // See calibration/tests/radiometry.rs for what limits them; red, green, blue.
    for (median, limit) in medians.iter().zip([0.0407, 0.034, 0.046]) {
        assert!(median.as_f64().unwrap() < limit, "{medians:?}");
    }
    let drawing = std::fs::read_to_string(output.with_extension("svg")).unwrap();
    assert_eq!(drawing.matches("<path").count(), 4, "an axis and three curves");
    assert_eq!(diaphane(command).code, 2, "what is there stays");
    // The merge takes it.
    let exr = folder.path().join("out.exr");
    let merge = ["merge", "--images", text(&images), "--response", text(&output), "--half"];
    let run = diaphane(merge.into_iter().chain(["--output", text(&exr)]));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(run.json["response_identity"], false);
    assert!(calibration::read_exr(&exr).unwrap().variance_known);
}

#[test]
fn noise_is_measured_and_used() {
    let folder = tempdir().unwrap();
    let [flats, darks, bracket] = ["flats", "darks", "bracket"].map(|name| {
        let path = folder.path().join(name);
        std::fs::create_dir(&path).unwrap();
        path
    });
    let mut noise = Noise(42);
    for (k, electrons) in [100.0, 1000.0, 5000.0, 20_000.0, 60_000.0].into_iter().enumerate() {
        for side in ["a", "b"] {
            shot(&flats.join(format!("{k}{side}.png")), electrons, &mut noise);
        }
    }
    for name in ["d1.png", "d2.png"] {
        shot(&darks.join(name), 0.0, &mut noise);
    }
    let table = folder.path().join("times.txt");
    std::fs::write(&table, "d1.png 1\nd2.png 1\nlong.png 1\nshort.png 1/8\n").unwrap();
    let command = ["calibrate", "noise", "--flats", text(&flats), "--darks", text(&darks)];
    let command = command.into_iter().chain(["--exposures", text(&table)]);
    let run = diaphane(command.clone());
    assert_eq!(run.code, 0, "{}", run.stderr);
    // Within four of the sigmas that it states.
    for (key, truth) in
        [("electrons_per_dn", 2.0), ("read_noise_e", 4.0), ("black_level_dn", 100.0)]
    {
        let [value, sigma] = ["value", "sigma"].map(|k| run.json[key][k].as_f64().unwrap());
        assert!((value - truth).abs() < 4.0 * sigma && sigma < 0.1 * truth, "{key}: {}", run.json);
    }
    assert!(run.json["dark_current_dn_s"].is_null());

    shot(&bracket.join("long.png"), 40_000.0, &mut noise);
    shot(&bracket.join("short.png"), 5_000.0, &mut noise);
    let exr = folder.path().join("out.exr");
    let model = flats.join("noise.json");
    let merge = ["merge", "--images", text(&bracket), "--linear", "--noise", text(&model)];
    let merge = merge.into_iter().chain(["--exposures", text(&table), "--output", text(&exr)]);
    let run = diaphane(merge);
    assert_eq!(run.code, 0, "{}", run.stderr);
    // 4096 pixels tell the ratio of noise to model to 1 %; the median of χ² to a little more.
    let ratio = run.json["noise_ratio"].as_f64().unwrap();
    assert!((ratio - 1.0).abs() < 0.08, "{ratio}");
    let image = calibration::read_exr(&exr).unwrap();
    let mean = image.radiance.iter().map(|v| f64::from(*v)).sum::<f64>() / 4096.0;
    // 4096 pixels of 200 electrons' noise: 0.008 % (1 sigma), and the black level's.
    assert!((mean * 65535.0 / 20_000.0 - 1.0).abs() < 0.001, "{mean}");

    // One brightness alone says nothing.
    let same = folder.path().join("same");
    std::fs::create_dir(&same).unwrap();
    for name in ["1a.png", "1b.png", "2a.png", "2b.png"] {
        shot(&same.join(name), 5_000.0, &mut noise);
    }
    let one = ["calibrate", "noise", "--flats", text(&same), "--darks", text(&darks)];
    let run = diaphane(one.into_iter().chain(["--exposures", text(&table)]));
    assert!(run.code == 2 && run.stderr.contains("different brightness"), "{}", run.stderr);
    assert!(run.stderr.contains("five or more"), "{}", run.stderr);

    // A frame alone, and a saturated one, are refused by name.
    shot(&flats.join("9a.png"), 1e9, &mut noise);
    let run = diaphane(command.clone().chain(["--force"]));
    assert!(run.code == 2 && run.stderr.contains("9a.png"), "{}", run.stderr);
    shot(&flats.join("9b.png"), 1e9, &mut noise);
    let run = diaphane(command.chain(["--force"]));
    assert!(run.code == 2 && run.stderr.contains("9a.png"), "{}", run.stderr);
    assert!(run.stderr.contains("saturated"), "{}", run.stderr);
}

#[test]
fn mosaics_with_dark_frames() {
    let Some(root) = data("rawhdr/bllanos") else { return };
    let folder = tempdir().unwrap();
    let images = folder.path().join("550nm");
    std::fs::create_dir(&images).unwrap();
    let mut table = String::new();
    for (from, filter) in [("colorchecker", "550nm"), ("dark", "")] {
        for entry in std::fs::read_dir(root.join(from)).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            let ms = name.split('_').find_map(|part| part.strip_suffix("ms"));
            let Some(ms) = ms.filter(|_| name.contains(filter)) else { continue };
            table += &format!("{name} {}\n", ms.parse::<f64>().unwrap() / 1000.0);
            if from == "colorchecker" {
                std::fs::copy(&path, images.join(&name)).unwrap();
            }
        }
    }
    let times = folder.path().join("times.txt");
    std::fs::write(&times, table).unwrap();
    let (exr, darks) = (folder.path().join("out.exr"), root.join("dark"));
    let merge = ["merge", "--images", text(&images), "--exposures", text(&times)];
    let merge = merge.into_iter().chain(["--bayer", "gbrg", "--darks", text(&darks)]);
    let run = diaphane(merge.clone().chain(["--output", text(&exr)]));
    assert_eq!(run.code, 0, "{}", run.stderr);
    let image = calibration::read_exr(&exr).unwrap();
    assert_eq!([image.width, image.height, image.channels], [204, 171, 3]);
    // A green filter: more green than red or blue on the whole.
    let mean = |c: usize| image.radiance.iter().skip(c).step_by(3).sum::<f32>();
    assert!(
        mean(1) > 2.0 * mean(0) && mean(1) > 2.0 * mean(2),
        "{} {} {}",
        mean(0),
        mean(1),
        mean(2)
    );
    let run = diaphane(merge.chain(["--output", text(&exr), "--force", "--bayer", "rgb"]));
    assert_eq!(run.code, 2);
}

#[test]
fn exposure_times_that_contradict_are_told() {
    let Some(images) = data("hdr/frobisher") else { return };
    let folder = tempdir().unwrap();
    let (table, exr) = (folder.path().join("times.txt"), folder.path().join("out.exr"));
    // The second picture was taken at 1 s.
    std::fs::write(&table, "IMG_2600.jpg 1/8\nIMG_2601.jpg 2\nIMG_2602.jpg 8\n").unwrap();
    let command = ["merge", "--images", text(&images), "--exposures", text(&table)];
    let run = diaphane(command.into_iter().chain(["--output", text(&exr)]));
    let told =
        if run.json["warnings"].is_array() { run.json["warnings"].to_string() } else { run.stderr };
    assert!(told.contains("IMG_26") && told.contains("EXIF"), "{told}");
    // Times of two pictures exchanged: the one that was exposed longer would be the darker one.
    std::fs::write(&table, "IMG_2600.jpg 1\nIMG_2601.jpg 1/8\nIMG_2602.jpg 8\n").unwrap();
    let run = diaphane(command.into_iter().chain(["--output", text(&exr), "--force", "--linear"]));
    assert_eq!(run.code, 2, "{}", run.stderr);
    assert!(run.stderr.contains("IMG_2600.jpg") && run.stderr.contains("darker"), "{}", run.stderr);
}

/// Red, green and blue in codes a second above black.
#[cfg(feature = "raw")]
const RAW_LIGHT: [f64; 3] = [2_000.0, 5_000.0, 9_000.0];

/// A DNG that was exposed for `exposure` seconds to `light` parts of the light above.
#[cfg(feature = "raw")]
fn raw_shot(path: &Path, exposure: (u32, u32), light: f64, colours: [u8; 4], white: u16) {
    let seconds = f64::from(exposure.0) / f64::from(exposure.1);
    let code = |i: usize| {
        let colour = usize::from(colours[i / 16 % 2 * 2 + i % 2]);
        let code = 512.0 + light * RAW_LIGHT[colour] * seconds;
        code.round().min(f64::from(white)) as u16
    };
    let dng = dng::Dng {
        width: 16,
        height: 12,
        codes: (0..16 * 12).map(code).collect(),
        filter: (2, colours.to_vec()),
        black: [512; 4],
        white: white.into(),
        active: [0, 0, 12, 16],
        exposure,
    };
    std::fs::write(path, dng.bytes()).unwrap();
}

#[cfg(feature = "raw")]
#[test]
fn raw_files_merge_as_they_are() {
    const GBRG: [u8; 4] = [1, 2, 0, 1];
    let folder = tempdir().unwrap();
    let [photos, darks] = ["photos", "darks"].map(|name| folder.path().join(name));
    for (dir, light) in [(&photos, 1.0), (&darks, 0.0)] {
        std::fs::create_dir(dir).unwrap();
        for (name, exposure) in [("a", (1, 8)), ("b", (1, 2)), ("c", (2, 1))] {
            raw_shot(&dir.join(format!("{name}.dng")), exposure, light, GBRG, 16_383);
        }
    }
    let exr = folder.path().join("out.exr");
    let merge = ["merge", "--images", text(&photos), "--output", text(&exr), "--force"];
    let with = |more: &[&str]| diaphane(merge.iter().chain(more));
    for more in [&[][..], &["--darks", text(&darks)], &["--bayer", "gbrg"]] {
        let run = with(more);
        assert_eq!(run.code, 0, "{}", run.stderr);
        assert_eq!(run.json["response_identity"], true);
        let image = calibration::read_exr(&exr).unwrap();
        assert_eq!((image.width, image.height, image.channels), (8, 6, 3));
        for pixel in image.radiance.chunks_exact(3) {
            for (found, made) in pixel.iter().zip(RAW_LIGHT) {
                let found = f64::from(*found) * 65_535.0;
                // Half a code in the 250 that the shortest exposure has of red is 0.2 %.
                assert!((found / made - 1.0).abs() < 0.002, "{more:?}: {found} instead of {made}");
            }
        }
    }
    let refused = |more: &[&str], words: &str| {
        let run = with(more);
        assert_eq!(run.code, 2, "{}", run.stderr);
        let error = run.json["error"].as_str().unwrap_or_default().to_owned() + &run.stderr;
        assert!(error.contains(words), "{words}: {error}");
    };
    refused(&["--bayer", "rggb"], "--bayer");
    refused(&["--response", "none.json"], "linear");
    // Another ISO setting, another white.
    raw_shot(&photos.join("d.dng"), (4, 1), 1.0, GBRG, 15_000);
    refused(&[], "d.dng");
    let whole = std::fs::read(photos.join("c.dng")).unwrap();
    std::fs::write(photos.join("d.dng"), &whole[..whole.len() / 2]).unwrap();
    refused(&[], "d.dng");
    std::fs::write(photos.join("d.dng"), "notes about the raw files\n").unwrap();
    refused(&[], "d.dng");
}
