//! A projector's colour wheel, from how short exposures scatter.

use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};

/// What a camera saw of projector white in one exposure that began at any moment.
#[derive(Clone, Debug, PartialEq)]
pub struct BurstFrame {
    /// Exposure time, seconds.
    pub exposure_s: f64,
    /// Mean radiance of each channel.
    pub radiance: Vec<f64>,
}

/// A light that repeats itself: the colour wheel of a projector, or a lamp that flickers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourWheel {
    /// One turn, seconds.
    pub turn_s: f64,
    /// 1-sigma of it, seconds.
    pub turn_sigma_s: f64,
    /// For each channel the relative variance of its light within a turn.
    depth: Vec<f64>,
    /// For each channel the relative variance that does not depend on the exposure.
    floor: Vec<f64>,
}

/// Harmonics of a turn that count.
const HARMONICS: usize = 8;
/// Share of a turn that a colour's segment takes. Free harmonics would fit a wheel of two or three
/// times the period just as well; segments of another width do not move the period.
const SEGMENT: f64 = 1.0 / 3.0;
/// Turns that are looked for, seconds: 15 to 600 a second.
const TURNS_S: (f64, f64) = (1.0 / 600.0, 1.0 / 15.0);
/// Exposures below this show less than four frames of a display.
const SHORTEST_SAFE_S: f64 = 1.0 / 30.0;
/// −2 ln of the likelihood that a periodic light must gain over a steady one: the best of some
/// hundred periods gains 10 by chance.
const LEAST_EVIDENCE: f64 = 30.0;
/// Relative variance below which a light counts as steady: 2 % of it, squared. Frames that began
/// at one moment by chance are alike to any digit, and would else outweigh all others.
const FLOOR: f64 = 4e-4;
/// Rounds of the fit at one period.
const ROUNDS: usize = 100;

impl ColourWheel {
    /// The whole number of turns that is nearest to an exposure and takes at least 1/30 s.
    pub fn whole_turns_s(&self, exposure_s: f64) -> f64 {
        let least = (SHORTEST_SAFE_S / self.turn_s * (1.0 - 1e-9)).ceil();
        (exposure_s / self.turn_s).round().max(least) * self.turn_s
    }

    /// 1-sigma of each channel's relative brightness from frame to frame at an exposure.
    pub fn scatter(&self, exposure_s: f64) -> Vec<f64> {
        let left = share_left(exposure_s / self.turn_s);
        self.depth
            .iter()
            .zip(&self.floor)
            .map(|(depth, floor)| (depth * left + floor).sqrt())
            .collect()
    }
}

/// Share of the variance of a light that is on for [`SEGMENT`] of each turn that is left after
/// averaging over `turns`: sinc² of each harmonic.
fn share_left(turns: f64) -> f64 {
    let sinc2 = |x: f64| (x.sin() / x).powi(2);
    let (left, all) = (1..=HARMONICS).fold((0.0, 0.0), |(left, all), k| {
        let angle = std::f64::consts::PI * k as f64;
        let strength = sinc2(angle * SEGMENT);
        (left + strength * sinc2(angle * turns), all + strength)
    });
    left / all
}

/// Looks for a colour wheel in a burst of short exposures, several of each length, begun at moments
/// that have nothing to do with it. `None` if the light is as steady as its noise.
///
/// An exposure of t averages the k-th harmonic of a turn T down by sinc(k t/T), so over frames of
/// one length the relative variance of a channel is A Σ w_k sinc²(k t/T) + B: nothing but noise
/// remains at whole turns. Sample variances follow a gamma distribution; its likelihood is
/// maximised over A, B ≥ 0 by multiplicative rounds (Févotte, Bertin & Durrieu 2009) at each T,
/// and T is where it is largest.
///
/// # Errors
/// Fewer than six lengths with at least three frames each, or frames of different channels.
pub fn find_colour_wheel(frames: &[BurstFrame]) -> Result<Option<ColourWheel>> {
    let groups = groups(frames)?;
    let pooled = Group::pooled(&groups);
    let best_of = |turns: &mut dyn Iterator<Item = f64>| {
        turns.map(|turn| (pooled.fit(turn, FLOOR).0, turn)).min_by(|a, b| a.0.total_cmp(&b.0))
    };
    // Fine enough that the longest exposure's turns change by a twentieth from one to the next.
    let longest = frames.iter().map(|f| f.exposure_s).fold(0.0, f64::max);
    let rate = |turn: f64| 1.0 / turn;
    let step = 0.05 / longest;
    let count = ((rate(TURNS_S.0) - rate(TURNS_S.1)) / step).ceil() as usize;
    let mut coarse = (0..=count).map(|i| 1.0 / (rate(TURNS_S.1) + i as f64 * step));
    let Some((_, turn)) = best_of(&mut coarse) else { return Ok(None) };
    let mut fine = (-100..=100).map(|i| 1.0 / (rate(turn) + f64::from(i) * step / 50.0));
    let Some((least, turn_s)) = best_of(&mut fine) else { return Ok(None) };
    if pooled.steady() - least < LEAST_EVIDENCE {
        return Ok(None);
    }
    let fits: Vec<_> = groups.iter().map(|g| g.fit(turn_s, 0.0)).collect();
    Ok(Some(ColourWheel {
        turn_s,
        turn_sigma_s: sigma(&pooled, turn_s, least, step),
        depth: fits.iter().map(|f| f.1).collect(),
        floor: fits.iter().map(|f| f.2).collect(),
    }))
}

