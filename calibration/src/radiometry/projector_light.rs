//! A projector's light: its response from a ramp of grey levels, its black, its evenness.

use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};
use crate::radiometry::hdr::HdrImage;

/// What a projector makes of its input, channel by channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProjectorLight {
    /// Inputs that were measured, 0 to 1, rising.
    pub levels: Vec<f64>,
    /// One a channel of the camera.
    pub channels: Vec<ChannelLight>,
}

/// One channel's light, white less black being 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelLight {
    /// Light at each level less that at level 0: from 0 to 1, never falling.
    pub light: Vec<f64>,
    /// 1-sigma of each, from the pictures' noise.
    pub sigma: Vec<f64>,
    /// The exponent of input^γ that comes closest.
    pub gamma: f64,
    /// RMS of what the light differs from that power by.
    pub gamma_rms: f64,
    /// Black over white. What the room adds to both is in it.
    pub black: f64,
    /// 1-sigma of it.
    pub black_sigma: f64,
    /// Largest step down from one level to the next before it was levelled out, in its 1-sigma;
    /// 0 if there was none. Much more than 3 is no noise: a lamp that is not steady.
    pub largest_fall: f64,
}

impl ChannelLight {
    /// White over black, and its 1-sigma.
    pub fn contrast(&self) -> (f64, f64) {
        (1.0 / self.black, self.black_sigma / (self.black * self.black))
    }
}

impl ProjectorLight {
    /// Light of a channel at an input from 0 to 1, white less black being 1: straight lines
    /// between the levels that were measured.
    pub fn light(&self, channel: usize, input: f64) -> Option<f64> {
        let light = &self.channels.get(channel)?.light;
        interpolate(&self.levels, light, input)
    }

    /// The input that gives a channel's light, 0 to 1.
    pub fn input(&self, channel: usize, light: f64) -> Option<f64> {
        interpolate(&self.channels.get(channel)?.light, &self.levels, light)
    }
}

/// The value at `x` on the straight lines through points of rising `xs`, ends held.
fn interpolate(xs: &[f64], values: &[f64], x: f64) -> Option<f64> {
    let above = xs.partition_point(|&at| at < x).clamp(1, xs.len().checked_sub(1)?.max(1));
    let ([a, b], [u, v]) = (xs.get(above - 1..=above)?, values.get(above - 1..=above)?) else {
        return None;
    };
    let part = if b > a { ((x - a) / (b - a)).clamp(0.0, 1.0) } else { 0.0 };
    Some(u + part * (v - u))
}

/// Pixels count where white has at least this share of the brightest pixels' light.
const BRIGHT: f32 = 0.3;
/// Levels, counting black and white.
const LEAST_LEVELS: usize = 5;

/// Measures a projector from pictures of a white sheet under a ramp of grey levels: `(level,
/// picture)`, linearised, dark frames subtracted, level 0 and 1 among them.
///
/// A channel's light at a level is the ratio of sums over the pixels that are well lit by white
/// and measured in every picture, black subtracted from both. The levels are put in order and
/// falls between them levelled out by pooling neighbours (isotonic regression).
///
/// # Errors
/// Fewer than five levels, no level 0 or 1, pictures of different sizes, or no pixel that is lit.
pub fn measure_projector_light(ramp: &[(f64, HdrImage)]) -> Result<ProjectorLight> {
    let mut ramp: Vec<&(f64, HdrImage)> = ramp.iter().collect();
    ramp.sort_by(|a, b| a.0.total_cmp(&b.0));
    let bad = |found: String| CalibrationError::BadInput {
        what: "ramp of grey levels".into(),
        expected: format!("at least {LEAST_LEVELS} different levels from 0 to 1, one picture each"),
        found,
    };
    let levels: Vec<f64> = ramp.iter().map(|r| r.0).collect();
    let rising = levels.windows(2).all(|pair| pair[0] < pair[1]);
    let (Some((0.0, black)), Some((1.0, white)), true, true) =
        (ramp.first(), ramp.last(), rising, ramp.len() >= LEAST_LEVELS)
    else {
        return Err(bad(format!("{levels:?}")));
    };
    for (level, picture) in ramp.iter().copied() {
        let shape = |p: &HdrImage| (p.width, p.height, p.channels);
        if shape(picture) != shape(white) {
            return Err(CalibrationError::Mismatch {
                picture: format!("level {level:.3}"),
                expected: format!("{:?} as at level 1", shape(white)),
                found: format!("{:?}", shape(picture)),
            });
        }
    }
    let pixels = lit_pixels(white, &ramp);
    if pixels.is_empty() {
        return Err(CalibrationError::BadInput {
            what: "ramp of grey levels".into(),
            expected: "a white sheet lit by the projector, within the camera's range".into(),
            found: "no pixel that is lit by white and measured at every level".into(),
        });
    }
    let channels =
        (0..white.channels).map(|c| channel_light(&ramp, black, white, &pixels, c)).collect();
    Ok(ProjectorLight { levels, channels })
}

