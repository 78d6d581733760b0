//! Which picture of a code sequence shows what.

use std::path::Path;

use rayon::prelude::*;

use crate::error::{CalibrationError, Result};
use crate::photo::{Photo, list_pictures};

/// A code sequence: what each of its pictures shows, in the order in which they are taken.
///
/// Gray code of the columns, the most significant bit first and each bit followed by its inverse;
/// the rows in the same way; white; black. Where a phase shift refines the code, its steps follow:
/// of the columns, then of the rows. Without phase shift this is the order of OpenCV's
/// `GrayCodePattern` and of the scanners that are built on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CodeLayout {
    /// Columns and rows of the projector.
    pub projector: [usize; 2],
    /// Stripes of the finest bit are this many projector pixels wide, as a power of two.
    finest_bit: u32,
    phase: Option<PhaseShift>,
    /// The camera sees the lit surface from behind, so that its picture is mirrored.
    pub back_lit: bool,
}

/// Sinusoids that refine a Gray code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhaseShift {
    /// Projector pixels a period.
    pub period_px: usize,
    /// Pictures an axis, each moved by one `steps`-th of a period; at least 3.
    pub steps: usize,
}

/// What one picture of a sequence shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodePicture {
    /// A bit of the Gray code of columns (axis 0) or rows (axis 1), 0 being the finest.
    Bit {
        /// 0: columns, 1: rows.
        axis: usize,
        /// Which bit of the Gray code; 0 changes most often.
        bit: u32,
        /// Whether light and dark are exchanged.
        inverse: bool,
    },
    /// All light.
    White,
    /// None.
    Black,
    /// 1/2 + 1/2 cos(2π (c / period − step / steps)) at column or row c.
    Phase {
        /// 0: columns, 1: rows.
        axis: usize,
        /// Which step.
        step: usize,
    },
}

impl CodeLayout {
    /// Gray code down to single projector pixels, for a projector of `[columns, rows]`.
    pub fn gray_code(projector: [usize; 2]) -> Self {
        Self { projector, finest_bit: 0, phase: None, back_lit: false }
    }

    /// Gray code down to a quarter of a period or finer, and `steps` sinusoids an axis.
    ///
    /// # Errors
    /// Fewer than 3 steps, or a period of less than 4 pixels.
    pub fn phase_shift(projector: [usize; 2], period_px: usize, steps: usize) -> Result<Self> {
        if steps < 3 || period_px < 4 {
            return Err(CalibrationError::BadInput {
                what: "phase shift".into(),
                expected: "at least 3 steps and a period of at least 4 projector pixels".into(),
                found: format!("{steps} steps, {period_px} px"),
            });
        }
        // The code may be a stripe off at its edges; a quarter of a period leaves no doubt.
        let finest_bit = (period_px / 4).ilog2();
        let phase = Some(PhaseShift { period_px, steps });
        Ok(Self { projector, finest_bit, phase, back_lit: false })
    }

    /// The same sequence on a sheet that is lit from behind.
    pub fn lit_from_behind(self) -> Self {
        Self { back_lit: true, ..self }
    }

    /// The sinusoids, if there are any.
    pub fn phase(&self) -> Option<PhaseShift> {
        self.phase
    }

    /// Width of the finest Gray code stripe, projector pixels.
    pub fn stripe_px(&self) -> usize {
        1 << self.finest_bit
    }

    /// Bits of an axis' Gray code.
    pub fn bits(&self, axis: usize) -> u32 {
        let positions = self.projector[axis].div_ceil(self.stripe_px());
        positions.max(2).next_power_of_two().ilog2()
    }

    /// Pictures of the whole sequence.
    pub fn pictures(&self) -> usize {
        self.bit_pictures() + 2 + self.phase.map_or(0, |p| 2 * p.steps)
    }

    fn bit_pictures(&self) -> usize {
        2 * (self.bits(0) + self.bits(1)) as usize
    }

    /// The sequence, in order.
    pub fn sequence(&self) -> Vec<CodePicture> {
        let mut out = Vec::with_capacity(self.pictures());
        for axis in 0..2 {
            for bit in (0..self.bits(axis)).rev() {
                out.extend([false, true].map(|inverse| CodePicture::Bit { axis, bit, inverse }));
            }
        }
        out.extend([CodePicture::White, CodePicture::Black]);
        let steps = self.phase.map_or(0, |p| p.steps);
        out.extend(
            (0..2).flat_map(|axis| (0..steps).map(move |step| CodePicture::Phase { axis, step })),
        );
        out
    }

    /// Place in the sequence of a bit's picture; its inverse follows.
    pub(crate) fn bit_at(&self, axis: usize, bit: u32) -> usize {
        let before = if axis == 0 { 0 } else { 2 * self.bits(0) };
        (before + 2 * (self.bits(axis) - 1 - bit)) as usize
    }

