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
    for (distortion, warp) in [
        (None, false),
        (Some(Distortion::K1), false),
        (Some(Distortion::K1K2P1P2), false),
        (Some(Distortion::K1K2P1P2), true),
    ] {
        let choice = Choice { camera: distortion, projector: distortion, skew: false, warp };
        let result = calibrate_geometry(&views, [1280, 1024], Some([1024, 768]), choice).unwrap();
        let projector = result.projector.as_ref().unwrap();
        eprintln!(
            "rms {:.4} camera {:.4} {:?} projector {:.4} {:?}\n {:?} ± {:?}, baseline {:.2} ± {:.2}, warp {:?}, {} outliers",
            result.rms_px,
            result.camera.rms_px,
            result.camera.selection,
            projector.device.rms_px,
            projector.device.selection,
            projector.device.model,
            projector.device.standard_deviations,
            projector.baseline_mm,
            projector.baseline_standard_deviation_mm,
            result.warp_mm,
            result.outliers.len()
        );
    }
}
