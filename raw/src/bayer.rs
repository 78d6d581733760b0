//! The order of colours on a sensor.

use crate::RawError;

/// Which colours the upper left 2 × 2 pixels of a Bayer sensor see, row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bayer {
    /// Red green, green blue.
    Rggb,
    /// Blue green, green red.
    Bggr,
    /// Green red, blue green.
    Grbg,
    /// Green blue, red green.
    Gbrg,
}

impl Bayer {
    /// Reads `rggb`, `bggr`, `grbg` or `gbrg`, in capitals or not.
    ///
    /// # Errors
    /// Any other text.
    pub fn parse(text: &str) -> Result<Self, RawError> {
        match text.to_ascii_lowercase().as_str() {
            "rggb" => Ok(Self::Rggb),
            "bggr" => Ok(Self::Bggr),
            "grbg" => Ok(Self::Grbg),
            "gbrg" => Ok(Self::Gbrg),
            _ => Err(RawError::BadPattern { found: text.into() }),
        }
    }

    /// Where red, both greens and blue are in a quad of 2 × 2 pixels, counted row by row.
    pub fn places(self) -> [usize; 4] {
        match self {
            Self::Rggb => [0, 1, 2, 3],
            Self::Bggr => [3, 1, 2, 0],
            Self::Grbg => [1, 0, 3, 2],
            Self::Gbrg => [2, 0, 3, 1],
        }
    }
}
