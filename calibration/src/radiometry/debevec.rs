//! Recovering the response from a bracket: Debevec & Malik (1997), made monotone.
//!
//! g(Z) = ln E + ln t for every pixel that several exposures saw. E is eliminated pixel by
//! pixel (it enters linearly), which leaves a quadratic form in the 256 knots of g however many
//! pixels are used. The unknowns are the increments of g from knot to knot, held above a
//! positive floor, so that no noise can make the curve flat or falling. The smoothness term is
//! the curvature of g over ln(code), zero for every power law: linear sensors and gamma curves
//! are not bent. Its weight is chosen by cross-validation between two halves of the pixels.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::radiometry::bounded::least_quadratic;
use crate::radiometry::brightness::{Brightness, check_brightness};
use crate::radiometry::knots::{curvature, from_increments, in_increments, turns};
use crate::radiometry::response::{KNOTS, Response};
use crate::radiometry::sights::{Pixels, Sight, look};

/// Smallest rise of g = ln exposure from one knot to the next: an eighth of what a linear sensor
/// has from one code to the next at full scale.
const SMALLEST_RISE: f64 = 1.0 / (8.0 * 255.0);

/// Decades of smoothness that are tried, times four.
const LEAST_SMOOTH: i32 = -32;
const MOST_SMOOTH: i32 = 16;

/// Factor by which the error of held-out pixels has to fall for a less smooth curve.
///
/// Where all times are powers of one ratio r, any ripple of period ln r over ln exposure fits
/// every pixel, held out or not, and cross-validation would drive the curve to stairs. There a
/// curve may not turn more often than a toe and a shoulder make it: its local gamma rises and
/// falls at most twice. Uneven times tell the ripple apart.
const WORTHWHILE: f64 = 1.0005;

/// Held-out pixels this much worse than at their best: smoothness is far too small.
const TOO_ROUGH: f64 = 1.1;

/// A curve that departs from the straight line by less than this (ln exposure, RMS) is one too:
/// sensors keep to it within half a percent, and rounding in the dark adds as much.
const STRAIGHT: f64 = 0.01;

/// Knots below this one are extrapolated where the black level is known: the fit is linear in
/// ln exposure between knots, which is off by 1/(8 k²), here 0.2 %.
const FIRST_TRUSTED: usize = 8;

/// Fits after the first, with its outliers weighed down.
const ROBUST_ROUNDS: usize = 3;

/// Recovers the response from a bracket: pictures of one still scene with exposure times (s).
/// Where no channel's curve departs from a straight line by a hundredth, as with raw pictures, it
/// is the identity.
///
/// # Errors
/// Fewer than two pictures, times that are not positive or do not differ by at least 5 %,
/// pictures of different shapes, or a channel in which no pixel is usable in two exposures.
pub fn recover_response(bracket: &[(Photo, f64)]) -> Result<Response> {
    let first = check_bracket(bracket)?;
    let channels = (0..first.channels).into_par_iter();
    let curves: Vec<_> = channels.map(|channel| recover_channel(bracket, channel)).collect();
    response_of(curves.into_iter().collect::<Result<_>>()?)
}

/// As [`recover_response`] for a camera whose code without light is known, `black_code` DN.
///
/// What lies under the black level is no light, so the curve is sought over codes above black,
/// where it starts from zero; close to black, where logarithms say little, it goes on as the
/// parabola through zero that fits the next knots. The curve that is returned is over the
/// camera's own codes, and its value at black is what a merge has to subtract.
///
/// # Errors
/// As [`recover_response`], or a black level outside of the lower half of the range.
pub fn recover_response_above(bracket: &[(Photo, f64)], black_code: f64) -> Result<Response> {
    let first = check_bracket(bracket)?;
    let full = f64::from(first.max_value);
    if !(0.0..0.5 * full).contains(&black_code) {
        return Err(CalibrationError::BadInput {
            what: "black level".into(),
            expected: format!("a code from 0 to {}", 0.5 * full),
            found: black_code.to_string(),
        });
    }
    let black = black_code.round() as u16;
    let above = |(photo, time): &(Photo, f64)| {
        let data = photo.data.iter().map(|v| v.saturating_sub(black)).collect();
        (Photo { data, ..photo.without_codes() }, *time)
    };
    let shifted: Vec<(Photo, f64)> = bracket.iter().map(above).collect();
    let offset = f64::from(black) / full * (KNOTS - 1) as f64;
    let channels = (0..first.channels).into_par_iter();
    let curves: Vec<_> = channels
        .map(|channel| {
            let curve = recover_channel(&shifted, channel)?;
            Ok(curve.map(|mut curve| {
                start_from_zero(&mut curve, first_seen(&shifted, channel));
                over_own_codes(&curve, offset)
            }))
        })
        .collect();
    response_of(curves.into_iter().collect::<Result<_>>()?)
}

