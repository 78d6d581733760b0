//! White balance from a ColorChecker Classic.

use opencv::core::{Mat, Size};
use opencv::imgproc;
use opencv::mcc::{MCC_CCheckerDetector, MCC_TYPECHART};
use opencv::prelude::*;
use serde::{Deserialize, Serialize};

use crate::cv;
use crate::error::{CalibrationError, Result};
use crate::radiometry::hdr::HdrImage;

/// Published colours of the 24 patches, row by row from dark skin to black: 8-bit sRGB under D65.
const REFERENCE: [[u8; 3]; 24] = [
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

/// Patches of the grey row that set the balance: the white one may be clipped by gloss and the
/// black one is mostly stray light.
const GREYS: std::ops::Range<usize> = 19..23;

/// Mean distance from the published colours, in the units of [`distances`]: whole charts are 0.1
/// away under an uncorrected camera and 0.18 under one with a harsh tone curve, one half hidden
/// by a leaf 0.3.
const LARGEST_MEAN_DISTANCE: f64 = 0.24;

/// Distance of any one patch: 0.2 to 0.3 on whole charts, 0.7 on the half hidden one.
const LARGEST_DISTANCE: f64 = 0.45;

/// Median absolute deviation over a patch's median: sensor noise stays well below.
const LARGEST_UNEVENNESS: f64 = 0.2;

/// One patch of the chart in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Patch {
    /// Centre, pixels.
    pub centre: [f64; 2],
    /// Median radiance R, G, B over the inner part of the patch.
    pub radiance: [f64; 3],
    /// Median absolute deviation over the median, worst channel: texture, gloss or a stranger.
    pub unevenness: f64,
}

/// What makes the chart's greys grey.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WhiteBalance {
    /// Factors on (radiance − black), G = 1.
    pub gains: [f64; 3],
    /// Stray light to subtract from R, G, B, in the picture's unit.
    pub black: [f64; 3],
}

impl WhiteBalance {
    /// A balanced colour.
    pub fn apply(&self, rgb: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|c| self.gains[c] * (rgb[c] - self.black[c]))
    }
}

/// Finds a whole ColorChecker Classic in a linear RGB picture; 24 patches row by row, dark skin
/// first, black last.
///
/// # Errors
/// No chart, or one that cannot be trusted: a grey row that does not darken from patch to patch,
/// uneven patches, or colours far from the published ones (half hidden, dirty or another chart).
pub fn find_chart(image: &HdrImage, name: &str) -> Result<[Patch; 24]> {
    let refuse =
        |reason: String| CalibrationError::ChartNotFound { picture: name.to_owned(), reason };
    let samples = image.width * image.height * 3;
    if image.channels != 3 || image.radiance.len() != samples || samples == 0 {
        return Err(refuse(format!(
            "expected a colour picture, found {} channel(s)",
            image.channels
        )));
    }
    let corners = detect(image)
        .map_err(CalibrationError::opencv("looking for a ColorChecker"))?
        .ok_or_else(|| refuse("none seen".into()))?;
    // The detector does not say which corner is which: the colours do.
    let mut best: Option<(f64, [Patch; 24])> = None;
    for turn in 0..8 {
        let mut ring: [[f64; 2]; 4] = std::array::from_fn(|i| corners[(i + turn) % 4]);
        if turn >= 4 {
            ring.reverse();
        }
        let patches = measure(image, &ring)?;
        let distance = colour_distance(&patches);
        if best.as_ref().is_none_or(|(least, _)| distance < *least) {
            best = Some((distance, patches));
        }
    }
    let (distance, patches) = best.ok_or_else(|| refuse("none seen".into()))?;
    check(&patches, distance).map_err(refuse)?;
    Ok(patches)
}

