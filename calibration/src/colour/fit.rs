//! Calibrating a camera's colours from a chart, and judging the result on patches that it has not
//! seen.

use serde::{Deserialize, Serialize};

use crate::colour::cie::{D65, SRGB_TO_XYZ, adapt, delta_e2000, lab, srgb_codes, times};
use crate::colour::model::{ColourCorrection, ColourModel};
use crate::colour::patches::Patch;
use crate::colour::reference::ChartReference;
use crate::colour::white_balance::{GREYS, WhiteBalance, white_balance};
use crate::error::{CalibrationError, Result};

/// Fewer patches do not judge a model.
const FEWEST_PATCHES: usize = 18;

/// How far colours are off, CIEDE2000.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeltaE {
    /// Mean over the patches.
    pub mean: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

impl DeltaE {
    fn of(each: &[f64]) -> Self {
        let mut sorted = each.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        // Between the order statistics, so that 24 patches do not jump.
        let place = 0.95 * sorted.len().saturating_sub(1) as f64;
        let (low, high) = (place.floor() as usize, place.ceil() as usize);
        let at = |i: usize| sorted.get(i).copied().unwrap_or(f64::NAN);
        Self {
            mean: each.iter().sum::<f64>() / each.len().max(1) as f64,
            p95: at(low) + place.fract() * (at(high) - at(low)),
            max: at(sorted.len().saturating_sub(1)),
        }
    }
}

/// How a model does on the patches that it was fitted to, and on each when fitted to the others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelScore {
    /// The model.
    pub model: ColourModel,
    /// On the patches that it was fitted to.
    pub fitted: DeltaE,
    /// On each patch in turn, fitted to all others: what to expect of colours that are not on
    /// the chart.
    pub left_out: DeltaE,
}

/// One patch, as it should be and as it came out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PatchFit {
    /// What the picture shows.
    pub patch: Patch,
    /// X, Y, Z that the reference states.
    pub reference: [f64; 3],
    /// X, Y, Z after correction.
    pub corrected: [f64; 3],
    /// CIEDE2000 between the two.
    pub delta_e: f64,
    /// The same with this patch left out of the fit; None for one that is clipped.
    pub left_out: Option<f64>,
    /// 8-bit sRGB of reference and corrected colour, for a picture.
    pub srgb: [[u8; 3]; 2],
}

/// A camera's colours, calibrated, with the evidence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourCalibration {
    /// From camera colours to X, Y, Z under the reference's white.
    pub correction: ColourCorrection,
    /// What makes greys grey.
    pub white_balance: WhiteBalance,
    /// The camera's channels taken for linear sRGB, exposure matched: no correction at all.
    pub raw: DeltaE,
    /// The same after white balance.
    pub balanced: DeltaE,
    /// Every model that the patches determine, the simplest first.
    pub models: Vec<ModelScore>,
    /// Why this model, in words.
    pub why: String,
    /// The reference's name.
    pub reference: String,
    /// X, Y, Z of the white of the corrected colours.
    pub white: [f64; 3],
    /// All 24 patches.
    pub patches: Vec<PatchFit>,
}

impl ColourCalibration {
    /// The figures of the model that was chosen.
    pub fn score(&self) -> Option<&ModelScore> {
        self.models.iter().find(|score| score.model == self.correction.model)
    }
}

