//! Sequences of patterns from which a camera can tell every projector pixel.

use serde::{Deserialize, Serialize};

use crate::{Axis, Pattern};

/// Gray code of the projector's columns and rows, with sinusoids that refine it if wanted.
///
/// The order is the one that decoders expect: columns, the coarsest bit first, each followed by
/// its inverse; rows likewise; white; black; sinusoids over the columns, over the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodeSequence {
    /// Columns and rows of the projector.
    pub projector: [u32; 2],
    /// Sinusoids; the Gray code then stops at stripes of a quarter of their period.
    pub phase: Option<PhaseShift>,
}

/// Sinusoids over the projector's picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseShift {
    /// Projector pixels a period, at least 4.
    pub period_px: u32,
    /// Pictures an axis, at least 3.
    pub steps: u32,
}

impl CodeSequence {
    /// The patterns, in order.
    pub fn patterns(&self) -> Vec<Pattern> {
        let finest = self.phase.map_or(0, |p| (p.period_px / 4).max(1).ilog2());
        let axes = [(Axis::X, self.projector[0]), (Axis::Y, self.projector[1])];
        let mut out = Vec::new();
        for (axis, size) in axes {
            let stripes = size.div_ceil(1 << finest).max(2);
            for bit in (0..stripes.next_power_of_two().ilog2()).rev() {
                let bit = bit + finest;
                out.extend([false, true].map(|inverse| Pattern::GrayCode { axis, bit, inverse }));
            }
        }
        out.extend([Pattern::White, Pattern::Black]);
        if let Some(PhaseShift { period_px, steps }) = self.phase {
            let wave = |axis, step| Pattern::Phase { axis, period_px, step, steps };
            out.extend(axes.iter().flat_map(|&(axis, _)| (0..steps).map(move |s| wave(axis, s))));
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_sequence() {
        let patterns = CodeSequence { projector: [1024, 768], phase: None }.patterns();
        assert_eq!(patterns.len(), 42);
        assert_eq!(patterns[1], Pattern::GrayCode { axis: Axis::X, bit: 9, inverse: true });
        assert_eq!(patterns[38], Pattern::GrayCode { axis: Axis::Y, bit: 0, inverse: false });
        assert_eq!(patterns[40..], [Pattern::White, Pattern::Black]);
        let phase = Some(PhaseShift { period_px: 32, steps: 4 });
        let patterns = CodeSequence { projector: [1024, 768], phase }.patterns();
        // Stripes of 8 pixels: seven bits each.
        assert_eq!(patterns.len(), 28 + 2 + 8);
        assert_eq!(patterns[13], Pattern::GrayCode { axis: Axis::X, bit: 3, inverse: true });
        assert!(patterns.iter().all(|p| p.check().is_ok()));
    }
}
