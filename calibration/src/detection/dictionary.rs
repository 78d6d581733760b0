//! The published sets of ArUco markers.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::CalibrationError;

/// One of OpenCV's sets of ArUco markers (Garrido-Jurado et al. 2014), written `4x4_50`: markers
/// of 4 x 4 bits, 50 of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct MarkerDictionary {
    bits: u8,
    markers: u16,
}

/// Numbers of markers that the sets of one bit count come in.
const SIZES: [u16; 4] = [50, 100, 250, 1000];

impl MarkerDictionary {
    /// Markers in the set; their numbers run from 0.
    pub fn markers(&self) -> usize {
        usize::from(self.markers)
    }

    /// OpenCV's number for the set: four sizes for each of 4, 5, 6 and 7 bits.
    pub(crate) fn opencv_number(&self) -> i32 {
        let size = SIZES.iter().position(|&n| n == self.markers).unwrap_or(0);
        4 * (i32::from(self.bits) - 4) + size as i32
    }
}

impl FromStr for MarkerDictionary {
    type Err = CalibrationError;

    fn from_str(text: &str) -> Result<Self, CalibrationError> {
        let lower = text.trim().to_ascii_lowercase();
        let name = lower.trim_start_matches("dict").trim_start_matches('_');
        let parts = name.split_once('_').and_then(|(bits, markers)| {
            let (a, b) = bits.split_once('x')?;
            Some((a.parse().ok()?, b.parse::<u8>().ok()?, markers.parse().ok()?))
        });
        match parts {
            Some((bits, same, markers))
                if bits == same && (4..=7).contains(&bits) && SIZES.contains(&markers) =>
            {
                Ok(Self { bits, markers })
            }
            _ => Err(CalibrationError::BadInput {
                what: "marker dictionary".into(),
                expected: "BITSxBITS_MARKERS with 4 to 7 bits and 50, 100, 250 or 1000 markers, \
                           for instance 4x4_50"
                    .into(),
                found: text.to_owned(),
            }),
        }
    }
}

impl fmt::Display for MarkerDictionary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{0}x{0}_{1}", self.bits, self.markers)
    }
}

impl TryFrom<String> for MarkerDictionary {
    type Error = CalibrationError;

    fn try_from(text: String) -> Result<Self, CalibrationError> {
        text.parse()
    }
}

impl From<MarkerDictionary> for String {
    fn from(dictionary: MarkerDictionary) -> Self {
        dictionary.to_string()
    }
}