/// Pixels that white lights well and that every picture measured in every channel.
fn lit_pixels(white: &HdrImage, ramp: &[&(f64, HdrImage)]) -> Vec<usize> {
    let n = white.channels;
    let mut bright: Vec<f32> = white.radiance.chunks_exact(n).map(|px| px.iter().sum()).collect();
    let all = bright.clone();
    let place = bright.len().saturating_sub(1) * 99 / 100;
    if bright.is_empty() {
        return Vec::new();
    }
    let least = BRIGHT * *bright.select_nth_unstable_by(place, f32::total_cmp).1;
    let measured = |p: usize| {
        let whole =
            |picture: &HdrImage| picture.variance[p * n..(p + 1) * n].iter().all(|v| v.is_finite());
        ramp.iter().all(|(_, picture)| whole(picture))
    };
    (0..all.len()).filter(|&p| all[p] > least.max(0.0) && measured(p)).collect()
}

/// A sum over pixels and its variance.
fn sum(picture: &HdrImage, pixels: &[usize], channel: usize) -> (f64, f64) {
    pixels.iter().map(|&p| p * picture.channels + channel).fold((0.0, 0.0), |(s, v), at| {
        (s + f64::from(picture.radiance[at]), v + f64::from(picture.variance[at]))
    })
}

fn channel_light(
    ramp: &[&(f64, HdrImage)],
    black: &HdrImage,
    white: &HdrImage,
    pixels: &[usize],
    channel: usize,
) -> ChannelLight {
    let (dark, dark_variance) = sum(black, pixels, channel);
    let (full, full_variance) = sum(white, pixels, channel);
    let range = full - dark;
    let mut measured: Vec<(f64, f64)> = ramp
        .iter()
        .map(|(_, picture)| {
            let (light, variance) = sum(picture, pixels, channel);
            let share = (light - dark) / range;
            // Black is in numerator and denominator, white in the latter.
            let spread =
                variance + (1.0 - share).powi(2) * dark_variance + share * share * full_variance;
            (share, spread.sqrt() / range)
        })
        .collect();
    // The ends are 0 and 1 by definition.
    let last = measured.len() - 1;
    (measured[0], measured[last]) = ((0.0, 0.0), (1.0, 0.0));
    let fall =
        |pair: &[(f64, f64)]| (pair[0].0 - pair[1].0) / pair[0].1.hypot(pair[1].1).max(1e-12);
    let largest_fall = measured.windows(2).map(fall).fold(0.0, f64::max);
    let light = never_falling(&measured);
    let levels = || ramp.iter().map(|r| r.0);
    let (gamma, gamma_rms) = power(&levels().zip(light.iter().copied()).collect::<Vec<_>>());
    let ratio = dark / full;
    ChannelLight {
        sigma: measured.iter().map(|m| m.1).collect(),
        light,
        gamma,
        gamma_rms,
        black: ratio,
        black_sigma: (dark_variance + ratio * ratio * full_variance).sqrt() / full,
        largest_fall,
    }
}

