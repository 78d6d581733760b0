//! Thirteen real views of a 9x6 board of 25 mm squares (Debian's opencv-doc).

mod common;

use calibration::{Board, Photo, calibrate_camera, list_pictures};

#[test]
fn thirteen_real_views_calibrate_to_a_fifth_of_a_pixel() {
    let Some(dir) = common::data("chessboard/opencv_stereo") else { return };
    let board = Board::parse("9x6", 25.0).unwrap();
    let views: Vec<_> = list_pictures(dir)
        .unwrap()
        .iter()
        .map(|path| board.view(&Photo::load(path).unwrap()).unwrap())
        .collect();
    assert_eq!(views.len(), 13);
    let camera = calibrate_camera(&views, [640, 480]).unwrap();
    eprintln!("{:?} {:?} rms {:.4}", camera.model, camera.standard_deviations, camera.rms_px);
    for view in &camera.views {
        eprintln!("  {} {:.3}", view.name, view.rms_px);
    }
    // The best published refinement of these pictures without a warped board reaches 0.195 px.
    assert!(camera.rms_px <= 0.21, "rms {:.4} px", camera.rms_px);
}
