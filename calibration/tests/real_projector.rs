//! A real projector and camera: five poses of a 9x7 board, decoded by Gray code.

mod common;

use calibration::{Choice, CodedCorner, Distortion, RigView, View, calibrate_geometry};

#[test]
fn a_lens_shifted_projector_is_found_below_its_own_picture() {
    let Some(dir) = common::data("procam/kamino410") else { return };
    let table = std::fs::read_to_string(dir.join("correspondences.csv")).unwrap();
    let rows: Vec<Vec<f64>> = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect())
        .collect();
    let view = |pose: i32| {
        let rows: Vec<&Vec<f64>> = rows.iter().filter(|r| r[0] == f64::from(pose)).collect();
        let lit = |(corner, r): (usize, &&Vec<f64>)| {
            let projector_px = [r[6], r[7]];
            let slope = [[0.0; 2]; 2];
            // Corners that the Gray code could not decode have no projector pixel.
            (r[6].is_finite()).then_some(CodedCorner { corner, projector_px, slope })
        };
        RigView {
            board: View {
                name: format!("capture_{pose}"),
                image_points: rows.iter().map(|r| [r[4], r[5]]).collect(),
                object_points: rows.iter().map(|r| [r[2], r[3], 0.0]).collect(),
            },
            coded: rows.iter().enumerate().filter_map(lit).collect(),
            projected: Vec::new(),
        }
    };
    let views: Vec<RigView> = (0..5).map(view).collect();
    let choice = Choice {
        camera: Some(Distortion::K1K2P1P2),
        projector: Some(Distortion::K1K2P1P2),
        ..Choice::default()
    };
    let result = calibrate_geometry(&views, [1280, 1024], Some([1024, 768]), choice).unwrap();
    let projector = result.projector.as_ref().unwrap();
    eprintln!(
        "rms {:.4} camera {:.4} projector {:.4} {:?}, baseline {:.2} ± {:.2}, {} left out",
        result.rms_px,
        result.camera.rms_px,
        projector.device.rms_px,
        projector.device.model,
        projector.baseline_mm,
        projector.baseline_standard_deviation_mm,
        result.outliers.len()
    );
    // Adjusted by others with nothing left out: 0.265 px, 1892.6 1897.4 502.9 854.2, 675.6 mm. These
    // corners jump by pixels where the board curls; without them the focal lengths are half a
    // percent less, the principal point 10 to 20 px elsewhere.
    assert!(result.rms_px < 0.16, "{}", result.rms_px);
    let model = projector.device.model;
    assert!((model.fx / 1892.6 - 1.0).abs() < 0.01, "{model:?}");
    assert!((model.fy / 1897.4 - 1.0).abs() < 0.01, "{model:?}");
    assert!(model.cy > 768.0 && (model.cy - 854.2).abs() < 25.0, "{model:?}");
    assert!((projector.baseline_mm - 675.6).abs() < 4.0, "{}", projector.baseline_mm);
    assert!((10..45).contains(&result.outliers.len()), "{}", result.outliers.len());
}