/// Fits camera colours to a chart's reference.
///
/// Every model is judged by leaving out each patch in turn; a richer one than the 3x3 matrix is
/// taken only if its left-out error is smaller by more than one standard error of the difference.
/// Clipped patches are left out of everything but the list.
///
/// # Errors
/// Fewer than 18 patches that are not clipped, or patches that do not determine a matrix.
pub fn calibrate_colour(
    patches: &[Patch; 24],
    reference: &ChartReference,
) -> Result<ColourCalibration> {
    let refuse = |reason: String| CalibrationError::ChartNotFound {
        picture: "colour calibration".into(),
        reason,
    };
    let white_balance = white_balance(patches)?;
    let used: Vec<usize> = (0..24).filter(|&i| !patches[i].is_clipped()).collect();
    if used.len() < FEWEST_PATCHES {
        return Err(refuse(format!("{} patches are not clipped, 18 are needed", used.len())));
    }
    let rgb: Vec<[f64; 3]> = used.iter().map(|&i| patches[i].radiance).collect();
    let xyz: Vec<[f64; 3]> = used.iter().map(|&i| reference.xyz[i]).collect();
    // A white patch's green would be 1.
    let unit = GREYS.map(|i| patches[i].radiance[1]).sum::<f64>()
        / GREYS.map(|i| reference.xyz[i][1]).sum::<f64>();
    let trials: Vec<Trial> = ColourModel::ALL
        .iter()
        .filter_map(|&model| Trial::run(model, unit, &rgb, &xyz, reference.white))
        .collect();
    let Some(simplest) = trials.first() else {
        return Err(refuse("its colours do not determine a matrix".into()));
    };
    let (mut chosen, mut why) = (simplest, format!("{} by default", simplest.correction.model));
    for trial in &trials[1..] {
        let (gain, error) = simplest.gain_of(trial);
        if gain > error && trial.left_out_mean() < chosen.left_out_mean() {
            chosen = trial;
            why = format!(
                "{}: left out it is better than the {} by {gain:.2} ± {error:.2}",
                trial.correction.model, simplest.correction.model
            );
        }
    }
    if chosen.correction.model == ColourModel::Matrix && trials.len() > 1 {
        why += ": left out, no richer model is better by more than its standard error";
    }
    let without = |gains: [f64; 3], black: [f64; 3]| {
        let plain: Vec<[f64; 3]> =
            rgb.iter().map(|v| std::array::from_fn(|c| gains[c] * (v[c] - black[c]))).collect();
        DeltaE::of(&uncorrected(&plain, &xyz, reference.white))
    };
    let fits = (0..24).map(|i| {
        let corrected = chosen.correction.apply(patches[i].radiance);
        let at = used.iter().position(|&j| j == i);
        PatchFit {
            patch: patches[i],
            reference: reference.xyz[i],
            corrected,
            delta_e: difference(corrected, reference.xyz[i], reference.white),
            left_out: at.and_then(|at| chosen.left_out.get(at).copied()),
            srgb: [reference.xyz[i], corrected].map(|v| srgb_codes(v, reference.white)),
        }
    });
    Ok(ColourCalibration {
        correction: chosen.correction.clone(),
        white_balance,
        raw: without([1.0; 3], [0.0; 3]),
        balanced: without(white_balance.gains, white_balance.black),
        models: trials.iter().map(Trial::score).collect(),
        why,
        reference: reference.name.clone(),
        white: reference.white,
        patches: fits.collect(),
    })
}

fn difference(a: [f64; 3], b: [f64; 3], white: [f64; 3]) -> f64 {
    delta_e2000(lab(a, white), lab(b, white))
}

/// Errors of camera channels that are taken for linear sRGB, at the exposure that matches the
/// luminances best.
fn uncorrected(rgb: &[[f64; 3]], xyz: &[[f64; 3]], white: [f64; 3]) -> Vec<f64> {
    let seen: Vec<[f64; 3]> =
        rgb.iter().map(|&v| adapt(times(&SRGB_TO_XYZ, v), D65, white)).collect();
    let sum = |f: &dyn Fn(f64, f64) -> f64| -> f64 {
        seen.iter().zip(xyz).map(|(s, k)| f(s[1], k[1]) / k[1]).sum()
    };
    let scale = sum(&|s, k| s * k) / sum(&|s, _| s * s);
    seen.iter().zip(xyz).map(|(s, k)| difference(s.map(|v| scale * v), *k, white)).collect()
}

/// A model fitted to all patches, and to all but each.
struct Trial {
    correction: ColourCorrection,
    fitted: Vec<f64>,
    left_out: Vec<f64>,
}

impl Trial {
    fn run(
        model: ColourModel,
        unit: f64,
        rgb: &[[f64; 3]],
        xyz: &[[f64; 3]],
        white: [f64; 3],
    ) -> Option<Self> {
        let correction = ColourCorrection::fit(model, unit, rgb, xyz)?;
        let off = |c: &ColourCorrection, i: usize| difference(c.apply(rgb[i]), xyz[i], white);
        let fitted = (0..rgb.len()).map(|i| off(&correction, i)).collect();
        let left_out: Option<Vec<f64>> = (0..rgb.len())
            .map(|i| {
                let but = |all: &[[f64; 3]]| [&all[..i], &all[i + 1..]].concat();
                Some(off(&ColourCorrection::fit(model, unit, &but(rgb), &but(xyz))?, i))
            })
            .collect();
        Some(Self { correction, fitted, left_out: left_out? })
    }

    fn left_out_mean(&self) -> f64 {
        self.left_out.iter().sum::<f64>() / self.left_out.len() as f64
    }

    /// How much better another model does left out, in the mean, with its standard error over
    /// the patches.
    fn gain_of(&self, other: &Self) -> (f64, f64) {
        let n = self.left_out.len() as f64;
        let gains: Vec<f64> =
            self.left_out.iter().zip(&other.left_out).map(|(a, b)| a - b).collect();
        let mean = gains.iter().sum::<f64>() / n;
        let variance = gains.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / (n - 1.0);
        (mean, (variance / n).sqrt())
    }

    fn score(&self) -> ModelScore {
        ModelScore {
            model: self.correction.model,
            fitted: DeltaE::of(&self.fitted),
            left_out: DeltaE::of(&self.left_out),
        }
    }
}
