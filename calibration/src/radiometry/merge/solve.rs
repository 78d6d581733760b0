//! The radiance of many samples at once, by iterated weights.
//!
//! The radiance L of a sample solves Σ tᵢ (xᵢ − tᵢ L)/V(tᵢ L) = 0, the quasi-likelihood
//! equation (Wedderburn 1974) for samples of mean tᵢ L and a variance V that depends on the
//! mean. With weights from the common L, not from each sample's own noisy value, every term has
//! mean zero, and the bias of second order vanishes too: the covariance of the score with its
//! slope and the score's mean curvature cancel. A clipped sample enters with the censored
//! normal's score (`censored`). The inverse of the observed information is the variance.
//!
//! Where a sample is hardly above its noise, even the common L makes poor weights; there they
//! come from the mean of neighbours, whose error costs a little variance but biases nothing.

use super::censored::{EDGE, hazard};
use super::sensor::{MultiplyAdd, VarianceOf};

/// Samples that are worked on side by side: a multiple of every vector register's width, few
/// enough for sixteen frames of them to stay in the first cache.
pub(super) const LANES: usize = 128;

/// Iterations at most: each shrinks the error of the weights by the relative noise.
const MOST: usize = 10;

/// An iteration is the last when what it leaves is below half a hundredth of a sample's sigma:
/// its step, times the relative noise once more.
const SETTLED: f32 = 2.5e-5;

/// The variance of a curved response is looked up anew when a sample has moved by more than two
/// steps of the table: weights that are wrong by w cost the share w² of the information.
const STEP_OF_TABLE: f32 = 0.04;

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
    /// Variance of each sample without the photons' and that of `dark`.
    constant: [f32; LANES],
    clipped: Clipped,
}

/// How many samples of a block an exposure clips.
#[derive(Clone, Copy, PartialEq)]
enum Clipped {
    None,
    Some,
    All,
}

impl Exposures {
    pub fn new() -> Self {
        Self {
            time: 1.0,
            x: [0.0; LANES],
            dark: [0.0; LANES],
            dark_variance: 0.0,
            constant: [0.0; LANES],
            clipped: Clipped::None,
        }
    }
}

/// What came out, [`LANES`] of each.
pub(super) struct Solved {
    pub radiance: [f32; LANES],
    /// Σ t²/V; 0 where nothing was measured.
    pub information: [f32; LANES],
    /// Σ (x − tL)²/V over the exposures that are not clipped, and their number less one.
    pub chi2: [f32; LANES],
    pub freedom: [f32; LANES],
    /// The radiance that the weights are computed for.
    guide: [f32; LANES],
    /// The one that the variances of a curved response were looked up for.
    looked_up: [f32; LANES],
}

impl Solved {
    pub fn new() -> Self {
        let zero = [0.0; LANES];
        let (radiance, information, chi2, freedom) = (zero, zero, zero, zero);
        Self { radiance, information, chi2, freedom, guide: zero, looked_up: zero }
    }
}

/// Solves all lanes; samples are clipped from the exposure `clipped` on, `like` lanes further
/// is the next one of the same colour.
#[inline(always)]
pub(super) fn solve<V: VarianceOf, F: MultiplyAdd>(
    frames: &mut [Exposures],
    noise: V,
    clipped: f32,
    like: usize,
    out: &mut Solved,
) {
    start(frames, clipped, out);
    out.guide = out.radiance;
    for round in 0..MOST {
        if !V::EVEN && (round == 0 || has_moved(out)) {
            look_up(frames, noise, out);
        }
        if iterate::<V, F>(frames, noise, clipped, out) {
            break;
        }
        find_guide(like, out);
    }
}

/// Light over time of the exposures that are not clipped: optimal where only photons make noise.
#[inline(always)]
fn start(frames: &mut [Exposures], clipped: f32, out: &mut Solved) {
    let mut light = [0.0_f32; LANES];
    let mut time = [0.0_f32; LANES];
    let mut at_least = [0.0_f32; LANES];
    out.freedom = [-1.0; LANES];
    for frame in frames {
        let per_time = 1.0 / frame.time;
        let mut open = 0_u32;
        frame.x.iter().for_each(|x| open += u32::from(*x < clipped));
        if open == LANES as u32 {
            frame.clipped = Clipped::None;
            for l in 0..LANES {
                light[l] += frame.x[l] - frame.dark[l];
                time[l] += frame.time;
                out.freedom[l] += 1.0;
            }
            continue;
        }
        frame.clipped = if open == 0 { Clipped::All } else { Clipped::Some };
        for l in 0..LANES {
            let counts = if frame.x[l] < clipped { 1.0 } else { 0.0 };
            let seen = frame.x[l] - frame.dark[l];
            light[l] += counts * seen;
            time[l] += counts * frame.time;
            out.freedom[l] += counts;
            at_least[l] = at_least[l].max((1.0 - counts) * seen * per_time);
        }
    }
    for l in 0..LANES {
        let measured = time[l] > 0.0;
        // Not below what the clipped ones say.
        let mean = (light[l] / time[l]).max(0.99 * at_least[l].min(f32::MAX));
        out.radiance[l] = if measured { mean } else { at_least[l] };
    }
}

/// Whether the guide of any sample is a step of the table away from where it was looked up.
#[inline(always)]
fn has_moved(out: &Solved) -> bool {
    let mut moved = 0_u32;
    for l in 0..LANES {
        let off = (out.guide[l] - out.looked_up[l]).abs();
        moved += u32::from(off > STEP_OF_TABLE * out.looked_up[l].abs());
    }
    moved > 0
}