    /// Places in the sequence of white and black.
    pub(crate) fn white_black_at(&self) -> [usize; 2] {
        [self.bit_pictures(), self.bit_pictures() + 1]
    }

    /// Place in the sequence of an axis' first sinusoid.
    pub(crate) fn phase_at(&self, axis: usize) -> usize {
        self.bit_pictures() + 2 + axis * self.phase.map_or(0, |p| p.steps)
    }

    /// Level, 0 to 1, of the projector pixel at `position` along the picture's axis.
    pub fn level(&self, picture: CodePicture, position: usize) -> f64 {
        match picture {
            CodePicture::White => 1.0,
            CodePicture::Black => 0.0,
            CodePicture::Bit { bit, inverse, .. } => {
                let stripe = position >> self.finest_bit;
                let lit = ((stripe ^ (stripe >> 1)) >> bit) & 1 == 1;
                f64::from(u8::from(lit != inverse))
            }
            CodePicture::Phase { step, .. } => {
                let Some(PhaseShift { period_px, steps }) = self.phase else { return 0.0 };
                let turns = position as f64 / period_px as f64 - step as f64 / steps as f64;
                0.5 + 0.5 * (std::f64::consts::TAU * turns).cos()
            }
        }
    }

    /// The pictures of a folder, by name, as this sequence.
    ///
    /// # Errors
    /// The folder does not hold exactly the sequence's number of pictures; the message names the
    /// first gap in the files' numbers. A picture that cannot be read.
    pub fn load(&self, folder: impl AsRef<Path>) -> Result<Vec<Photo>> {
        let folder = folder.as_ref();
        let paths = list_pictures(folder)?;
        if paths.len() != self.pictures() {
            let names = paths.iter().filter_map(|p| Some(p.file_stem()?.to_string_lossy()));
            let numbers: Vec<u64> = names.filter_map(|name| trailing_number(&name)).collect();
            let gap = numbers.windows(2).find(|pair| pair[1] > pair[0] + 1);
            return Err(CalibrationError::CodeSequence {
                picture: folder.display().to_string(),
                reason: format!(
                    "expected {} pictures, found {}{}",
                    self.pictures(),
                    paths.len(),
                    gap.map_or(String::new(), |g| format!("; number {} is missing", g[0] + 1))
                ),
            });
        }
        paths.into_par_iter().map(Photo::load).collect()
    }
}

/// The number that a name ends with.
fn trailing_number(name: &str) -> Option<u64> {
    let digits = name.len() - name.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    name.get(name.len() - digits..)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_order() {
        let layout = CodeLayout::gray_code([1024, 768]);
        assert_eq!(layout.pictures(), 42);
        let sequence = layout.sequence();
        assert_eq!(sequence.len(), 42);
        assert_eq!(sequence[0], CodePicture::Bit { axis: 0, bit: 9, inverse: false });
        assert_eq!(sequence[39], CodePicture::Bit { axis: 1, bit: 0, inverse: true });
        assert_eq!(sequence[40..], [CodePicture::White, CodePicture::Black]);
        // The coarsest column bit is dark on the left half, light on the right.
        assert_eq!([511, 512].map(|c| layout.level(sequence[0], c)), [0.0, 1.0]);
        for axis in 0..2 {
            for bit in 0..10 {
                let at = layout.bit_at(axis, bit);
                assert_eq!(sequence[at], CodePicture::Bit { axis, bit, inverse: false });
            }
        }
        let fine = CodeLayout::phase_shift([1000, 700], 32, 4).unwrap();
        assert_eq!(fine.stripe_px(), 8);
        // 125 and 88 stripes: seven bits each.
        assert_eq!(fine.pictures(), 2 * 14 + 2 + 8);
        let at = fine.phase_at(1) + 3;
        assert_eq!(fine.sequence()[at], CodePicture::Phase { axis: 1, step: 3 });
        assert!(CodeLayout::phase_shift([1000, 700], 32, 2).is_err());
    }

    /// What makes it a Gray code: neighbours differ in one bit.
    #[test]
    fn neighbours_differ_in_one_bit() {
        let layout = CodeLayout::gray_code([200, 100]);
        let sequence = layout.sequence();
        let columns =
            |c| -> Vec<f64> { sequence[..16].iter().map(|&p| layout.level(p, c)).collect() };
        for c in 0..199 {
            let (a, b) = (columns(c), columns(c + 1));
            // The bit and its inverse.
            assert_eq!(a.iter().zip(&b).filter(|(a, b)| a != b).count(), 2, "{c}");
        }
    }

    #[test]
    fn a_gap_in_the_numbers_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let layout = CodeLayout::gray_code([4, 4]);
        for i in (0..10).filter(|i| *i != 6) {
            image::GrayImage::new(4, 4)
                .save(folder.path().join(format!("code_{i:02}.png")))
                .unwrap();
        }
        let message = layout.load(folder.path()).unwrap_err().to_string();
        assert!(message.contains("expected 10") && message.contains("number 6"), "{message}");
    }
}