/// The nearest values that never fall: neighbours out of order are pooled, weighted by 1/σ².
fn never_falling(measured: &[(f64, f64)]) -> Vec<f64> {
    // Mean, weight and number of the pooled.
    let mut pools: Vec<(f64, f64, usize)> = Vec::with_capacity(measured.len());
    for &(value, sigma) in measured {
        let mut pool = (value, 1.0 / sigma.max(1e-9).powi(2), 1);
        while let Some(&(before, weight, count)) = pools.last().filter(|p| p.0 > pool.0) {
            let total = weight + pool.1;
            pool = ((before * weight + pool.0 * pool.1) / total, total, count + pool.2);
            pools.pop();
        }
        pools.push(pool);
    }
    pools.into_iter().flat_map(|(mean, _, count)| std::iter::repeat_n(mean, count)).collect()
}

/// γ of light = level^γ by least squares of the light, and the RMS of what is left.
fn power(points: &[(f64, f64)]) -> (f64, f64) {
    let misfit = |gamma: f64| points.iter().map(|(x, y)| (x.powf(gamma) - y).powi(2)).sum::<f64>();
    // One valley: golden sections of a range that holds every projector.
    let (mut low, mut high) = (0.1, 10.0);
    let part = (5_f64.sqrt() - 1.0) / 2.0;
    for _ in 0..60 {
        let (a, b) = (high - part * (high - low), low + part * (high - low));
        if misfit(a) < misfit(b) { high = b } else { low = a }
    }
    let gamma = 0.5 * (low + high);
    (gamma, (misfit(gamma) / points.len().max(1) as f64).sqrt())
}

/// How even projector white is over the projector's picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProjectorFlatField {
    /// Columns and rows that the projector's picture is cut into.
    pub cells: [usize; 2],
    /// Irradiance of each cell over the brightest's, row by row; `None` where the sheet does not
    /// show it. Distance and obliquity of the sheet are in it.
    pub irradiance: Vec<Option<f64>>,
    /// 1-sigma of each.
    pub sigma: Vec<Option<f64>>,
}

impl ProjectorFlatField {
    /// Averages a picture of the sheet under projector white, black subtracted, over cells of the
    /// projector's picture; `projector_pixel` is where a camera pixel is lit from.
    ///
    /// # Errors
    /// No pixel of the sheet is lit.
    pub fn measure(
        white: &HdrImage,
        projector: [usize; 2],
        cells: [usize; 2],
        projector_pixel: impl Fn([f64; 2]) -> Option<[f64; 2]>,
    ) -> Result<Self> {
        let mut sums = vec![(0.0_f64, 0.0_f64, 0.0_f64); cells[0] * cells[1]];
        for p in 0..white.width * white.height {
            let at = [(p % white.width) as f64, (p / white.width) as f64];
            let Some([u, v]) = projector_pixel(at) else { continue };
            let cell = |x: f64, size: usize, n: usize| {
                let c = ((x + 0.5) / size as f64 * n as f64).floor();
                (c >= 0.0 && c < n as f64).then_some(c as usize)
            };
            let (Some(x), Some(y)) =
                (cell(u, projector[0], cells[0]), cell(v, projector[1], cells[1]))
            else {
                continue;
            };
            let samples = p * white.channels..(p + 1) * white.channels;
            let variance: f64 = white.variance[samples.clone()].iter().map(|v| f64::from(*v)).sum();
            if variance.is_finite() {
                let light: f64 = white.radiance[samples].iter().map(|l| f64::from(*l)).sum();
                let sum = &mut sums[y * cells[0] + x];
                *sum = (sum.0 + light, sum.1 + variance, sum.2 + 1.0);
            }
        }
        let brightest = sums.iter().filter(|s| s.2 > 0.0).map(|s| s.0 / s.2).fold(0.0, f64::max);
        if brightest <= 0.0 {
            return Err(CalibrationError::BadInput {
                what: "flat field of the projector".into(),
                expected: "a white sheet lit by the projector".into(),
                found: "no pixel that is lit".into(),
            });
        }
        let each = |value: fn(&(f64, f64, f64)) -> f64| {
            sums.iter().map(|s| (s.2 > 0.0).then(|| value(s) / s.2 / brightest)).collect()
        };
        Ok(Self { cells, irradiance: each(|s| s.0), sigma: each(|s| s.1.sqrt()) })
    }

    /// Irradiance of the darkest cell that was seen over that of the brightest.
    pub fn evenness(&self) -> f64 {
        self.irradiance.iter().flatten().copied().fold(1.0, f64::min)
    }
}