/// One response of all channels; a straight one beside curved ones is a line through zero.
fn response_of(curves: Vec<Option<Vec<f64>>>) -> Result<Response> {
    if curves.iter().all(Option::is_none) {
        return Ok(Response::identity(curves.len()));
    }
    let line = || (0..KNOTS).map(|k| k as f64).collect();
    Response::from_exposures(curves.into_iter().map(|c| c.unwrap_or_else(line)).collect())
}

/// The first knot from [`FIRST_TRUSTED`] on that pictures have something to say about: a
/// hundredth of the darkest picture's pixels is darker.
fn first_seen(bracket: &[(Photo, f64)], channel: usize) -> usize {
    let darkest = bracket.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((photo, _)) = darkest else { return FIRST_TRUSTED };
    let mut codes: Vec<u16> =
        photo.data.iter().skip(channel).step_by(photo.channels).copied().collect();
    let place = codes.len() / 100;
    let code = *codes.select_nth_unstable(place).1;
    let knot = usize::from(code) * (KNOTS - 1) / usize::from(photo.max_value) + 2;
    // Beyond an eighth of the range no parabola through zero stands for a response.
    knot.clamp(FIRST_TRUSTED, KNOTS / 8)
}

/// Replaces the knots below `first` by a z + b z², fitted to twice as many knots above it.
fn start_from_zero(curve: &mut [f64], first: usize) {
    // Least squares of curve/z = a + b z over the next knots: weights 1/z², relative errors.
    let knots = first..3 * first;
    let n = knots.len() as f64;
    let points = knots.map(|k| (k as f64, curve[k] / k as f64));
    let (mut sz, mut sy, mut szz, mut szy) = (0.0, 0.0, 0.0, 0.0);
    for (z, y) in points {
        (sz, sy, szz, szy) = (sz + z, sy + y, szz + z * z, szy + z * y);
    }
    let b = (n * szy - sz * sy) / (n * szz - sz * sz);
    let a = (sy - b * sz) / n;
    // Only a curve that rises from zero on can be meant.
    let rises = a > 0.0 && a + 2.0 * b * first as f64 > 0.0;
    let (a, b) = if rises { (a, b) } else { (sy / n, 0.0) };
    for (k, value) in curve.iter_mut().enumerate().take(first) {
        *value = a * k as f64 + b * (k * k) as f64;
    }
}

/// A curve over codes above black, resampled to knots of the camera's own codes; `offset` is the
/// black level in knots. Exposures below black go on with the first slope, and all are lifted so
/// that the lowest is zero.
fn over_own_codes(curve: &[f64], offset: f64) -> Vec<f64> {
    let last = curve.len() - 2;
    let at = |z: f64| {
        let k = (z.floor().max(0.0) as usize).min(last);
        curve[k] + (curve[k + 1] - curve[k]) * (z - k as f64)
    };
    let lowest = at(-offset);
    (0..curve.len()).map(|k| at(k as f64 - offset) - lowest).collect()
}

/// Whether all times are powers of one ratio, to a twentieth of a step.
fn is_even(times: impl Iterator<Item = f64>) -> bool {
    let mut logs: Vec<f64> = times.map(f64::ln).collect();
    logs.sort_by(f64::total_cmp);
    let steps: Vec<f64> = logs.windows(2).map(|w| w[1] - w[0]).filter(|s| *s > 0.05).collect();
    let smallest = steps.iter().copied().fold(f64::INFINITY, f64::min);
    steps.iter().all(|s| (s / smallest - (s / smallest).round()).abs() < 0.05)
}

