//! Mosaics: merged site by site, with dark frames.

mod common;

use std::collections::BTreeMap;

use calibration::{
    Bayer, CalibrationError, HdrImage, MasterDark, NoiseModel, Photo, list_pictures, merge_mosaic,
    quads,
};

fn mosaic(radiance: Vec<f32>, width: usize) -> HdrImage {
    HdrImage {
        width,
        height: radiance.len() / width,
        channels: 1,
        variance: vec![1.0; radiance.len()],
        radiance,
        variance_known: true,
        clipped_shortest: 0,
        lost_longest: 0,
    }
}

#[test]
fn quads_put_each_site_where_its_colour_belongs() {
    // Red 1, green 2 and 4, blue 8.
    for (pattern, sites) in [
        ("rggb", [1.0, 2.0, 4.0, 8.0]),
        ("bggr", [8.0, 2.0, 4.0, 1.0]),
        ("grbg", [2.0, 1.0, 8.0, 4.0]),
        ("GBRG", [2.0, 8.0, 1.0, 4.0]),
    ] {
        let mut image = mosaic(sites.to_vec(), 2);
        let bayer = Bayer::parse(pattern).unwrap();
        let colour = quads(bayer, &image).unwrap();
        assert_eq!(colour.radiance, [1.0, 3.0, 8.0], "{pattern}");
        assert_eq!(colour.variance, [1.0, 0.5, 1.0], "{pattern}");
        // A clipped green leaves the other one.
        let clipped = image.radiance.iter().position(|v| *v == 4.0).unwrap();
        image.variance[clipped] = f32::INFINITY;
        assert_eq!(quads(bayer, &image).unwrap().radiance, [1.0, 2.0, 8.0], "{pattern}");
    }
    let error = Bayer::parse("rgb").unwrap_err().into();
    assert!(matches!(error, CalibrationError::BadInput { .. }));
    let thin = quads(Bayer::Rggb, &mosaic(vec![1.0; 4], 1));
    assert!(matches!(thin, Err(CalibrationError::BadInput { .. })), "{thin:?}");
}

fn flat(name: &str, code: u16) -> Photo {
    Photo {
        width: 4,
        height: 4,
        channels: 1,
        data: vec![code; 16],
        max_value: 255,
        name: name.into(),
    }
}

fn bracket() -> [std::result::Result<(Photo, f64), CalibrationError>; 2] {
    [Ok((flat("short", 30), 1.0)), Ok((flat("long", 50), 2.0))]
}

fn dark(seconds: f64, code: u16) -> MasterDark {
    MasterDark::average(seconds, [Ok::<_, CalibrationError>(flat("dark", code))]).unwrap()
}

#[test]
fn dark_frames_are_subtracted_and_checked() {
    let noise = NoiseModel::for_max_value(255);
    let merged = |darks| merge_mosaic(bracket(), darks, &noise, Bayer::Gbrg);
    // 20 codes a second over a dark level of 10.
    let (image, _) = merged(vec![dark(1.0, 10), dark(2.0, 10)]).unwrap();
    assert!(image.radiance.iter().all(|l| (l * 255.0 - 20.0).abs() < 1e-4), "{:?}", image.radiance);
    // What dark frames add in noise is in the variance.
    let (without, _) = merged(Vec::new()).unwrap();
    assert!(image.variance[0] > 1.2 * without.variance[0]);
    // Between two masters the level is interpolated: 10 at 1 s, 14 at 3 s is 12 at 2 s.
    let frames = [Ok((flat("short", 30), 1.0)), Ok::<_, CalibrationError>((flat("long", 52), 2.0))];
    let darks = vec![dark(1.0, 10), dark(3.0, 14)];
    let (image, _) = merge_mosaic(frames, darks, &noise, Bayer::Gbrg).unwrap();
    assert!((image.radiance[0] * 255.0 - 20.0).abs() < 1e-4);

    let named = |result: Result<_, CalibrationError>, picture: &str, words: &str| {
        let Err(error) = result else { panic!("not refused") };
        let told = error.to_string();
        assert!(told.contains(picture) && told.contains(words), "{told}");
    };
    named(merged(vec![dark(1.0, 10)]), "long", "2 s");
    named(merged(vec![dark(1.0, 60), dark(2.0, 10)]), "short", "no brighter");
    let other = Photo { width: 2, height: 8, ..flat("narrow", 10) };
    let other = MasterDark::average(1.0, [Ok::<_, CalibrationError>(other)]).unwrap();
    named(merged(vec![other]), "short", "narrow");
}

/// Seconds and wavelength from names such as `d2_colorChecker30cm_550nm_100ms_….tif`.
fn told_by_name(name: &str) -> Option<(String, f64)> {
    let band = name.split('_').find(|part| part.ends_with("nm")).unwrap_or("dark");
    let time = name.split('_').find_map(|part| part.strip_suffix("ms"))?;
    Some((band.to_owned(), time.parse::<f64>().ok()? / 1000.0))
}

/// Llanos' raw pictures of a chart, 25 to 3916 ms, under seven filters, with dark frames.
#[test]
fn real_mosaics_merge_with_their_dark_frames() {
    let Some(dir) = common::data("rawhdr/bllanos") else { return };
    let mut darks: BTreeMap<u64, Vec<Photo>> = BTreeMap::new();
    for path in list_pictures(dir.join("dark")).unwrap() {
        let photo = Photo::load(&path).unwrap();
        let (_, seconds) = told_by_name(&photo.name).unwrap();
        darks.entry((1000.0 * seconds).round() as u64).or_default().push(photo);
    }
    let masters: Vec<MasterDark> = darks
        .into_iter()
        .map(|(ms, frames)| {
            let frames = frames.into_iter().map(Ok::<_, CalibrationError>);
            MasterDark::average(ms as f64 / 1000.0, frames).unwrap()
        })
        .collect();
    assert_eq!(masters.len(), 7);
    assert!(masters.iter().all(|m| m.frames == 2));
    let mut bands: BTreeMap<String, Vec<(Photo, f64)>> = BTreeMap::new();
    for path in list_pictures(dir.join("colorchecker")).unwrap() {
        let photo = Photo::load(&path).unwrap();
        let (band, seconds) = told_by_name(&photo.name).unwrap();
        bands.entry(band).or_default().push((photo, seconds));
    }
    assert_eq!(bands.len(), 7);
    let noise = NoiseModel::for_max_value(255);
    for (band, frames) in bands {
        let frames = frames.into_iter().map(Ok::<_, CalibrationError>);
        let (image, report) = merge_mosaic(frames, masters.clone(), &noise, Bayer::Gbrg).unwrap();
        assert_eq!([image.width, image.height, image.channels], [204, 171, 3]);
        for (_, check) in &report.exposures {
            // Published with the pictures: linear to 0.031 stop a step after dark subtraction,
            // 0.078 at worst, which is 5.6 %.
            if let Some(step) = check.step {
                assert!((step.log2()).abs() < 0.09, "{band}: {report:?}");
            }
        }
        let steps: Vec<String> = report
            .exposures
            .iter()
            .map(|(_, c)| c.step.map_or("-".into(), |s| format!("{s:.3}±{:.3}", c.step_sigma)))
            .collect();
        eprintln!(
            "{band}: measured {:.3}, steps {}, noise ratio {:?}, moved {}",
            image.measured_share(),
            steps.join(" "),
            report.noise_ratio,
            report.moved_samples
        );
    }
}
