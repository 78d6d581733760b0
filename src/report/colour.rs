//! Colours of the pictures in a report.
//!
//! The maps are laid out in OKLab (B. Ottosson, "A perceptual color space for image processing",
//! 2020), so that equal steps of a value look like equal steps, also in grey on paper.

use std::f64::consts::TAU;

/// Linear light, 1 being white, to an sRGB code (IEC 61966-2-1).
pub(crate) fn srgb(linear: f64) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}

/// Small values dark violet, large ones light yellow: lightness rises evenly with `t` in 0..1.
pub(crate) fn sequential(t: f64) -> [u8; 3] {
    let t = if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 };
    let hue = (305.0 - 205.0 * t) / 360.0;
    oklch(0.20 + 0.74 * t, 0.11 + 0.05 * t, hue)
}

/// Negative blue, zero nearly white, positive red; `t` in −1..1.
pub(crate) fn diverging(t: f64) -> [u8; 3] {
    let t = if t.is_finite() { t.clamp(-1.0, 1.0) } else { 0.0 };
    let hue = if t < 0.0 { 255.0 } else { 27.0 } / 360.0;
    oklch(0.965 - 0.50 * t.abs(), 0.20 * t.abs(), hue)
}

/// Colours of things that are told apart, as far from each other as their number allows: hues a
/// golden angle apart, neither light nor dark so that they show on both grounds.
pub(crate) fn distinct(i: usize) -> String {
    let turns = (0.08 + 0.381_966 * i as f64).fract();
    css(oklch(if i.is_multiple_of(2) { 0.58 } else { 0.70 }, 0.17, turns))
}

/// The stops of [`sequential`] for a CSS gradient.
pub(crate) fn sequential_stops() -> String {
    let stops: Vec<String> = (0..=24).map(|i| css(sequential(f64::from(i) / 24.0))).collect();
    stops.join(",")
}

fn css([r, g, b]: [u8; 3]) -> String {
    format!("rgb({r},{g},{b})")
}

/// A cell that says nothing.
pub(crate) const MASKED: [u8; 3] = [150, 150, 150];

/// Lightness, chroma and hue (in turns) to sRGB; chroma gives way where sRGB has no such colour.
fn oklch(lightness: f64, mut chroma: f64, hue: f64) -> [u8; 3] {
    let (sin, cos) = (TAU * hue).sin_cos();
    loop {
        let rgb = oklab(lightness, chroma * cos, chroma * sin);
        if chroma < 1e-3 || rgb.iter().all(|v| (-1e-4..=1.0001).contains(v)) {
            return rgb.map(srgb);
        }
        chroma *= 0.96;
    }
}

/// OKLab to linear sRGB.
fn oklab(l: f64, a: f64, b: f64) -> [f64; 3] {
    let cone = [
        l + 0.396_337_777_4 * a + 0.215_803_757_3 * b,
        l - 0.105_561_345_8 * a - 0.063_854_172_8 * b,
        l - 0.089_484_177_5 * a - 1.291_485_548 * b,
    ]
    .map(|v| v * v * v);
    let mix = |w: [f64; 3]| w[0] * cone[0] + w[1] * cone[1] + w[2] * cone[2];
    [
        mix([4.076_741_662_1, -3.307_711_591_3, 0.230_969_929_2]),
        mix([-1.268_438_004_6, 2.609_757_401_1, -0.341_319_396_5]),
        mix([-0.004_196_086_3, -0.703_418_614_7, 1.707_614_701]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Grey of an sRGB colour, linear light.
    fn luminance(rgb: [u8; 3]) -> f64 {
        let linear = |code: u8| {
            let v = f64::from(code) / 255.0;
            if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
        };
        0.2126 * linear(rgb[0]) + 0.7152 * linear(rgb[1]) + 0.0722 * linear(rgb[2])
    }

    /// A print without colour must still order the values; 64 steps, so that rounding to codes
    /// (1 of 255) stays below a step.
    #[test]
    fn larger_values_are_lighter() {
        let greys: Vec<f64> =
            (0..=64).map(|i| luminance(sequential(f64::from(i) / 64.0))).collect();
        assert!(greys.windows(2).all(|w| w[1] > w[0]), "{greys:?}");
    }

    /// White of OKLab is sRGB's: within one code, since its matrices are rounded.
    #[test]
    fn white_is_white() {
        assert!(oklch(1.0, 0.0, 0.0).iter().all(|c| *c >= 254));
        assert!(oklch(0.0, 0.0, 0.0).iter().all(|c| *c == 0));
    }

    #[test]
    fn signs_of_a_difference_are_told_apart() {
        let ([r, _, b], [r2, _, b2]) = (diverging(0.8), diverging(-0.8));
        assert!(r > b && b2 > r2);
        assert!(diverging(0.0).iter().all(|c| *c > 235));
    }
}