/// The variance that does not come from photons.
#[inline(always)]
fn look_up<V: VarianceOf>(frames: &mut [Exposures], noise: V, out: &mut Solved) {
    out.looked_up = out.guide;
    for frame in frames.iter_mut().filter(|f| f.clipped != Clipped::All) {
        let mut typical = out.guide;
        typical.iter_mut().zip(&frame.dark).for_each(|(e, dark)| *e = frame.time * *e + dark);
        noise.constants(&typical, &mut frame.constant);
    }
}

/// One round of weights; returns whether every sample has settled.
///
/// Sums are over residuals r = x − tL at the radiance so far: the step is Σ w r / Σ w t with
/// w = t/V, and after it the misfit Σ r²/V is smaller by (Σ w r)²/Σ w t, so that no second look
/// at the samples is needed.
#[inline(always)]
fn iterate<V: VarianceOf, F: MultiplyAdd>(
    frames: &[Exposures],
    noise: V,
    clipped: f32,
    out: &mut Solved,
) -> bool {
    let zero = [0.0_f32; LANES];
    let (mut score, mut information) = (zero, zero);
    let (mut censored_score, mut censored) = (zero, zero);
    out.chi2 = zero;
    let sigma = noise.variance(clipped).sqrt();
    for frame in frames {
        let t = frame.time;
        if frame.clipped != Clipped::None {
            let sums = (&mut censored_score, &mut censored);
            add_clipped(frame, noise, clipped, sigma, &out.radiance, sums);
        }
        if frame.clipped == Clipped::All {
            continue;
        }
        let even = noise.constant(0.0);
        for l in 0..LANES {
            let typical = F::add(t, out.guide[l], frame.dark[l]);
            let constant = if V::EVEN { even } else { frame.constant[l] } + frame.dark_variance;
            let precision = 1.0 / noise.with_photons::<F>(constant, typical);
            let precision = if frame.x[l] < clipped { precision } else { 0.0 };
            let residual = frame.x[l] - F::add(t, out.radiance[l], frame.dark[l]);
            let weighted = precision * residual;
            score[l] = F::add(t, weighted, score[l]);
            information[l] = F::add(t * t, precision, information[l]);
            out.chi2[l] = F::add(weighted, residual, out.chi2[l]);
        }
    }
    let mut moving = 0_u32;
    for l in 0..LANES {
        // Exposures that are all clipped bound the radiance on one side only.
        let known = if out.freedom[l] >= 0.0 { 1.0 } else { 0.0 };
        let both = information[l] + censored[l];
        let step = if known > 0.0 { (score[l] + censored_score[l]) / both } else { 0.0 };
        let next = out.radiance[l] + step;
        // Σ (r − tδ)²/V = Σ r²/V − 2δ Σ w r + δ² Σ w t.
        let smaller = out.chi2[l] - step * (2.0 * score[l] - step * information[l]);
        out.chi2[l] = known * smaller.max(0.0);
        // Signal over noise, squared, where it is above one.
        let clear = (next * next * both).max(1.0);
        moving += u32::from(step * step * both > SETTLED * clear);
        out.radiance[l] = next;
        out.information[l] = known * both;
    }
    moving == 0
}

/// Newton's step for the clipped samples of an exposure: score h/σ, information h (h − a)/V.
#[inline(always)]
fn add_clipped<V: VarianceOf>(
    frame: &Exposures,
    noise: V,
    clipped: f32,
    sigma: f32,
    radiance: &[f32; LANES],
    (scores, information): (&mut [f32; LANES], &mut [f32; LANES]),
) {
    let t = frame.time;
    // Far above clipping a sample is clipped anyway, which says nothing.
    let certain = clipped + EDGE * sigma;
    let near = |l: usize| (frame.x[l] >= clipped) & (t * radiance[l] + frame.dark[l] < certain);
    let mut some = 0_u32;
    for l in 0..LANES {
        some += u32::from(near(l));
    }
    if some == 0 {
        return;
    }
    for l in (0..LANES).filter(|l| near(*l)) {
        let mean = t * radiance[l] + frame.dark[l];
        let variance = noise.variance(mean) + frame.dark_variance;
        let sigma = variance.sqrt();
        let a = (clipped - mean) / sigma;
        let (score, slope) = if a < EDGE {
            let h = hazard(a);
            (t * h / sigma, h * (h - a) * t * t / variance)
        } else {
            // Clipped against all odds: what it says is where clipping begins.
            (t * a / sigma, t * t / variance)
        };
        scores[l] += score;
        information[l] += slope;
    }
}

/// The radiance that weights are computed for: the sample's own where it is clear of its noise.
#[inline(always)]
fn find_guide(like: usize, out: &mut Solved) {
    let mut dim = 0_u32;
    for l in 0..LANES {
        let clear = out.radiance[l].max(0.0).powi(2) * out.information[l];
        dim += u32::from((clear < 16.0 * OWN * OWN) & (out.freedom[l] >= 0.0));
    }
    out.guide = out.radiance;
    if dim == 0 {
        return;
    }
    // Sums of 2, 4, 8 and 16 like neighbours, from half of them before to half of them after;
    // beyond the ends stands the outermost of the same colour.
    let mut sums = [0.0_f32; LANES + NEIGHBOURS * MOST_LIKE];
    let before = NEIGHBOURS / 2 * like;
    sums[before..before + LANES].copy_from_slice(&out.radiance);
    for k in 0..before {
        sums[k] = out.radiance[k % like];
        sums[before + LANES + k] = out.radiance[LANES - like + k % like];
    }
    let mut reach = like;
    while reach < NEIGHBOURS * like {
        for k in 0..LANES + NEIGHBOURS * like - reach {
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
