//! What a sample that may be clipped says about its mean: the censored normal of Tobin (1958).
//!
//! With a = (c − μ)/σ, c where clipping begins: a clipped sample has the score h(a)/σ, h the
//! normal hazard φ/(1 − Φ), and carries the information h (h − a)/σ². Together with the scores of
//! samples that are not clipped that has mean zero, whereas leaving samples out by their own
//! noisy value has not.

use std::sync::LazyLock;

/// Beyond this many sigma on either side a sample is simply in or out: 1 in 740 is wrong there,
/// by a third of a sigma.
pub(super) const EDGE: f32 = 3.0;

const STEPS: usize = 96;

/// The hazard at `STEPS + 1` places from −EDGE to EDGE.
static TABLE: LazyLock<[f32; STEPS + 1]> = LazyLock::new(|| {
    // h' = h (h − a), integrated downwards, where errors die out, from the asymptotic series.
    let width = 2.0 * f64::from(EDGE) / STEPS as f64;
    let mut a = 8.0_f64;
    let mut hazard = a + 1.0 / a - 2.0 / a.powi(3) + 10.0 / a.powi(5);
    let slope = |a: f64, h: f64| h * (h - a);
    let mut down_to = |end: f64| {
        // Fourth-order Runge-Kutta, in steps of at most 1/64.
        let steps = ((a - end) * 64.0).ceil().max(1.0);
        let dt = (end - a) / steps;
        for _ in 0..steps as usize {
            let k1 = slope(a, hazard);
            let k2 = slope(a + 0.5 * dt, hazard + 0.5 * dt * k1);
            let k3 = slope(a + 0.5 * dt, hazard + 0.5 * dt * k2);
            let k4 = slope(a + dt, hazard + dt * k3);
            hazard += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4);
            a += dt;
        }
        a = end;
        hazard
    };
    let mut table = [0.0; STEPS + 1];
    for k in (0..=STEPS).rev() {
        table[k] = down_to(k as f64 * width - f64::from(EDGE)) as f32;
    }
    table
});

/// The normal hazard φ/(1 − Φ) at `a`, which is held within ±[`EDGE`].
pub(super) fn hazard(a: f32) -> f32 {
    let place = ((a + EDGE) * (STEPS as f32 / (2.0 * EDGE))).clamp(0.0, STEPS as f32);
    let k = (place as usize).min(STEPS - 1);
    TABLE[k] + (place - k as f32) * (TABLE[k + 1] - TABLE[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// φ and 1 − Φ from printed tables (Abramowitz & Stegun 1964, table 26.1), five digits.
    #[test]
    fn hazards_are_those_of_the_tables() {
        for (a, density, above) in [
            (0.0, 0.398_942, 0.5),
            (1.0, 0.241_971, 0.158_655),
            (2.0, 0.053_991, 0.022_750),
            (-1.0, 0.241_971, 0.841_345),
            (-2.5, 0.017_528, 0.993_790),
        ] {
            let expected: f64 = density / above;
            // Linear between places 1/16 apart: 5e-4 h''.
            let found = hazard(a as f32);
            assert!((f64::from(found) - expected).abs() < 1e-3, "{a}: {found} {expected}");
        }
    }
}
