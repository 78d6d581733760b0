//! The radiance of many samples at once, by iterated weights.
//!
//! The radiance L of a sample solves Σ tᵢ (xᵢ − tᵢ L)/V(tᵢ L) = 0, the quasi-likelihood
//! equation (Wedderburn 1974) for samples of mean tᵢ L and a variance V that depends on the
//! mean. With weights from the common L, not from each sample's own noisy value, every term has
//! mean zero, and the bias of second order vanishes too: the covariance of the score with its
//! slope and the score's mean curvature cancel. Its inverse information is the variance.
//!
//! Where a sample is hardly above its noise, even the common L makes poor weights; there they
//! come from the mean of neighbours, whose error costs a little variance but biases nothing.

use super::censored::{EDGE, hazard_and_share};
use super::sensor::VarianceOf;

/// Samples that are worked on side by side: a multiple of every vector register's width, few
/// enough for sixteen frames of them to stay in the first cache.
pub(super) const LANES: usize = 128;

/// Iterations that a well-posed sample never needs: each shrinks the error by the relative noise.
const MOST: usize = 30;

/// An iteration that moves a sample by less than a thousandth of its sigma is the last.
const SETTLED: f32 = 1e-6;

/// Neighbours whose mean guides the weights in the dark: a power of two.
const NEIGHBOURS: usize = 16;

/// Colours that may lie side by side.
const MOST_LIKE: usize = 3;

/// Signal over noise at which a sample's own radiance and its neighbours' count the same.
const OWN: f32 = 6.0;

/// One exposure's samples.
pub(super) struct Exposures {
    /// Exposure time, s, with corrections.
    pub time: f32,
    /// Exposure above black; [`LANES`] samples.
    pub x: [f32; LANES],
    /// Of it what is there without light.
    pub dark: [f32; LANES],
    /// Variance of `dark`.
    pub dark_variance: f32,
}

impl Exposures {
    pub fn new() -> Self {
        Self { time: 1.0, x: [0.0; LANES], dark: [0.0; LANES], dark_variance: 0.0 }
    }
}

/// What came out, [`LANES`] of each.
pub(super) struct Solved {
    pub radiance: [f32; LANES],
    /// Σ t²/V; 0 where nothing was measured.
    pub information: [f32; LANES],
    /// The radiance that the weights are computed for.
    guide: [f32; LANES],
    /// Σ (x − tL)²/V over the exposures that count, and their number less one.
    pub chi2: [f32; LANES],
    pub freedom: [f32; LANES],
}

impl Solved {
    pub fn new() -> Self {
        Self {
            radiance: [0.0; LANES],
            information: [0.0; LANES],
            guide: [0.0; LANES],
            chi2: [0.0; LANES],
            freedom: [0.0; LANES],
        }
    }
}

/// Solves all lanes; samples are clipped from the exposure `clipped` on, `like` lanes further
/// is the next one of the same colour.
#[inline(always)]
pub(super) fn solve<V: VarianceOf>(
    frames: &[Exposures],
    noise: V,
    clipped: f32,
    like: usize,
    out: &mut Solved,
) {
    let sigma_at_edge = noise.variance(clipped).sqrt();
    let sure = clipped - EDGE * sigma_at_edge;
    start(frames, sure, clipped, out);
    out.guide = out.radiance;
    for _ in 0..MOST {
        if iterate(frames, noise, sure, out) < SETTLED {
            break;
        }
        find_guide(like, out);
    }
    // Where some exposure is neither surely clipped nor surely not, its chance to be counts.
    let near = (EDGE + 1.0) * sigma_at_edge;
    let mut undecided = [false; LANES];
    for frame in frames {
        for l in 0..LANES {
            let mean = frame.time * out.radiance[l] + frame.dark[l];
            undecided[l] |= (mean - clipped).abs() < near;
        }
    }
    for l in 0..LANES {
        if undecided[l] {
            solve_censored(frames, noise, clipped, l, out);
        } else if out.information[l] == 0.0 {
            // More than fits into the shortest.
            out.radiance[l] =
                frames.iter().map(|f| (f.x[l] - f.dark[l]) / f.time).fold(0.0, f32::max);
        }
    }
    misfit(frames, noise, sure, out);
}

/// Light over time of the exposures that look unclipped: optimal where only photons make noise.
#[inline(always)]
fn start(frames: &[Exposures], sure: f32, clipped: f32, out: &mut Solved) {
    let mut light = [0.0_f32; LANES];
    let mut time = [0.0_f32; LANES];
    let mut least = [f32::INFINITY; LANES];
    for frame in frames {
        for l in 0..LANES {
            let counts = if frame.x[l] < sure { 1.0 } else { 0.0 };
            light[l] += counts * (frame.x[l] - frame.dark[l]);
            time[l] += counts * frame.time;
            // If none does, the shortest is the one to believe.
            least[l] = least[l].min(frame.time);
        }
    }
    for l in 0..LANES {
        out.radiance[l] = if time[l] > 0.0 { light[l] / time[l] } else { clipped / least[l] };
    }
}

