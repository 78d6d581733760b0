//! A ColorChecker Classic in a picture: found, and checked before it is believed.

use opencv::core::{Mat, Size};
use opencv::imgproc;
use opencv::mcc::{MCC_CCheckerDetector, MCC_TYPECHART};
use opencv::prelude::*;

use crate::colour::cie::srgb_to_linear;
use crate::colour::patches::{Chart, Patch};
use crate::colour::white_balance::GREYS;
use crate::cv;
use crate::error::{CalibrationError, Result};
use crate::radiometry::hdr::HdrImage;

/// Published colours of the 24 patches, row by row from dark skin to black: 8-bit sRGB under D65.
pub(crate) const REFERENCE: [[u8; 3]; 24] = [
    [115, 82, 68],
    [194, 150, 130],
    [98, 122, 157],
    [87, 108, 67],
    [133, 128, 177],
    [103, 189, 170],
    [214, 126, 44],
    [80, 91, 166],
    [193, 90, 99],
    [94, 60, 108],
    [157, 188, 64],
    [224, 163, 46],
    [56, 61, 150],
    [70, 148, 73],
    [175, 54, 60],
    [231, 199, 31],
    [187, 86, 149],
    [8, 133, 161],
    [243, 243, 242],
    [200, 200, 200],
    [160, 160, 160],
    [122, 122, 121],
    [85, 85, 85],
    [52, 52, 52],
];

/// Mean distance from the published colours, in the units of [`distances`]: whole charts are 0.1
/// away under an uncorrected camera and 0.18 under one with a harsh tone curve, one half hidden
/// by a leaf 0.3.
const LARGEST_MEAN_DISTANCE: f64 = 0.24;

/// Distance of any one patch: 0.2 to 0.3 on whole charts, 0.7 on the half hidden one.
const LARGEST_DISTANCE: f64 = 0.45;

/// Brightness of the lines between the patches over that of the patches.
const MOST_FILLED: f64 = 0.5;

/// More clipped patches leave too few; of those that set the balance none may be.
const CLIPPED_PATCHES: usize = 3;

/// Median absolute deviation over a patch's median: sensor noise stays well below.
const LARGEST_UNEVENNESS: f64 = 0.2;

/// Finds a whole ColorChecker Classic in a linear RGB picture; 24 patches row by row, dark skin
/// first, black last.
///
/// # Errors
/// [`CalibrationError::ChartNotFound`] without a chart, or with one that cannot be trusted: seen in
/// a mirror, out of focus, clipped, with a grey row that does not darken from patch to patch, with
/// uneven patches, or with colours far from the published ones (half hidden, dirty or another
/// chart).
pub fn find_chart(image: &HdrImage, name: &str) -> Result<[Patch; 24]> {
    let refuse =
        |reason: String| CalibrationError::ChartNotFound { picture: name.to_owned(), reason };
    check_image(image, name)?;
    let corners = detect(image)
        .map_err(CalibrationError::opencv("looking for a ColorChecker"))?
        .ok_or_else(|| refuse("none seen".into()))?;
    // The detector does not say which corner is which: the colours do.
    let mut best: Option<(f64, Chart, bool)> = None;
    for turn in 0..8 {
        let mut ring: [[f64; 2]; 4] = std::array::from_fn(|i| corners[(i + turn) % 4]);
        if turn >= 4 {
            ring.reverse();
        }
        let chart = Chart::within(ring)?;
        let distance = colour_distance(&chart.patches(image));
        if best.as_ref().is_none_or(|(least, ..)| distance < *least) {
            best = Some((distance, chart, is_mirrored(&ring)));
        }
    }
    let (_, chart, mirrored) = best.ok_or_else(|| refuse("none seen".into()))?;
    if mirrored {
        return Err(refuse("it is mirrored: was the picture flipped?".into()));
    }
    checked(image, &chart).map_err(refuse)
}

/// Reads a ColorChecker Classic whose place is known: `middles` are the pixels of the middles of
/// its corner patches, dark skin, bluish green, black and white.
///
/// # Errors
/// As [`find_chart`]; the place is checked like one that was found.
pub fn read_chart(image: &HdrImage, middles: [[f64; 2]; 4], name: &str) -> Result<[Patch; 24]> {
    let refuse =
        |reason: String| CalibrationError::ChartNotFound { picture: name.to_owned(), reason };
    check_image(image, name)?;
    let (width, height) = (image.width as f64, image.height as f64);
    if let Some(p) =
        middles.iter().find(|p| !((0.0..width).contains(&p[0]) && (0.0..height).contains(&p[1])))
    {
        return Err(refuse(format!(
            "patch at ({:.1}, {:.1}) is outside of its {width} x {height} pixels",
            p[0], p[1]
        )));
    }
    if is_mirrored(&middles) {
        return Err(refuse(
            "its corners are mirrored: dark skin, bluish green, black, white go clockwise".into(),
        ));
    }
    checked(image, &Chart::between(middles)?).map_err(refuse)
}

fn check_image(image: &HdrImage, name: &str) -> Result<()> {
    let samples = image.width * image.height * 3;
    if image.channels == 3 && image.radiance.len() == samples && samples > 0 {
        return Ok(());
    }
    Err(CalibrationError::ChartNotFound {
        picture: name.to_owned(),
        reason: format!("expected a colour picture, found {} channel(s)", image.channels),
    })
}