fn check_bracket(bracket: &[(Photo, f64)]) -> Result<&Photo> {
    let bad = |expected, found| CalibrationError::BadBracket { expected, found };
    let [(first, _), _, ..] = bracket else {
        let found = format!("{} picture(s)", bracket.len());
        return Err(bad("at least two pictures with different exposure times", found));
    };
    for (photo, time) in bracket {
        photo.check()?;
        if photo.shape() != first.shape() {
            return Err(CalibrationError::Mismatch {
                picture: photo.name.clone(),
                expected: format!("{} as in {}", first.shape(), first.name),
                found: photo.shape(),
            });
        }
        if !(time.is_finite() && *time > 0.0) {
            return Err(bad("positive exposure times", format!("{time} s for {}", photo.name)));
        }
    }
    let times = bracket.iter().map(|(_, t)| *t);
    let (least, most) =
        times.fold((f64::INFINITY, 0.0_f64), |(low, high), t| (low.min(t), high.max(t)));
    if most < 1.05 * least {
        let found = format!("{} pictures of {least} to {most} s", bracket.len());
        return Err(bad("exposure times that differ by at least 5 %", found));
    }
    let all: Vec<Brightness> = bracket.iter().map(|(p, t)| Brightness::of(p, *t)).collect();
    check_brightness(&all)?;
    Ok(first)
}

/// Half of a least-squares problem in the increments d: ½ dᵀ H d − bᵀ d + ½ c.
struct Half {
    h: DMatrix<f64>,
    b: DVector<f64>,
    c: f64,
    weight: f64,
}

impl Half {
    fn mean_square(&self, d: &DVector<f64>) -> f64 {
        (d.dot(&(&self.h * d)) - 2.0 * self.b.dot(d) + self.c) / self.weight.max(1e-300)
    }
}

/// The exposure of each code, or None if that is the code itself, within the noise.
fn recover_channel(bracket: &[(Photo, f64)], channel: usize) -> Result<Option<Vec<f64>>> {
    let mut pixels = look(bracket, channel);
    if pixels.len() < 2 {
        return Err(CalibrationError::BadBracket {
            expected: "pixels that two exposures see between black and white",
            found: format!("{} in channel {channel}", pixels.len()),
        });
    }
    let even = is_even(bracket.iter().map(|(_, time)| *time));
    let mut fit = fit_curve(&pixels, even, MOST_SMOOTH)?;
    for _ in 0..ROBUST_ROUNDS {
        reweigh(&mut pixels, &fit.curve);
        // The smoothness hardly changes any more: a decade more is where to look from.
        fit = fit_curve(&pixels, even, (fit.power + 4).min(MOST_SMOOTH))?;
    }
    if departure(&fit.curve) < STRAIGHT {
        return Ok(None);
    }
    Ok(Some(fit.curve.into_iter().map(f64::exp).collect()))
}