/// Where −2 ln of the likelihood is one above its least, to either side.
fn sigma(pooled: &Group, turn_s: f64, least: f64, step: f64) -> f64 {
    let reach = |direction: f64| {
        let turn = |i: i32| 1.0 / (1.0 / turn_s + direction * f64::from(i) * step / 200.0);
        let above = |i: &i32| pooled.fit(turn(*i), FLOOR).0 > least + 1.0;
        (turn((1..400).find(above).unwrap_or(400)) - turn_s).abs()
    };
    0.5 * (reach(1.0) + reach(-1.0))
}

/// Relative variances of one channel at each exposure.
struct Group {
    variances: Vec<Variance>,
}

struct Variance {
    exposure_s: f64,
    value: f64,
    /// Frames less one.
    freedom: f64,
}

impl Group {
    /// The channels' mean. While one colour is bright others are dark: the sum of their squares
    /// hardly depends on when an exposure begins, each of them does. All but one are free.
    fn pooled(channels: &[Self]) -> Self {
        let first = channels.first().map_or(&[][..], |group| &group.variances);
        let mean = |i: usize| {
            let sum: f64 = channels.iter().filter_map(|c| Some(c.variances.get(i)?.value)).sum();
            sum / channels.len() as f64
        };
        let free = channels.len().saturating_sub(1).max(1) as f64;
        let variances = first.iter().enumerate().map(|(i, v)| Variance {
            value: mean(i),
            freedom: free * v.freedom,
            exposure_s: v.exposure_s,
        });
        Self { variances: variances.collect() }
    }

    /// −2 ln of the likelihood, and the depth and floor that it is reached at, for a turn.
    fn fit(&self, turn_s: f64, least_floor: f64) -> (f64, f64, f64) {
        let left: Vec<f64> =
            self.variances.iter().map(|v| share_left(v.exposure_s / turn_s)).collect();
        let mean = self.variances.iter().map(|v| v.value).sum::<f64>() / left.len() as f64;
        let least = self.variances.iter().map(|v| v.value).fold(f64::INFINITY, f64::min);
        let least_floor = least_floor.max(1e-18);
        let (mut depth, mut floor) = (mean.max(1e-12), least.max(least_floor));
        for _ in 0..ROUNDS {
            let mut sums = [[0.0; 2]; 2];
            for (v, left) in self.variances.iter().zip(&left) {
                let model = depth * left + floor;
                for (sum, row) in sums.iter_mut().zip([*left, 1.0]) {
                    sum[0] += v.freedom * row * v.value / (model * model);
                    sum[1] += v.freedom * row / model;
                }
            }
            depth *= sums[0][0] / sums[0][1];
            floor = (floor * sums[1][0] / sums[1][1]).max(least_floor);
        }
        let pairs = self.variances.iter().zip(&left);
        let misfit = pairs.map(|(v, left)| v.misfit(depth * left + floor)).sum();
        (misfit, depth, floor)
    }

    /// −2 ln of the likelihood of a steady light.
    fn steady(&self) -> f64 {
        let freedom: f64 = self.variances.iter().map(|v| v.freedom).sum();
        let mean = self.variances.iter().map(|v| v.freedom * v.value).sum::<f64>() / freedom;
        self.variances.iter().map(|v| v.misfit(mean.max(1e-18))).sum()
    }
}

impl Variance {
    /// −2 ln of the gamma likelihood of this sample variance if the true one is `model`.
    fn misfit(&self, model: f64) -> f64 {
        self.freedom * (model.ln() + self.value / model)
    }
}

/// Relative variances by channel and exposure.
fn groups(frames: &[BurstFrame]) -> Result<Vec<Group>> {
    let bad = |found: String| CalibrationError::BadInput {
        what: "burst of short exposures".into(),
        expected: "at least six exposure times, three or more frames of each, with light in them"
            .into(),
        found,
    };
    let channels = frames.first().map_or(0, |f| f.radiance.len());
    if let Some(odd) = frames
        .iter()
        .find(|f| f.radiance.len() != channels || !f.radiance.iter().all(|r| r.is_finite()))
    {
        return Err(bad(format!("a frame of {} s with {:?}", odd.exposure_s, odd.radiance)));
    }
    let mut times: Vec<f64> = frames.iter().map(|f| f.exposure_s).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let mut out: Vec<Group> = (0..channels).map(|_| Group { variances: Vec::new() }).collect();
    for &exposure_s in &times {
        let own: Vec<_> = frames.iter().filter(|f| f.exposure_s == exposure_s).collect();
        if own.len() < 3 {
            continue;
        }
        let n = own.len() as f64;
        for (c, group) in out.iter_mut().enumerate() {
            // Relative to the mean over all frames: a short burst's own mean is far off.
            let all = frames.iter().map(|f| f.radiance[c] * f.exposure_s).sum::<f64>()
                / frames.iter().map(|f| f.exposure_s).sum::<f64>();
            let mean = own.iter().map(|f| f.radiance[c]).sum::<f64>() / n;
            let squares = own.iter().map(|f| (f.radiance[c] - mean).powi(2)).sum::<f64>();
            let value = squares / (n - 1.0) / (all * all);
            group.variances.push(Variance { exposure_s, value, freedom: n - 1.0 });
        }
    }
    // A channel without any light has no relative variance.
    out.retain(|g| g.variances.iter().all(|v| v.value.is_finite()));
    match out.first().map_or(0, |g| g.variances.len()) {
        0..6 => Err(bad(format!("{} frames of {} times", frames.len(), times.len()))),
        _ => Ok(out),
    }
}
