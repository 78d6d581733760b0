//! Phase shift: projector positions between pixels, from sinusoids.

use crate::photo::Photo;
use crate::structured_light::classify::grey_row;
use crate::structured_light::layout::CodeLayout;

/// Modulation below this many standard deviations of the phase's noise is none.
const LEAST_MODULATION: f64 = 5.0;

/// Replaces the coarse `position` of one row's pixels by the sinusoids' own, with its 1-sigma.
///
/// N pictures I_k = A + B cos(φ − 2πk/N) give φ = atan2(Σ I_k sin(2πk/N), Σ I_k cos(2πk/N))
/// (Srinivasan, Liu & Halioua 1984), which harmonics of the projector's response up to the
/// (N−2)th leave alone. Noise σ of a code becomes σ √(2/N) / B in φ.
pub(crate) fn refine(
    layout: &CodeLayout,
    pictures: &[Photo],
    axis: usize,
    y: usize,
    noise: f64,
    position: &mut [f32],
    sigma: &mut [f32],
) {
    let Some(phase) = layout.phase() else { return };
    let (steps, period) = (phase.steps as f64, phase.period_px as f64);
    let mut sums = vec![[0.0_f64; 2]; position.len()];
    let mut row = vec![0; position.len()];
    let first = layout.phase_at(axis);
    for (k, photo) in pictures.iter().skip(first).take(phase.steps).enumerate() {
        grey_row(photo, y, &mut row);
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / steps).sin_cos();
        for (sum, &value) in sums.iter_mut().zip(&row) {
            sum[0] += f64::from(value) * cos;
            sum[1] += f64::from(value) * sin;
        }
    }
    // Noise of picture minus inverse is √2 times a picture's.
    let noise = noise / 2_f64.sqrt();
    let per_radian = period / std::f64::consts::TAU;
    for ((place, sigma), [cos, sin]) in position.iter_mut().zip(sigma).zip(sums) {
        let modulation = 2.0 / steps * cos.hypot(sin);
        let phase_sigma = noise * (2.0 / steps).sqrt() / modulation;
        if !place.is_finite() || phase_sigma * LEAST_MODULATION > 1.0 || modulation == 0.0 {
            (*place, *sigma) = (f32::NAN, f32::NAN);
            continue;
        }
        let within = sin.atan2(cos) * per_radian;
        let turns = ((f64::from(*place) - within) / period).round();
        *place = (turns * period + within) as f32;
        *sigma = (phase_sigma * per_radian) as f32;
    }
}
