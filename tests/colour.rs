//! `calibrate colour` on a drawn chart.

mod common;

use common::diaphane;
use std::path::Path;

/// A chart with black lines between its patches on a grey table, in sRGB.
fn draw(path: &Path, spoil: impl Fn(u32, u32, [u8; 3]) -> [u8; 3]) {
    let code = |v: f64| {
        let v = if v <= 0.0031308 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
        (255.0 * v).round() as u8
    };
    let patches = simulator::chart_patches();
    image::RgbImage::from_fn(900, 660, |x, y| {
        let (u, v) = (f64::from(x) / 110.0 - 1.1, f64::from(y) / 110.0 - 1.0);
        let on = (0.0..6.0).contains(&u) && (0.0..4.0).contains(&v);
        let edge = (u - u.floor() - 0.5).abs().max((v - v.floor() - 0.5).abs());
        let colour = if on && edge < 0.45 {
            let [r, g, b] = patches[6 * v as usize + u as usize].reflectance;
            // A warm lamp.
            [0.9 * r, 0.8 * g, 0.6 * b]
        } else if (-0.08..6.08).contains(&u) && (-0.08..4.08).contains(&v) {
            [0.02; 3]
        } else {
            [0.3, 0.27, 0.2]
        };
        image::Rgb(spoil(x, y, colour.map(code)))
    })
    .save(path)
    .unwrap();
}

#[test]
fn a_chart_becomes_a_matrix_a_picture_and_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let chart = folder.path().join("chart.png");
    draw(&chart, |_, _, rgb| rgb);
    let output = folder.path().join("warm");
    let args = ["calibrate", "colour", "--image"].map(std::ffi::OsStr::new);
    let run = |more: &[&std::ffi::OsStr]| {
        let target = [chart.as_os_str(), "--output".as_ref(), output.as_os_str()];
        diaphane(args.iter().copied().chain(target).chain(more.iter().copied()))
    };
    let first = run(&[]);
    assert_eq!(first.code, 0, "{}", first.stderr);
    let number = |name: &str| first.json[name].as_f64().unwrap();
    // The drawing has another table of colours than the reference: 1.5 to 2 apart.
    assert!(number("delta_e2000_mean") < 2.5, "{}", first.json);
    assert!(number("delta_e2000_loo") < 3.0, "{}", first.json);
    assert!(number("delta_e2000_raw") > 2.0 * number("delta_e2000_mean"), "{}", first.json);
    assert_eq!(first.json["patches"].as_array().unwrap().len(), 24);
    let text = std::fs::read_to_string(folder.path().join("warm.json")).unwrap();
    let read: calibration::ColourCalibration = serde_json::from_str(&text).unwrap();
    assert!((read.white_balance.gains[0] - 0.8 / 0.9).abs() < 0.02, "{:?}", read.white_balance);
    let swatches = image::open(folder.path().join("warm.png")).unwrap().to_rgb8();
    let (left, right) = (swatches.get_pixel(30, 30), swatches.get_pixel(80, 30));
    assert!(left.0.iter().zip(right.0).all(|(a, b)| a.abs_diff(b) < 20), "{left:?} {right:?}");
    // Results stay unless they are given up.
    let again = run(&[]);
    assert_eq!(again.code, 2);
    assert!(again.stderr.contains("--force"), "{}", again.stderr);
    assert_eq!(run(&["--force".as_ref()]).code, 0);
    // Middles of the corner patches: the same by hand.
    let told = ["--force", "--chart", "176,165", "726,165", "726,495", "176,495"];
    let told = run(&told.map(std::ffi::OsStr::new));
    assert_eq!(told.code, 0, "{}", told.stderr);
    let off = told.json["delta_e2000_mean"].as_f64().unwrap() - number("delta_e2000_mean");
    assert!(off.abs() < 0.1, "{off}");
}

#[test]
fn what_cannot_be_used_is_refused_with_a_way_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let command = |args: &[&str]| diaphane(["calibrate", "colour"].iter().chain(args));
    draw(&folder.path().join("half.png"), |x, _, rgb| if x > 450 { [70, 120, 50] } else { rgb });
    draw(&folder.path().join("whole.png"), |_, _, rgb| rgb);
    std::fs::write(path("short.csv"), "X,Y,Z\n1,1,1\n").unwrap();
    let (half, whole, short) = (path("half.png"), path("whole.png"), path("short.csv"));
    let gone = path("gone.png");
    for (args, word) in [
        (vec!["--image", &half], "--chart"),
        (vec!["--image", &gone], "gone.png"),
        (vec!["--image", &whole, "--reference", &short], "24 patches"),
        (vec!["--image", &whole, "--chart", "9,9", "8,8", "7,7"], "--chart"),
        (vec!["--image", &whole, "--chart", "9,9", "8,8", "7,7", "6,6"], "ColorChecker"),
        (vec!["--image", &whole, "--chart", "9,9", "8,8", "7,7", "6,x"], "--chart"),
        (vec!["--image", &whole, "--mosaic", "rggb"], "mosaic"),
        (vec!["--image", &whole, "--mosaic", "rgb"], "--mosaic"),
        (vec!["--image", &whole, "--flat", &gone], "gone.png"),
        (vec!["--frames", &gone], "--exposures"),
        (vec![], "--image"),
    ] {
        let run = command(&args);
        assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
        let said = format!("{}{}", run.stderr, run.json);
        assert!(said.contains(word), "{args:?}: {said}");
    }
}