/// Whether corners that go clockwise on the chart go the other way in the picture.
fn is_mirrored(ring: &[[f64; 2]; 4]) -> bool {
    let twice_area: f64 =
        (0..4).map(|i| (ring[i], ring[(i + 1) % 4])).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
    twice_area < 0.0
}

fn checked(image: &HdrImage, chart: &Chart) -> std::result::Result<[Patch; 24], String> {
    let patches = chart.patches(image);
    check(&patches, colour_distance(&patches))?;
    let filled = chart.gaps_filled(image, &patches);
    if filled > MOST_FILLED {
        return Err(format!(
            "too blurred: the black lines between its patches are {:.0} % as bright as the \
             patches (at most {:.0} %)",
            100.0 * filled,
            100.0 * MOST_FILLED
        ));
    }
    Ok(patches)
}

/// The chart's four corners in the picture's pixels, in either sense of rotation.
fn detect(image: &HdrImage) -> opencv::Result<Option<[[f64; 2]; 4]>> {
    let mut sorted: Vec<f32> = image.radiance.iter().copied().step_by(7).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let bright = sorted[(sorted.len() - 1) * 99 / 100].max(f32::MIN_POSITIVE);
    // The detector wants a display picture, blue first.
    let display: Vec<u8> = image
        .radiance
        .chunks_exact(3)
        .flat_map(|px| [px[2], px[1], px[0]])
        .map(|v| (255.0 * (v / bright).clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8)
        .collect();
    let flat = Mat::from_slice(&display)?;
    let full = flat.reshape(3, i32::try_from(image.height).unwrap_or(i32::MAX))?;
    let shrink = (1200.0 / image.width.max(image.height) as f64).min(1.0);
    let mut small = full.try_clone()?;
    if shrink < 1.0 {
        imgproc::resize(&full, &mut small, Size::default(), shrink, shrink, imgproc::INTER_AREA)?;
    }
    let mut detector = MCC_CCheckerDetector::create()?;
    if !detector.process_def(&small, MCC_TYPECHART::MCC24)? {
        return Ok(None);
    }
    let corners = cv::points_from(&detector.get_best_color_checker()?.get_box()?);
    Ok(corners
        .try_into()
        .ok()
        .map(|ring: [[f64; 2]; 4]| ring.map(|corner| corner.map(|v| (v + 0.5) / shrink - 0.5))))
}

/// Linear reflectance of an sRGB code (IEC 61966-2-1).
pub(crate) fn reflectance(code: u8) -> f64 {
    srgb_to_linear(f64::from(code) / 255.0)
}

/// Distance of every patch from its published colour after balancing the greys: Euclid in the
/// cube root of the channels, so that 0.1 is about what CIELAB calls 10 units of lightness.
fn distances(patches: &[Patch; 24]) -> [f64; 24] {
    let scale: [f64; 3] = std::array::from_fn(|c| {
        let (mut seen, mut known) = (0.0, 0.0);
        for i in GREYS {
            seen += patches[i].radiance[c];
            known += reflectance(REFERENCE[i][c]);
        }
        known / seen
    });
    std::array::from_fn(|i| {
        let squares = (0..3).map(|c| {
            let seen = (patches[i].radiance[c] * scale[c]).max(0.0).cbrt();
            (seen - reflectance(REFERENCE[i][c]).cbrt()).powi(2)
        });
        squares.sum::<f64>().sqrt()
    })
}

fn colour_distance(patches: &[Patch; 24]) -> f64 {
    let sum: f64 = distances(patches).iter().sum();
    if sum.is_finite() { sum / 24.0 } else { f64::INFINITY }
}

fn check(patches: &[Patch; 24], distance: f64) -> std::result::Result<(), String> {
    let clipped: Vec<usize> = (0..24).filter(|&i| patches[i].is_clipped()).collect();
    if clipped.len() > CLIPPED_PATCHES || clipped.iter().any(|i| GREYS.contains(i)) {
        let names: Vec<String> = clipped.iter().map(|i| (i + 1).to_string()).collect();
        return Err(format!("clipped: patch {}", names.join(", ")));
    }
    let green = |i: usize| patches[i].radiance[1];
    if let Some(i) = (18..23).find(|&i| green(i) <= green(i + 1)) {
        return Err(format!(
            "its grey row does not darken from patch {} to patch {}: partly covered, or lit \
             unevenly?",
            i + 1,
            i + 2
        ));
    }
    let each = distances(patches);
    let worst = (0..24).max_by(|&a, &b| each[a].total_cmp(&each[b])).unwrap_or(0);
    if !(distance < LARGEST_MEAN_DISTANCE && each[worst] < LARGEST_DISTANCE) {
        return Err(format!(
            "its colours are not a ColorChecker's: {distance:.2} away on average (at most \
             {LARGEST_MEAN_DISTANCE}), patch {} by {:.2} (at most {LARGEST_DISTANCE})",
            worst + 1,
            each[worst]
        ));
    }
    if let Some(i) = (0..24).find(|&i| patches[i].unevenness > LARGEST_UNEVENNESS) {
        return Err(format!(
            "patch {} is uneven by {:.0} %: hidden, glossy or dirty?",
            i + 1,
            100.0 * patches[i].unevenness
        ));
    }
    Ok(())
}