/// RMS difference between a curve and a straight line, in ln exposure, from a tenth of the range
/// to nine tenths: below, rounding to whole codes bends logarithms.
fn departure(curve: &[f64]) -> f64 {
    let inside = KNOTS / 10..KNOTS - KNOTS / 10;
    let n = inside.len() as f64;
    let off: Vec<f64> = inside.map(|k| curve[k] - (k as f64).ln()).collect();
    let mean = off.iter().sum::<f64>() / n;
    (off.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// A curve, ln exposure of each code.
struct Fit {
    curve: Vec<f64>,
    /// Its smoothness, in quarters of a decade.
    power: i32,
}

/// g at all codes, g(0) = 0, with the smoothness that cross-validation allows.
fn fit_curve(pixels: &Pixels, even: bool, from: i32) -> Result<Fit> {
    let (one, two) = rayon::join(|| normal_equations(pixels, 0), || normal_equations(pixels, 1));
    let bend = curvature();
    let solve = |h: &DMatrix<f64>, b: &DVector<f64>, weight: f64, smooth: f64| {
        least_quadratic(&(h / weight + &bend * smooth), &(b / weight), SMALLEST_RISE)
    };
    let whole = (&one.h + &two.h, &one.b + &two.b, one.weight + two.weight);
    let mut best: Option<(f64, i32, DVector<f64>)> = None;
    for power in (LEAST_SMOOTH..=from).rev() {
        let smooth = 10_f64.powf(0.25 * f64::from(power));
        let d = solve(&whole.0, &whole.1, whole.2, smooth)?;
        if even && best.is_some() && turns(&d) > 2 {
            break;
        }
        let mut error = 0.0;
        for (fitted, held_out) in [(&one, &two), (&two, &one)] {
            error += held_out.mean_square(&solve(&fitted.h, &fitted.b, fitted.weight, smooth)?);
        }
        // Below the best smoothness held-out pixels only get worse.
        if best.as_ref().is_some_and(|(least, ..)| error > TOO_ROUGH * least) {
            break;
        }
        // Nothing is gained by less smoothness that explains the held-out pixels no better.
        if best.as_ref().is_none_or(|(least, ..)| error * WORTHWHILE < *least) {
            best = Some((error, power, d));
        }
    }
    let (_, power, d) = best.ok_or_else(|| CalibrationError::NotConverged {
        what: "response",
        reason: "no smoothness was tried".into(),
    })?;
    Ok(Fit { curve: from_increments(&d), power })
}

/// Sums over every other pixel: Σ w (g(Z) − ln E − ln t)² with each pixel's best ln E put in.
fn normal_equations(pixels: &Pixels, side: usize) -> Half {
    let (mut h, mut b) = (DMatrix::zeros(KNOTS, KNOTS), DVector::zeros(KNOTS));
    let (mut c, mut all, mut pulls) = (0.0, 0.0, Vec::new());
    for range in pixels.ranges().skip(side).step_by(2) {
        let sights = &pixels.sights[range];
        let (mut total, mut mean_log) = (0.0, 0.0);
        for sight in sights {
            let weight = f64::from(sight.weight);
            (total, mean_log) = (total + weight, mean_log + weight * sight.log_time);
        }
        mean_log /= total;
        all += total;
        // Each sight's own square, less the square of their mean: symmetric, so one half will do.
        pulls.clear();
        for sight in sights {
            let centred = sight.log_time - mean_log;
            let weight = f64::from(sight.weight);
            c += weight * centred * centred;
            let first = pulls.len();
            for (k, share) in sight.knots() {
                b[k] += weight * share * centred;
                pulls.push((k, weight * share));
                pulls[first..]
                    .iter()
                    .for_each(|&(l, pull)| h[(k.max(l), k.min(l))] += share * pull);
            }
        }
        for (i, &(k, pull)) in pulls.iter().enumerate() {
            for &(l, other) in &pulls[..=i] {
                h[(k.max(l), k.min(l))] -= pull * other / total;
            }
        }
    }
    h.fill_upper_triangle_with_lower_triangle();
    let (h, b) = in_increments(&h, &b);
    Half { h, b, c, weight: all }
}

/// Huber's weights (1964) from the residuals under a curve: what moved between the exposures or
/// was smeared by compression pulls with bounded force.
fn reweigh(pixels: &mut Pixels, curve: &[f64]) {
    let exposure = |s: &Sight| s.knots().map(|(k, share)| share * curve[k]).sum::<f64>();
    let mut sizes: Vec<f64> =
        pixels.sights.iter().map(|sight| exposure(sight) - sight.log_time).collect();
    for range in pixels.ranges() {
        let logs = &mut sizes[range.clone()];
        let weights = pixels.sights[range].iter().map(|s| f64::from(s.weight));
        let total: f64 = weights.clone().sum();
        let mean = weights.zip(&*logs).map(|(w, log)| w * log).sum::<f64>() / total;
        logs.iter_mut().for_each(|log| *log = (*log - mean).abs());
    }
    let mut sorted = sizes.clone();
    let middle = sorted.len() / 2;
    // 1.345 sigma keeps 95 % of the efficiency where the noise is normal after all.
    let limit = 1.345 * 1.4826 * *sorted.select_nth_unstable_by(middle, f64::total_cmp).1;
    for (sight, size) in pixels.sights.iter_mut().zip(sizes) {
        sight.weight = sight.trust * (limit / size.max(1e-12)).min(1.0) as f32;
    }
}
