//! Thirteen real views of a 9x6 board of 25 mm squares (Debian's opencv-doc).

mod common;

use calibration::{Board, CalibrationError, calibrate_camera, find_views, list_pictures};

#[test]
fn thirteen_real_views_calibrate_to_a_fifth_of_a_pixel() {
    let Some(dir) = common::data("chessboard/opencv_stereo") else { return };
    let board = Board::parse("9x6", 25.0).unwrap();
    let found = find_views(&list_pictures(dir).unwrap(), &board).unwrap();
    assert_eq!((found.views.len(), found.missed.len(), found.size), (13, 0, [640, 480]));
    let camera = calibrate_camera(&found.views, found.size).unwrap();
    eprintln!("{:?} {:?} rms {:.4}", camera.model, camera.standard_deviations, camera.rms_px);
    for view in &camera.views {
        eprintln!("  {} {:.3}", view.name, view.rms_px);
    }
    // The best published refinement of these pictures without a warped board reaches 0.195 px.
    assert!(camera.rms_px <= 0.21, "rms {:.4} px", camera.rms_px);
}

#[test]
fn pictures_of_mixed_sizes_and_without_boards_are_told_apart() {
    let dir = tempfile::tempdir().unwrap();
    let board = Board::parse("9x6", 25.0).unwrap();
    for (name, width) in [("a.png", 160), ("b.png", 160), ("c.png", 200)] {
        image::GrayImage::from_pixel(width, 120, image::Luma([128]))
            .save(dir.path().join(name))
            .unwrap();
    }
    let pictures = list_pictures(dir.path()).unwrap();
    let mixed = find_views(&pictures, &board);
    let message = mixed.unwrap_err().to_string();
    assert!(message.contains("c.png") && message.contains("160x120"), "{message}");
    let empty = find_views(&pictures[..2], &board).unwrap();
    assert_eq!((empty.views.len(), empty.missed.len()), (0, 2));
    let few = calibrate_camera(&empty.views, empty.size);
    assert!(matches!(few, Err(CalibrationError::TooFewViews { found: 0, .. })), "{few:?}");
}
