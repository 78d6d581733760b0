//! Which of a lens's numbers are fitted.

use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};

/// How a lens may bend rays, from the simplest to the richest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Distortion {
    /// A pinhole.
    None,
    /// Radial k1.
    K1,
    /// Radial k1 k2: what Zhang (2000) uses.
    K1K2,
    /// Radial k1 k2 and tangential p1 p2.
    K1K2P1P2,
    /// Radial k1 k2 k3 and tangential p1 p2: OpenCV's default.
    Five,
    /// The five and a radial denominator k4 k5 k6.
    Rational,
}

impl Distortion {
    /// All of them, the simplest first.
    pub const ALL: [Self; 6] =
        [Self::None, Self::K1, Self::K1K2, Self::K1K2P1P2, Self::Five, Self::Rational];

    /// The name that [`Self::parse`] takes.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::K1 => "k1",
            Self::K1K2 => "k1-k2",
            Self::K1K2P1P2 => "k1-k2-p1-p2",
            Self::Five => "five",
            Self::Rational => "rational",
        }
    }

    /// Reads a name.
    ///
    /// # Errors
    /// None of the names.
    pub fn parse(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|d| d.name() == name).ok_or_else(|| CalibrationError::BadInput {
            what: "distortion".into(),
            expected: format!("one of {}", Self::ALL.map(Self::name).join(", ")),
            found: name.into(),
        })
    }

    /// Places in [`crate::CameraModel::parameters`] that are fitted: both focal lengths, the
    /// principal point, the skew if asked for, and this distortion.
    pub(crate) fn free(self, skew: bool) -> Vec<usize> {
        let mut free = vec![0, 1, 2, 3];
        free.extend(skew.then_some(4));
        let coefficients: &[usize] = match self {
            Self::None => &[],
            Self::K1 => &[5],
            Self::K1K2 => &[5, 6],
            Self::K1K2P1P2 => &[5, 6, 7, 8],
            Self::Five => &[5, 6, 7, 8, 9],
            Self::Rational => &[5, 6, 7, 8, 9, 10, 11, 12],
        };
        free.extend(coefficients);
        free
    }
}
