//! Residuals as a cloud and as a histogram.

use super::Shown;
use crate::report::chart::round_step;
use std::fmt::Write;

const SIDE: f64 = 400.0;

/// Residuals of the points that were used, and the spread of one coordinate.
fn used(shown: &Shown<'_>) -> (Vec<[f64; 2]>, f64) {
    let all: Vec<[f64; 2]> =
        shown.points.iter().filter(|r| r.used).map(|r| r.residual_px).collect();
    let squares: f64 = all.iter().flatten().map(|v| v * v).sum();
    let sigma = (squares / (2 * all.len()).max(1) as f64).sqrt().max(1e-12);
    (all, sigma)
}

/// dx against dy, with circles at one, two and three sigmas.
pub(super) fn cloud(shown: &Shown<'_>) -> String {
    let (all, sigma) = used(shown);
    let reach = 4.2 * sigma;
    let scale = SIDE / 2.0 / reach;
    let mut dots = String::new();
    for [dx, dy] in all.iter().filter(|d| d.iter().all(|v| v.abs() <= reach)) {
        let _ = write!(dots, "M{:.1} {:.1}h0", dx * scale, dy * scale);
    }
    let mut rings = String::new();
    for times in 1..=3 {
        let radius = f64::from(times) * sigma * scale;
        let _ = write!(
            rings,
            "<circle class=\"frame\" r=\"{radius:.1}\"/><text class=\"axis\" y=\"{:.1}\">{times}σ</text>",
            -radius - 4.0
        );
    }
    // Few points are drawn large, many small, so that neither vanish nor run together.
    let dot = (60.0 / (all.len().max(1) as f64).sqrt()).clamp(1.2, 4.0);
    format!(
        "<figure><figcaption><b>{}</b>: σ = {sigma:.3} px in one coordinate</figcaption>\
         <svg class=\"map cloud\" viewBox=\"{} {} {SIDE} {SIDE}\" role=\"img\" aria-label=\"residuals as a cloud\" \
         font-size=\"14\"><path class=\"left dots\" stroke-width=\"{dot:.1}\" d=\"{dots}\"/>{rings}</svg></figure>",
        shown.name,
        -SIDE / 2.0,
        -SIDE / 2.0
    )
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 260.0;
const FOOT: f64 = 26.0;
const BINS: usize = 32;

/// Both coordinates in one histogram, with the normal law of the same spread.
pub(super) fn histogram(shown: &Shown<'_>) -> String {
    let (all, sigma) = used(shown);
    let reach = 4.0 * sigma;
    let mut counts = [0usize; BINS];
    for v in all.iter().flatten() {
        let place = (v + reach) / (2.0 * reach) * BINS as f64;
        if let Some(count) = (place >= 0.0).then(|| counts.get_mut(place as usize)).flatten() {
            *count += 1;
        }
    }
    let total = (2 * all.len()).max(1) as f64;
    let bin = 2.0 * reach / BINS as f64;
    let expected =
        |v: f64| total * bin * (-v * v / (2.0 * sigma * sigma)).exp() / (sigma * TAU_ROOT);
    let most = counts.iter().map(|c| *c as f64).fold(expected(0.0), f64::max).max(1.0);
    let x = |v: f64| (v + reach) / (2.0 * reach) * WIDTH;
    let y = |count: f64| (HEIGHT - FOOT) * (1.0 - 0.95 * count / most);
    let mut body = String::new();
    for (i, &count) in counts.iter().enumerate() {
        let top = y(count as f64);
        let _ = write!(
            body,
            "<rect class=\"column\" x=\"{:.1}\" y=\"{top:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
            WIDTH * i as f64 / BINS as f64 + 0.5,
            WIDTH / BINS as f64 - 1.0,
            HEIGHT - FOOT - top
        );
    }
    let law: Vec<String> = (0..=80)
        .map(|i| {
            let v = reach * (f64::from(i) / 40.0 - 1.0);
            format!("{:.1},{:.1}", x(v), y(expected(v)))
        })
        .collect();
    let _ = write!(
        body,
        "<polyline class=\"law\" stroke-width=\"2\" points=\"{}\"/><path class=\"frame\" d=\"M0 {1}H{WIDTH}\"/>",
        law.join(" "),
        HEIGHT - FOOT
    );
    let step = round_step(reach / 3.5);
    for k in -4..=4 {
        let v = f64::from(k) * step;
        if v.abs() < 0.97 * reach {
            let decimals = (-step.log10().floor()).max(0.0) as usize;
            let _ = write!(
                body,
                "<text class=\"axis\" x=\"{:.1}\" y=\"{}\">{v:.decimals$}</text>",
                x(v),
                HEIGHT - 6.0
            );
        }
    }
    let beyond = all.iter().flatten().filter(|v| v.abs() > 3.0 * sigma).count();
    let share = 100.0 * beyond as f64 / total;
    format!(
        "<figure><figcaption><b>{}</b>, pixels: {share:.2} % beyond 3σ (0.27 % if normal)</figcaption>\
         <svg class=\"map\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"histogram of the \
         residuals\" font-size=\"14\">{body}</svg></figure>",
        shown.name
    )
}

/// √(2π).
const TAU_ROOT: f64 = 2.506_628_274_631_000_2;
