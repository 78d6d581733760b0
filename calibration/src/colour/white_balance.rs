//! What makes the chart's greys grey.

use serde::{Deserialize, Serialize};

use crate::colour::chart::{REFERENCE, reflectance};
use crate::colour::patches::Patch;
use crate::error::{CalibrationError, Result};

/// Patches of the grey row that set the balance: the white one may be clipped by gloss and the
/// black one is mostly stray light.
pub(crate) const GREYS: std::ops::Range<usize> = 19..23;

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
