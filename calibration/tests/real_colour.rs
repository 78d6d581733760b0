//! Real pictures of ColorCheckers: whole ones, and one that a leaf half hides.

mod common;

use calibration::{CalibrationError, HdrImage, KNOTS, Photo, Response, find_chart, white_balance};

/// The pictures are sRGB.
fn srgb() -> Response {
    let linear = |k: usize| {
        let v = k as f64 / (KNOTS - 1) as f64;
        if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
    };
    Response::from_exposures(vec![(0..KNOTS).map(linear).collect(); 3]).unwrap()
}

fn open(name: &str) -> Option<HdrImage> {
    let photo = Photo::load(common::data("colorchecker")?.join(name)).unwrap();
    Some(HdrImage::from_photo(&photo, &srgb()).unwrap())
}

#[test]
fn whole_charts_are_found_and_balanced() {
    for name in ["cwakholi/cwak_Image_1.JPG", "plantcv/plantcv_target_img.png"] {
        let Some(image) = open(name) else { return };
        let patches = find_chart(&image, name).unwrap();
        let balance = white_balance(&patches).unwrap();
        eprintln!("{name}: {balance:?}");
        for patch in &patches[19..23] {
            let [r, g, b] = balance.apply(patch.radiance);
            // Greys are neutral to the few percent by which camera curves differ from sRGB's;
            // unbalanced they are off by up to 15 %.
            assert!((r / g - 1.0).abs() < 0.08 && (b / g - 1.0).abs() < 0.08, "{r} {g} {b}");
        }
    }
}

#[test]
fn a_half_hidden_chart_is_refused() {
    let name = "plantcv/plantcv_partial_card_rgb.png";
    let Some(image) = open(name) else { return };
    let error = find_chart(&image, name).unwrap_err().to_string();
    eprintln!("{error}");
    assert!(error.contains(name), "{error}");
}

#[test]
fn a_picture_without_a_chart_is_refused() {
    for (width, height) in [(200, 150), (3, 2), (1, 1)] {
        let flat = HdrImage {
            width,
            height,
            channels: 3,
            radiance: vec![0.5; width * height * 3],
            variance: vec![1.0; width * height * 3],
            variance_known: false,
            clipped_shortest: 0,
            lost_longest: 0,
        };
        let error = find_chart(&flat, "flat.exr").unwrap_err();
        assert!(matches!(error, CalibrationError::ChartNotFound { .. }), "{error}");
    }
}
