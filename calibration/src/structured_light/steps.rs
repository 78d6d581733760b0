//! Edges of Gray code stripes between camera pixels.

use crate::structured_light::decode::{Sample, UNDECIDED};

/// Where, between a pixel and its neighbour, a code steps by one.
///
/// There the bit that changes is as bright as its inverse, whatever the camera's response and the
/// blur: a place that is known much better than to a pixel.
#[derive(Clone, Debug)]
pub(crate) struct StepMap {
    /// To the pixel on the right: 0 for no step, else 1 + 254 times the way to it.
    pub(crate) right: Vec<u8>,
    /// To the pixel below.
    pub(crate) down: Vec<u8>,
}

impl StepMap {
    pub(crate) fn new(pixels: usize) -> Self {
        Self { right: vec![0; pixels], down: vec![0; pixels] }
    }

    /// The way from a pixel to the step, 0 to 1 of the distance to its neighbour.
    pub(crate) fn way(stored: u8) -> Option<f64> {
        (stored > 0).then(|| f64::from(stored - 1) / 254.0)
    }
}

/// The step between two neighbouring pixels, as [`StepMap`] keeps it.
pub(crate) fn step(from: Sample<'_>, to: Sample<'_>) -> u8 {
    if from.code == UNDECIDED || to.code == UNDECIDED || from.code.abs_diff(to.code) != 1 {
        return 0;
    }
    let gray = |code: u16| code ^ (code >> 1);
    let bit = (gray(from.code) ^ gray(to.code)).trailing_zeros();
    let (a, b) = (from.relative_difference(bit), to.relative_difference(bit));
    let way = a / (a - b);
    // Opposite signs, or a bit in doubt that was read the other way.
    if (0.0..=1.0).contains(&way) { 1 + (way * 254.0).round() as u8 } else { 0 }
}
