//! The commands on photographs that were not made by us. Set DIAPHANE_TEST_DATA to a folder with
//! `chessboard/opencv_stereo` (OpenCV's stereo samples, left01.jpg to left14.jpg) and
//! `hdr/frobisher` (a bracket of JPEGs with EXIF); without it these tests say that they skip.

mod common;

use common::diaphane;
use std::path::{Path, PathBuf};

fn data(folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("DIAPHANE_TEST_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = root.join(folder);
    if path.is_dir() {
        return Some(path);
    }
    println!(
        "SKIPPED: {} is not there (DIAPHANE_TEST_DATA names the folder of test data)",
        path.display()
    );
    None
}

/// OpenCV's tutorials reach 0.41 px here and lose corners in two views; 0.1954 px is what the
/// plain pinhole model with well-placed corners gives, 0.21 leaves room for another corner finder.
#[test]
fn a_camera_from_opencvs_chessboards() {
    let Some(images) = data("chessboard/opencv_stereo") else { return };
    let run = diaphane([
        "calibrate",
        "camera",
        "--images",
        images.to_str().unwrap(),
        "--board",
        "9x6",
        "--square",
        "25",
    ]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!((&run.json["views_found"], &run.json["views_total"]), (&13.into(), &13.into()));
    let number = |key: &str| run.json[key].as_f64().unwrap();
    assert!(number("rms_px") <= 0.21, "{}", run.json);
    assert!(number("worst_view_px") < 0.5, "{}", run.json);
    // Published with the pictures, from fits of 0.39 px: 535.9 and (342.3, 235.6).
    assert!((number("fx") - 535.9).abs() < 6.0 && (number("fy") - 535.9).abs() < 6.0);
    assert!((number("cx") - 342.3).abs() < 6.0 && (number("cy") - 235.6).abs() < 6.0);
    assert_eq!(run.json["distortion"].as_array().unwrap().len(), 8);
}

#[test]
fn a_picture_from_a_photographers_bracket() {
    let Some(images) = data("hdr/frobisher") else { return };
    let folder = tempfile::tempdir().unwrap();
    let exr = folder.path().join("frobisher.exr");
    let merge = || {
        diaphane(["merge", "--images", images.to_str().unwrap(), "--output", exr.to_str().unwrap()])
    };
    let run = merge();
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(run.json["finite_share"], 1.0);
    assert_eq!(run.json["response_strictly_increasing"], true);
    let image = calibration::read_exr(&exr).unwrap();
    assert_eq!([image.width, image.height, image.channels], [640, 426, 3]);
    assert!(image.radiance.iter().all(|v| v.is_finite()) && image.variance_known);
    // What is there stays.
    let before = std::fs::read(&exr).unwrap();
    let again = merge();
    assert_eq!(again.code, 2);
    assert!(again.json["hint"].as_str().unwrap().contains("--force"));
    assert_eq!(std::fs::read(&exr).unwrap(), before);
}