/// One round of weights; returns the largest squared step in units of the variance.
#[inline(always)]
fn iterate<V: VarianceOf>(frames: &[Exposures], noise: V, sure: f32, out: &mut Solved) -> f32 {
    let mut weighted = [0.0_f32; LANES];
    let mut information = [0.0_f32; LANES];
    for frame in frames {
        let t = frame.time;
        for l in 0..LANES {
            let mean = t * out.radiance[l] + frame.dark[l];
            // By what is predicted, not by what the sample says.
            let counts = if mean < sure { t } else { 0.0 };
            let typical = t * out.guide[l] + frame.dark[l];
            let weight = counts / (noise.variance(typical) + frame.dark_variance);
            weighted[l] += weight * (frame.x[l] - frame.dark[l]);
            information[l] += weight * t;
        }
    }
    let mut largest = 0.0_f32;
    for l in 0..LANES {
        let known = information[l] > 0.0;
        let next = weighted[l] / if known { information[l] } else { 1.0 };
        let next = if known { next } else { out.radiance[l] };
        let step = next - out.radiance[l];
        largest = largest.max(step * step * information[l]);
        out.radiance[l] = next;
        out.information[l] = information[l];
    }
    largest
}

/// The radiance that weights are computed for: the sample's own where it is clear of its noise.
#[inline(always)]
fn find_guide(like: usize, out: &mut Solved) {
    let mut dim = 0.0_f32;
    for l in 0..LANES {
        let bright = out.radiance[l].max(0.0).powi(2) * out.information[l];
        dim = dim.max(if bright < 16.0 * OWN * OWN { 1.0 } else { 0.0 });
    }
    out.guide = out.radiance;
    if dim == 0.0 {
        return;
    }
    // Sums of 2, 4, 8 and 16 like neighbours, from half of them before to half of them after.
    let mut sums = [0.0_f32; LANES + NEIGHBOURS * MOST_LIKE];
    let half = NEIGHBOURS / 2 * like;
    for (k, sum) in sums.iter_mut().enumerate() {
        // Beyond the ends the outermost of the same colour.
        let inside = |k: usize| (k - half) < LANES;
        let l = if k < half {
            k % like
        } else if inside(k) {
            k - half
        } else {
            LANES - like + (k - half) % like
        };
        *sum = out.radiance[l.min(LANES - 1)];
    }
    let mut reach = like;
    while reach < NEIGHBOURS * like {
        for k in 0..sums.len() - reach {
            sums[k] += sums[k + reach];
        }
        reach *= 2;
    }
    for l in 0..LANES {
        let around = sums[l] / NEIGHBOURS as f32;
        let clear = around.max(0.0).powi(2) * out.information[l] / (OWN * OWN);
        out.guide[l] = (around + clear * out.radiance[l]) / (1.0 + clear);
    }
}

#[inline(always)]
fn misfit<V: VarianceOf>(frames: &[Exposures], noise: V, sure: f32, out: &mut Solved) {
    out.chi2 = [0.0; LANES];
    out.freedom = [-1.0; LANES];
    for frame in frames {
        for l in 0..LANES {
            let mean = frame.time * out.radiance[l] + frame.dark[l];
            let counts = if mean < sure { 1.0 } else { 0.0 };
            let off = frame.x[l] - mean;
            let typical = frame.time * out.guide[l] + frame.dark[l];
            out.chi2[l] += counts * off * off / (noise.variance(typical) + frame.dark_variance);
            out.freedom[l] += counts;
        }
    }
}

/// Fisher's scoring for one sample with exposures that may or may not be clipped.
fn solve_censored<V: VarianceOf>(
    frames: &[Exposures],
    noise: V,
    clipped: f32,
    l: usize,
    out: &mut Solved,
) {
    if frames.iter().all(|f| f.x[l] >= clipped) {
        out.information[l] = 0.0;
        out.radiance[l] = frames.iter().map(|f| (f.x[l] - f.dark[l]) / f.time).fold(0.0, f32::max);
        return;
    }
    let mut radiance = out.radiance[l];
    let mut information = 0.0;
    for _ in 0..MOST {
        let mut score = 0.0_f32;
        information = 0.0;
        for frame in frames {
            let t = frame.time;
            let mean = t * radiance + frame.dark[l];
            let variance = noise.variance(mean) + frame.dark_variance;
            let room = clipped - mean;
            if room * room >= EDGE * EDGE * variance {
                if room > 0.0 {
                    score += t * (frame.x[l].min(clipped) - mean) / variance;
                    information += t * t / variance;
                }
                continue;
            }
            let sigma = variance.sqrt();
            let (hazard, share) = hazard_and_share(room / sigma);
            information += share * t * t / variance;
            score += if frame.x[l] >= clipped {
                t * hazard / sigma
            } else {
                t * (frame.x[l] - mean) / variance
            };
        }
        if information <= 0.0 {
            break;
        }
        let step = score / information;
        radiance += step;
        if step * step * information < SETTLED {
            break;
        }
    }
    out.radiance[l] = radiance;
    out.information[l] = information;
}
