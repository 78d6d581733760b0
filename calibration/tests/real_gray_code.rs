//! Gray code of a real projector on a real board, against another decoder's projector pixels.

mod common;

use calibration::{CodeLayout, Decoded, LitCorner, decode, light_corners};
use std::path::Path;
use std::time::Instant;

/// Corners of one pose: camera pixel and the other decoder's projector pixel (NaN: none).
fn corners(dir: &Path, pose: usize) -> Vec<([f64; 2], [f64; 2])> {
    let table = std::fs::read_to_string(dir.join("correspondences.csv")).unwrap();
    let rows = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect::<Vec<f64>>());
    rows.filter(|r| r[0] == pose as f64).map(|r| ([r[4], r[5]], [r[6], r[7]])).collect()
}

fn decoded(dir: &Path, pose: usize) -> Decoded {
    let layout = CodeLayout::gray_code([1024, 768]);
    let pictures = layout.load(dir.join(format!("capture_{pose}"))).unwrap();
    decode(&layout, &pictures).unwrap()
}

#[test]
fn corners_agree_with_another_decoder() {
    let Some(dir) = common::data("procam/kamino410") else { return };
    let started = Instant::now();
    let mut apart = Vec::new();
    let mut table = String::new();
    for pose in 0..5 {
        let known = corners(&dir, pose);
        let decoded = decoded(&dir, pose);
        let found = light_corners(&decoded, &known.iter().map(|k| k.0).collect::<Vec<_>>());
        for (i, ((_, theirs), ours)) in known.iter().zip(&found).enumerate() {
            let LitCorner { pixel, sigma_px, pixels_used, rms_px } = ours.unwrap();
            table += &format!(
                "{pose},{i},{},{},{sigma_px},{pixels_used},{rms_px}\n",
                pixel[0], pixel[1]
            );
            let distance = (pixel[0] - theirs[0]).hypot(pixel[1] - theirs[1]);
            apart.extend(distance.is_finite().then_some(distance));
        }
    }
    eprintln!("5 poses of 42 pictures in {:.2} s", started.elapsed().as_secs_f64());
    apart.sort_by(f64::total_cmp);
    let at = |share: f64| apart[(share * (apart.len() - 1) as f64) as usize];
    eprintln!(
        "{} corners, apart: median {:.4}, 95 % {:.4}, most {:.4} px",
        apart.len(),
        at(0.5),
        at(0.95),
        at(1.0)
    );
    if let Some(path) = std::env::var_os("DIAPHANE_TEST_TABLE") {
        std::fs::write(path, table).unwrap();
    }
}
