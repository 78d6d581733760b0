//! How bright each exposure really is, told by the pixels that two exposures see.
//!
//! Shutters miss their times by several percent when they are short, and lamps drift: both show
//! as the ratio of one exposure to the next one longer. A ratio is estimated in eight classes of
//! brightness; their scatter beyond noise (a response that is a little wrong, say) counts as
//! uncertainty of the ratio (DerSimonian & Laird 1986), so that only what all brightnesses
//! agree on is taken for a wrong exposure.

use super::sensor::Channel;
use crate::median::median;

/// Signal over noise that a sample must have in the darker exposure, so that choosing samples by
/// brightness does not pull the ratio.
const CLEAR: f32 = 15.0;

const CLASSES: usize = 8;

/// Samples below which a class says nothing.
const ENOUGH: usize = 16;

/// Beyond this many sigma a ratio is corrected: by chance once in 16 000.
const SIGNIFICANT: f64 = 4.0;

/// What the overlap with the next longer exposure says about one exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureCheck {
    /// Nominal exposure time, s.
    pub exposure_s: f64,
    /// Light that was really there over what the time says, relative to the longest exposure; 1
    /// unless it was significant.
    pub gain: f64,
    /// Ratio to the next longer exposure over the ratio of their times, as measured; None where
    /// no pixel is well exposed in both, or for the longest.
    pub step: Option<f64>,
    /// 1-sigma uncertainty of `step`.
    pub step_sigma: f64,
}

/// A few samples of one exposure: exposure above black and, of it, what is dark.
pub(super) struct Few {
    pub time: f32,
    pub light: Vec<f32>,
    pub dark: Vec<f32>,
}

/// One sample that two exposures see well.
struct Pair {
    short: f64,
    long: f64,
    /// Variance of short/long relative to the square of it.
    variance: f64,
}

/// Ratio of `short` to `long` over the ratio of their times, with its sigma; `radiance` is what
/// they are expected to see, `channels` of equally many samples one after the other, and `order`
/// what sorts it.
pub(super) fn step(
    short: &Few,
    long: &Few,
    radiance: &[f32],
    order: &[usize],
    channels: &[Channel],
) -> Option<(f64, f64)> {
    let each = radiance.len() / channels.len().max(1);
    let mut pairs = Vec::new();
    for &i in order {
        let l = radiance[i];
        let channel = channels.get(i / each.max(1))?;
        let (low, high) = (l * short.time, l * long.time);
        let variance_low = channel.variance(low + short.dark[i]);
        let variance_high = channel.variance(high + long.dark[i]);
        // Eight sigma below clipping, predicted: no sample is there or not by its own noise.
        let unclipped = high + long.dark[i] + 8.0 * variance_high.sqrt() < channel.clipped;
        if unclipped && low > CLEAR * variance_low.sqrt() {
            let (short, long) = (f64::from(short.light[i]), f64::from(long.light[i]));
            let variance = variance_low / (low * low) + variance_high / (high * high);
            pairs.push(Pair { short, long, variance: variance.into() });
        }
    }
    let nominal = f64::from(short.time) / f64::from(long.time);
    let size = pairs.len().div_ceil(CLASSES).max(ENOUGH);
    let classes: Vec<(f64, f64)> =
        pairs.chunks(size).filter_map(|pairs| class_step(pairs, nominal)).collect();
    (classes.len() >= 2).then(|| random_effects(&classes))
}

/// Ratio of sums over a class, less what moved; and its variance.
fn class_step(pairs: &[Pair], nominal: f64) -> Option<(f64, f64)> {
    if pairs.len() < ENOUGH {
        return None;
    }
    let off = |p: &Pair| p.short / p.long / nominal - 1.0;
    let mut sorted: Vec<f64> = pairs.iter().map(off).filter(|v| v.is_finite()).collect();
    let middle = median(&mut sorted)?;
    let mut spread: Vec<f64> = sorted.iter().map(|v| (v - middle).abs()).collect();
    let noise = pairs.iter().map(|p| p.variance).sum::<f64>() / pairs.len() as f64;
    let sigma = (1.4826 * median(&mut spread)?).max(noise.sqrt());
    let (mut short, mut long, mut kept) = (0.0, 0.0, 0.0);
    for pair in pairs.iter().filter(|p| (off(p) - middle).abs() < 4.0 * sigma) {
        (short, long, kept) = (short + pair.short, long + pair.long, kept + 1.0);
    }
    (long > 0.0).then(|| (short / long / nominal, sigma * sigma / kept))
}

/// Mean of estimates whose true values scatter (DerSimonian & Laird 1986, eq. 8), and its sigma.
fn random_effects(classes: &[(f64, f64)]) -> (f64, f64) {
    let weigh = |between: f64| {
        let weights = classes.iter().map(|c| 1.0 / (c.1 + between));
        let total: f64 = weights.clone().sum();
        let mean = weights.clone().zip(classes).map(|(w, c)| w * c.0).sum::<f64>() / total;
        let squares: f64 = weights.map(|w| w * w).sum();
        (mean, total, squares)
    };
    let (mean, total, squares) = weigh(0.0);
    let q: f64 = classes.iter().map(|c| (c.0 - mean).powi(2) / c.1).sum();
    let between = (q - (classes.len() as f64 - 1.0)) / (total - squares / total);
    let (mean, total, _) = weigh(between.max(0.0));
    (mean, total.recip().sqrt())
}

/// Gains of the exposures, longest last, from the steps between them.
pub(super) fn chain(times: &[f64], steps: &[Option<(f64, f64)>]) -> Vec<ExposureCheck> {
    let mut gain = 1.0;
    let mut checks = Vec::new();
    for (k, &exposure_s) in times.iter().enumerate().rev() {
        let step = steps.get(k).copied().flatten();
        if let Some((ratio, sigma)) = step
            && (ratio - 1.0).abs() > SIGNIFICANT * sigma
        {
            gain *= ratio;
        }
        let (step, step_sigma) = step.map_or((None, 0.0), |(r, s)| (Some(r), s));
        checks.push(ExposureCheck { exposure_s, gain, step, step_sigma });
    }
    checks.reverse();
    checks
}