/// Gains and black from the chart's greys: each channel's radiance is a straight line over the
/// published reflectance, radiance = black + slope · reflectance; gains make the slopes equal.
///
/// # Errors
/// A channel that does not rise with reflectance.
pub fn white_balance(patches: &[Patch; 24]) -> Result<WhiteBalance> {
    let mut slopes = [0.0; 3];
    let mut black = [0.0; 3];
    for c in 0..3 {
        let points: Vec<(f64, f64)> =
            GREYS.map(|i| (reflectance(REFERENCE[i][1]), patches[i].radiance[c])).collect();
        // Relative errors count alike in dark and bright patches: weights 1/reflectance².
        let weighted = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
            points.iter().map(|&(x, y)| f(x, y) / (x * x)).sum()
        };
        let (w, x, y) = (weighted(&|_, _| 1.0), weighted(&|x, _| x), weighted(&|_, y| y));
        let (xx, xy) = (weighted(&|x, _| x * x), weighted(&|x, y| x * y));
        slopes[c] = (w * xy - x * y) / (w * xx - x * x);
        black[c] = ((y - slopes[c] * x) / w).max(0.0);
        // Radiance below zero without light is the noise of four patches, not a black level.
        if black[c] == 0.0 {
            slopes[c] = xy / xx;
        }
    }
    if slopes.iter().any(|&s| !(s.is_finite() && s > 0.0)) {
        return Err(CalibrationError::ChartNotFound {
            picture: "grey row".into(),
            reason: format!("radiance does not rise with reflectance (slopes {slopes:?})"),
        });
    }
    Ok(WhiteBalance { gains: slopes.map(|s| slopes[1] / s), black })
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

/// Medians of all patches, for a chart with corners top left, top right, bottom right, bottom
/// left. In the chart's own unit a patch is 2.5 wide, gaps and rim 0.25.
fn measure(image: &HdrImage, ring: &[[f64; 2]; 4]) -> Result<[Patch; 24]> {
    let (wide, high) = (6.0 * 2.75 + 0.25, 4.0 * 2.75 + 0.25);
    let chart = [[0.0, 0.0], [wide, 0.0], [wide, high], [0.0, high]];
    let map = cv::homography(&chart, ring)?;
    let mut patches = [Patch { centre: [0.0; 2], radiance: [0.0; 3], unevenness: 0.0 }; 24];
    for (i, patch) in patches.iter_mut().enumerate() {
        let middle = [1.5 + 2.75 * (i % 6) as f64, 1.5 + 2.75 * (i / 6) as f64];
        patch.centre = cv::apply_homography(&map, middle);
        // The inner half of the patch, well away from its rim.
        const STEPS: usize = 15;
        let mut values = [const { Vec::new() }; 3];
        for step in 0..STEPS * STEPS {
            let part = |k: usize| 1.3 * (k as f64 / (STEPS - 1) as f64 - 0.5);
            let place = [middle[0] + part(step % STEPS), middle[1] + part(step / STEPS)];
            let [u, v] = cv::apply_homography(&map, place).map(f64::round);
            if u < 0.0 || v < 0.0 || u >= image.width as f64 || v >= image.height as f64 {
                continue;
            }
            let at = 3 * (v as usize * image.width + u as usize);
            for (c, list) in values.iter_mut().enumerate() {
                list.push(f64::from(image.radiance[at + c]));
            }
        }
        for (c, mut list) in values.into_iter().enumerate() {
            let middle = median(&mut list);
            list.iter_mut().for_each(|v| *v = (*v - middle).abs());
            patch.radiance[c] = middle;
            patch.unevenness = patch.unevenness.max(median(&mut list) / middle.abs().max(1e-12));
        }
    }
    Ok(patches)
}

/// The median, NaN for nothing.
fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Linear reflectance of an sRGB code (IEC 61966-2-1).
fn reflectance(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
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
    let green = |i: usize| patches[i].radiance[1];
    if let Some(i) = (18..23).find(|&i| green(i) <= green(i + 1)) {
        let (step, next) = (i - 17, i - 16);
        return Err(format!(
            "grey {next} is not darker than grey {step}: {:?}",
            [green(i), green(i + 1)]
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
