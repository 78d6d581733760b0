//! What colours the patches of a ColorChecker Classic have.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::colour::cie::{D50, D65, EQUAL_ENERGY, xyz_of_lab};
use crate::error::{CalibrationError, Result};

/// The colours of the 24 patches, from the manufacturer or measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChartReference {
    /// Where the numbers are from.
    pub name: String,
    /// X, Y, Z of each patch, row by row from dark skin to black; a perfect white has `white`.
    pub xyz: [[f64; 3]; 24],
    /// X, Y, Z of the white that the colours are seen under, Y = 1.
    pub white: [f64; 3],
}

/// The light that colours are stated for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Illuminant {
    /// Horizon light, the graphic arts' standard.
    D50,
    /// Noon daylight, sRGB's white.
    D65,
    /// Equal energy at each wavelength: what bare reflectances integrate to.
    EqualEnergy,
}

impl Illuminant {
    fn white(self) -> [f64; 3] {
        match self {
            Self::D50 => D50,
            Self::D65 => D65,
            Self::EqualEnergy => EQUAL_ENERGY,
        }
    }
}

/// X-Rite's L*a*b* (D50, 2°) for charts made from November 2014 on, in units of 0.01.
const FROM_2014: [[i16; 3]; 24] = [
    [3754, 1437, 1492],
    [6466, 1927, 1750],
    [4932, -382, -2254],
    [4346, -1274, 2272],
    [5494, 961, -2479],
    [7048, -3226, -37],
    [6273, 3583, 5650],
    [3943, 1075, -4517],
    [5057, 4864, 1667],
    [3010, 2254, -2087],
    [7177, -2413, 5819],
    [7151, 1824, 6737],
    [2837, 1542, -4980],
    [5438, -3972, 3227],
    [4243, 5105, 2862],
    [8180, 267, 8041],
    [5063, 5128, -1412],
    [4957, -2971, -2832],
    [9519, -103, 293],
    [8129, -57, 44],
    [6689, -75, -6],
    [5076, -13, 14],
    [3563, -46, -48],
    [2064, 7, -46],
];

/// Names of the patches, row by row.
pub const PATCH_NAMES: [&str; 24] = [
    "dark skin",
    "light skin",
    "blue sky",
    "foliage",
    "blue flower",
    "bluish green",
    "orange",
    "purplish blue",
    "moderate red",
    "purple",
    "yellow green",
    "orange yellow",
    "blue",
    "green",
    "red",
    "yellow",
    "magenta",
    "cyan",
    "white",
    "neutral 8",
    "neutral 6.5",
    "neutral 5",
    "neutral 3.5",
    "black",
];

impl ChartReference {
    /// The manufacturer's colours of charts made from November 2014 on.
    ///
    /// Older charts differ by 0.8 units of CIEDE2000 in the mean and 2 at most, the white, which
    /// was less yellow; where that matters, measure the chart at hand and use
    /// [`ChartReference::load`].
    pub fn published() -> Self {
        let lab = |i: usize| FROM_2014[i].map(|v| f64::from(v) / 100.0);
        Self {
            name: "X-Rite ColorChecker Classic from November 2014 on, D50".into(),
            xyz: std::array::from_fn(|i| xyz_of_lab(lab(i), D50)),
            white: D50,
        }
    }

    /// Reads measured patches: a CSV with a heading that names columns `X`, `Y`, `Z` or `L`, `a`,
    /// `b` among others, and 24 lines from dark skin to black. X, Y, Z may be in per cent.
    ///
    /// # Errors
    /// The file is unreadable, or names the line and what it should hold.
    pub fn load(path: impl AsRef<Path>, illuminant: Illuminant) -> Result<Self> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(CalibrationError::io(path))?;
        let bad = |expected: &str, found: String| CalibrationError::BadFile {
            path: path.to_path_buf(),
            expected: expected.into(),
            found,
        };
        let mut lines = text
            .lines()
            .enumerate()
            .filter(|(_, line)| !line.trim().is_empty() && !line.trim_start().starts_with('#'));
        let cells = |line: &str| -> Vec<String> {
            line.split([',', ';', '\t']).map(|c| c.trim().trim_matches('"').to_owned()).collect()
        };
        let heading = lines.next().map(|(_, line)| cells(line)).unwrap_or_default();
        let columns = |names: [&str; 3]| -> Option<[usize; 3]> {
            let places = names.map(|n| heading.iter().position(|h| h.eq_ignore_ascii_case(n)));
            let [Some(a), Some(b), Some(c)] = places else { return None };
            Some([a, b, c])
        };
        let (places, is_lab) = columns(["X", "Y", "Z"])
            .map(|places| (places, false))
            .or_else(|| columns(["L", "a", "b"]).map(|places| (places, true)))
            .ok_or_else(|| {
                bad("a heading with columns X, Y, Z or L, a, b", format!("{heading:?}"))
            })?;
        let mut rows = Vec::new();
        for (number, line) in lines {
            let cells = cells(line);
            let value =
                |place: usize| cells.get(place)?.parse().ok().filter(|v: &f64| v.is_finite());
            let [Some(a), Some(b), Some(c)] = places.map(value) else {
                let expected = format!("three numbers on line {}", number + 1);
                return Err(bad(&expected, format!("{line:?}")));
            };
            rows.push([a, b, c]);
        }
        let found = format!("{} lines of colours", rows.len());
        let mut xyz: [[f64; 3]; 24] =
            rows.try_into().map_err(|_| bad("24 patches, dark skin to black", found))?;
        let white = illuminant.white();
        if is_lab {
            xyz = xyz.map(|lab| xyz_of_lab(lab, white));
        } else if xyz.iter().any(|v| v[1] > 2.0) {
            xyz = xyz.map(|v| v.map(|v| v / 100.0));
        }
        let greys = &xyz[18..];
        if xyz.iter().any(|v| !(v[1] > 0.0 && v[1] < 2.0)) {
            return Err(bad("luminances between black and white", format!("{xyz:?}")));
        }
        if greys.windows(2).any(|pair| pair[0][1] <= pair[1][1]) {
            return Err(bad(
                "a grey row, patches 19 to 24, that darkens from white to black",
                format!("Y = {:?}", greys.iter().map(|v| v[1]).collect::<Vec<_>>()),
            ));
        }
        Ok(Self { name: path.display().to_string(), xyz, white })
    }
}
