//! Pictures of another rig become a material: synthesised on a grid twice finer than the one that
//! is solved, in units, files and kinds of pattern as a manifest allows them.

mod common;

use calibration::{HdrImage, write_exr};
use common::diaphane;
use diffusion::{Batch, CpuSolver, Forward, Illuminations, Medium};
use image::{ImageBuffer, Rgb};
use material::{Face, Grid, Optics, Overwrite};
use std::path::Path;

/// Solved: 12 × 12 × 4 cells of 0.5 mm; synthesised: twice as many along each axis.
const SIZE_MM: [f64; 3] = [6.0, 6.0, 2.0];
const FINE: [usize; 3] = [24, 24, 8];
const ETA: f64 = 1.4;
/// Value of white under irradiance 1 in the pictures, and of what is seen without light.
const WHITE: f64 = 2.0;
const BLACK: f64 = 0.01;
/// Relative noise of a pixel; a cell is the mean of four.
const NOISE: f64 = 0.002;

/// Seeded noise of variance 1: the sum of twelve uniform numbers, less their mean (xorshift64*).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 ^= self.0 >> 12;
            self.0 ^= self.0 << 25;
            self.0 ^= self.0 >> 27;
            (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// Light on the fine grid's face, x and y running from 0 to 1.
fn light(lit: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let [nx, ny, _] = FINE;
    let place = |i: usize, n: usize| (i as f64 + 0.5) / n as f64;
    (0..nx * ny).map(|i| lit(place(i % nx, nx), place(i / nx, ny))).collect()
}

/// Radiance of the front face: `[pattern][channel][pixel]`.
fn pictures(lights: &[Vec<f64>]) -> Vec<Vec<Vec<f64>>> {
    let mut spacing = [0.0; 3];
    (0..3).for_each(|a| spacing[a] = SIZE_MM[a] / FINE[a] as f64);
    let grid = Grid::new(FINE, spacing).unwrap();
    let light = Illuminations::new(&grid, Face::Back, lights.to_vec()).unwrap();
    let mut out = vec![Vec::new(); lights.len()];
    for (kappa, mu) in [(0.30, 0.010), (0.26, 0.014), (0.22, 0.025)] {
        let (mut k, mut m) = (vec![0.0; grid.len()], vec![0.0; grid.len()]);
        for z in 0..FINE[2] {
            for y in 0..FINE[1] {
                for x in 0..FINE[0] {
                    let [px, py, pz] = grid.centre_mm(x, y, z);
                    let wave = (1.1 * px + 0.4 * pz).sin() * (0.9 * py).cos();
                    k[grid.index(x, y, z)] = kappa * (1.0 + 0.2 * wave);
                    m[grid.index(x, y, z)] = mu * (1.0 - 0.3 * wave);
                }
            }
        }
        let medium = Medium::new(grid, k, m).unwrap();
        let mut solver = CpuSolver::<f64>::new();
        let mut forward = Forward::new(medium, &Optics::from_eta(ETA), &mut solver).unwrap();
        let mut fluence = Batch::zeros(grid.len(), light.count());
        forward.solve(&light, &mut fluence, 1e-9).unwrap();
        let images = forward.exit_radiance(&light, &fluence, Face::Front);
        out.iter_mut().zip(images).for_each(|(pattern, image)| pattern.push(image));
    }
    out
}

fn exr(path: &Path, values: &[Vec<f64>], noise: &mut Noise) {
    let [width, height, _] = FINE;
    let (mut radiance, mut variance) = (Vec::new(), Vec::new());
    for i in 0..width * height {
        for channel in values {
            let clean = std::f64::consts::PI * WHITE * channel[i];
            radiance.push((clean * (1.0 + NOISE * noise.next()) + BLACK) as f32);
            variance.push((NOISE * clean).powi(2) as f32);
        }
    }
    let image = HdrImage {
        width,
        height,
        channels: values.len(),
        radiance,
        variance,
        variance_known: true,
        clipped_shortest: 0,
        lost_longest: 0,
    };
    write_exr(path, &image, Overwrite::Refuse).unwrap();
}

/// What a linear 16-bit sensor codes in `seconds`.
fn frame(path: &Path, values: &[Vec<f64>], seconds: f64) {
    let [width, height, _] = FINE;
    let frame: ImageBuffer<Rgb<u16>, Vec<u16>> =
        ImageBuffer::from_fn(width as u32, height as u32, |x, y| {
            let i = y as usize * width + x as usize;
            Rgb([0, 1, 2].map(|c| {
                let value = std::f64::consts::PI * WHITE * values[c][i] + BLACK;
                (65535.0 * (seconds * value).min(1.0)).round() as u16
            }))
        });
    frame.save(path).unwrap();
}

/// Sixteen regions to fit; to hold out: the left half as rectangles and a bracket, and a ramp as
/// a picture of the irradiance.
fn write_everything(folder: &Path) -> String {
    let mut lights: Vec<Vec<f64>> = (0..16)
        .map(|r| {
            let (column, row) = (f64::from(r % 4), f64::from(r / 4));
            light(|x, y| {
                f64::from(u8::from((4.0 * x).floor() == column && (4.0 * y).floor() == row))
            })
        })
        .collect();
    lights.push(light(|x, _| f64::from(u8::from(x < 0.5))));
    lights.push(light(|x, y| 0.2 + 0.5 * x + 0.3 * y));
    let pictures = pictures(&lights);

    let mut noise = Noise(0x5EED);
    let dark = vec![vec![0.0; FINE[0] * FINE[1]]; 3];
    exr(&folder.join("black.exr"), &dark, &mut noise);
    let mut manifest = format!(
        "[sample]\nname = \"wavy\"\nsize_mm = {SIZE_MM:?}\ncells = [12, 12, 4]\nlit_face = \"back\"\neta = {ETA}\n\
         [pictures]\nwhite = {WHITE:?}\nblack = \"black.exr\"\nlinear = true\n"
    );
    for (r, picture) in pictures.iter().enumerate().take(16) {
        exr(&folder.join(format!("r{r}.exr")), picture, &mut noise);
        manifest += &format!(
            "[[pattern]]\nname = \"region-{r}\"\nimage = \"r{r}.exr\"\nregion = {{ columns = 4, rows = 4, index = {r} }}\n"
        );
    }
    let times = [0.125, 0.5, 2.0];
    for t in times {
        frame(&folder.join(format!("half-{t}.png")), &pictures[16], t);
    }
    let bracket =
        times.map(|t| format!("{{ file = \"half-{t}.png\", exposure_s = {t} }}")).join(", ");
    manifest += &format!(
        "[[pattern]]\nname = \"half\"\nheld_out = true\nbracket = [{bracket}]\n\
         rectangles = [{{ x0 = 0.0, y0 = 0.0, x1 = 0.5, y1 = 1.0, level = 1.0 }}]\n"
    );
    exr(&folder.join("ramp.exr"), &pictures[17], &mut noise);
    let ramp = HdrImage {
        width: FINE[0],
        height: FINE[1],
        channels: 1,
        radiance: lights[17].iter().map(|v| *v as f32).collect(),
        variance: vec![1.0; FINE[0] * FINE[1]],
        variance_known: false,
        clipped_shortest: 0,
        lost_longest: 0,
    };
    write_exr(folder.join("ramp-light.exr"), &ramp, Overwrite::Refuse).unwrap();
    manifest
        + "[[pattern]]\nname = \"ramp\"\nheld_out = true\nimage = \"ramp.exr\"\nirradiance = \"ramp-light.exr\"\n"
}

#[test]
fn pictures_become_a_material() {
    let folder = tempfile::tempdir().unwrap();
    let images = folder.path().join("images");
    std::fs::create_dir(&images).unwrap();
    let manifest = folder.path().join("m.toml");
    std::fs::write(&manifest, write_everything(&images)).unwrap();
    let session = folder.path().join("session");
    let (at, images, manifest) =
        (session.to_str().unwrap(), images.to_str().unwrap(), manifest.to_str().unwrap());
    let import = || diaphane(["import", at, "--images", images, "--manifest", manifest]);

    let run = import();
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!((&run.json["patterns"], &run.json["held_out"]), (&18.into(), &2.into()));
    let again = import();
    assert_eq!(again.code, 2);
    assert!(again.json["hint"].as_str().unwrap().contains("--force"));

    let run = diaphane(["solve", at]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let run = diaphane(["verify", at]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    // Noise alone leaves (0.002 / 2)² = 1e-6. Halving the cells moves this slab's exit radiance by
    // about a percent, which κ and μ take up in part: 2e-4 is the square of 1.4 % (6e-5 measured).
    let fit = run.json["fit"].as_f64().unwrap();
    assert!(fit > 1e-8 && fit <= 2e-4, "{}", run.json);
    // The same for light that was not fitted; a wrong unit, black, time or row order is far out.
    for pattern in run.json["patterns"].as_array().unwrap() {
        let error = pattern["rel_rms"].as_f64().unwrap();
        assert!(pattern["held_out"] == false || error <= 0.02, "{pattern}");
    }
    assert!(run.json["bssrdf_error"].is_null());

    let run = diaphane(["export", at, "--clamp"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(
        run.json["files"]
            .as_array()
            .unwrap()
            .iter()
            .all(|f| Path::new(f.as_str().unwrap()).is_file())
    );
    let run = diaphane(["report", at]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(run.json["missing"], serde_json::json!([]));
    let page = std::fs::read_to_string(run.json["report"].as_str().unwrap()).unwrap();
    assert!(page.len() < 10_000_000 && page.contains("data:image/png;base64,"));
    // Nothing is fetched: no address but pictures inside the page.
    assert!(!page.contains("http://") && !page.contains("https://") && !page.contains(" src=\"/"));
    let status = diaphane(["status", at]);
    assert!(status.json["next"].is_null(), "{}", status.json);
}

#[test]
fn what_is_wrong_with_a_manifest_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let manifest = folder.path().join("m.toml");
    let session = folder.path().join("session");
    let images = folder.path().to_str().unwrap();
    let tiny = HdrImage {
        width: 4,
        height: 4,
        channels: 1,
        radiance: vec![1.0; 16],
        variance: vec![1.0; 16],
        variance_known: false,
        clipped_shortest: 0,
        lost_longest: 0,
    };
    write_exr(folder.path().join("tiny.exr"), &tiny, Overwrite::Refuse).unwrap();
    std::fs::write(folder.path().join("cut.exr"), b"v/1\x01cut").unwrap();
    let sample = "[sample]\nname = \"a\"\nsize_mm = [8, 8, 4]\ncells = [8, 8, 4]\nlit_face = \"back\"\neta = 1.3\n";
    let region = "region = { columns = 4, rows = 4, index = 0 }\n";
    for (text, told) in [
        ("[sample".to_owned(), "m.toml"),
        (sample.replace("eta", "etta"), "etta"),
        (
            sample.replace("[8, 8, 4]\nlit", "[8, 8, 0]\nlit")
                + "[[pattern]]\nname = \"p\"\nimage = \"tiny.exr\"\n"
                + region,
            "sample.cells",
        ),
        (
            sample.replace("1.3", "0.3")
                + "[[pattern]]\nname = \"p\"\nimage = \"tiny.exr\"\n"
                + region,
            "eta",
        ),
        (format!("{sample}[[pattern]]\nname = \"p\"\nimage = \"none.exr\"\n{region}"), "none.exr"),
        (format!("{sample}[[pattern]]\nname = \"p\"\nimage = \"cut.exr\"\n{region}"), "cut.exr"),
        (
            format!("{sample}[[pattern]]\nname = \"p\"\nimage = \"tiny.exr\"\n{region}"),
            "4 × 4 pixels",
        ),
        (
            format!(
                "{sample}[[pattern]]\nname = \"p\"\nbracket = [{{ file = \"a.png\" }}]\n{region}"
            ),
            "a.png",
        ),
    ] {
        std::fs::write(&manifest, &text).unwrap();
        let run = diaphane([
            "import",
            session.to_str().unwrap(),
            "--images",
            images,
            "--manifest",
            manifest.to_str().unwrap(),
        ]);
        assert_eq!(run.code, 2, "{text}: {}", run.stderr);
        let error = run.json["error"].as_str().unwrap();
        assert!(error.contains(told), "{error:?} does not tell {told:?}");
        assert!(!session.exists(), "nothing is written before everything is read");
    }
}
