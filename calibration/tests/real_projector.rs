//! A real projector and camera: five poses of a 9x7 board, decoded by Gray code.

mod common;

use calibration::{ProjectorView, View, calibrate_camera, calibrate_projector};

fn decoded<'a>(rows: &'a [&Vec<f64>]) -> impl Iterator<Item = &'a Vec<f64>> {
    rows.iter().copied().filter(|r| r[6].is_finite() && r[7].is_finite())
}

#[test]
fn a_lens_shifted_projector_is_found_below_its_own_picture() {
    let Some(dir) = common::data("procam/kamino410") else { return };
    let table = std::fs::read_to_string(dir.join("correspondences.csv")).unwrap();
    let rows: Vec<Vec<f64>> = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect())
        .collect();
    let poses: Vec<Vec<&Vec<f64>>> =
        (0..5).map(|pose| rows.iter().filter(|r| r[0] == f64::from(pose)).collect()).collect();
    let views: Vec<View> = poses
        .iter()
        .enumerate()
        .map(|(i, rows)| View {
            name: format!("capture_{i}"),
            image_points: rows.iter().map(|r| [r[4], r[5]]).collect(),
            object_points: rows.iter().map(|r| [r[2], r[3], 0.0]).collect(),
        })
        .collect();
    let camera = calibrate_camera(&views, [1280, 1024]).unwrap();
    let seen: Vec<ProjectorView> = poses
        .iter()
        .zip(&views)
        .zip(&camera.views)
        .map(|((rows, view), fit)| ProjectorView {
            name: view.name.clone(),
            board_pose: fit.pose,
            // Corners that the Gray code could not decode have no projector pixel.
            board_points: decoded(rows).map(|r| [r[2], r[3], 0.0]).collect(),
            projector_pixels: decoded(rows).map(|r| [r[6], r[7]]).collect(),
        })
        .collect();
    let projector = calibrate_projector(&seen, [1024, 768]).unwrap();
    eprintln!(
        "camera rms {:.4}; projector {:?} ± {:?} rms {:.4} baseline {:.1}",
        camera.rms_px,
        projector.model,
        projector.standard_deviations,
        projector.rms_px,
        projector.baseline_mm
    );
    // The camera alone reaches 0.309 on these corners.
    assert!(camera.rms_px < 0.315, "{}", camera.rms_px);
    // A full bundle adjustment of both devices: 1892.6 1897.4 502.9 854.2, baseline 675.6 mm.
    // One sigma of the focal length is about 0.3 % with five views of a board.
    let model = projector.model;
    assert!((model.fx / 1892.6 - 1.0).abs() < 0.015, "{model:?}");
    assert!((model.fy / 1897.4 - 1.0).abs() < 0.015, "{model:?}");
    assert!((model.cy - 854.2).abs() < 25.0, "{model:?}");
    assert!((projector.baseline_mm - 675.6).abs() < 10.0, "{}", projector.baseline_mm);
}
