//! Pictures of one colour a pixel, as a sensor under a Bayer filter takes them.

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::radiometry::hdr::HdrImage;
use crate::radiometry::masters::MasterDark;
use crate::radiometry::merge::{MergeReport, Merger};
use crate::radiometry::noise::NoiseModel;
use crate::radiometry::response::Response;

/// Which colours the upper left 2 × 2 pixels see, row by row.
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
    /// Reads `rggb`, `bggr`, `grbg` or `gbrg`.
    ///
    /// # Errors
    /// Any other text.
    pub fn parse(text: &str) -> Result<Self> {
        match text.to_ascii_lowercase().as_str() {
            "rggb" => Ok(Self::Rggb),
            "bggr" => Ok(Self::Bggr),
            "grbg" => Ok(Self::Grbg),
            "gbrg" => Ok(Self::Gbrg),
            _ => Err(CalibrationError::BadInput {
                what: "Bayer pattern".into(),
                expected: "rggb, bggr, grbg or gbrg".into(),
                found: text.into(),
            }),
        }
    }

    /// Places of red, both greens and blue in a quad, as (row, column).
    fn places(self) -> [(usize, usize); 4] {
        match self {
            Self::Rggb => [(0, 0), (0, 1), (1, 0), (1, 1)],
            Self::Bggr => [(1, 1), (0, 1), (1, 0), (0, 0)],
            Self::Grbg => [(0, 1), (0, 0), (1, 1), (1, 0)],
            Self::Gbrg => [(1, 0), (0, 0), (1, 1), (0, 1)],
        }
    }

    /// A colour picture of half the width and height from the quads of a merged mosaic: red and
    /// blue as they are, green the mean of both its sites (of the one that was measured, where
    /// the other is clipped). No value is interpolated, so the variances hold.
    ///
    /// # Errors
    /// A picture of several channels, or smaller than a quad.
    pub fn quads(self, mosaic: &HdrImage) -> Result<HdrImage> {
        let (width, height) = (mosaic.width / 2, mosaic.height / 2);
        let samples = mosaic.width * mosaic.height;
        let whole = mosaic.radiance.len() == samples && mosaic.variance.len() == samples;
        if mosaic.channels != 1 || !whole || width == 0 || height == 0 {
            return Err(CalibrationError::BadInput {
                what: "mosaic".into(),
                expected: "one channel of at least 2 x 2 pixels".into(),
                found: format!(
                    "{}x{} pixels in {} channel(s)",
                    mosaic.width, mosaic.height, mosaic.channels
                ),
            });
        }
        let mut radiance = Vec::with_capacity(3 * width * height);
        let mut variance = Vec::with_capacity(3 * width * height);
        let places = self.places();
        for y in 0..height {
            for x in 0..width {
                let [red, one, other, blue] = places.map(|(row, column)| {
                    let at = (2 * y + row) * mosaic.width + 2 * x + column;
                    (mosaic.radiance[at], mosaic.variance[at])
                });
                let green = match (one.1.is_finite(), other.1.is_finite()) {
                    (true, false) => one,
                    (false, true) => other,
                    _ => (0.5 * (one.0 + other.0), 0.25 * (one.1 + other.1)),
                };
                for (value, uncertainty) in [red, green, blue] {
                    radiance.push(value);
                    variance.push(uncertainty);
                }
            }
        }
        Ok(HdrImage { width, height, channels: 3, radiance, variance, ..*mosaic })
    }
}

/// Merges a bracket of linear mosaics, less their dark frames (none is fine), site by site, and
/// makes a colour picture of half the size of it.
///
/// # Errors
/// What the iterator yields as an error, and as [`Merger`] and [`Bayer::quads`].
pub fn merge_mosaic<E: From<CalibrationError>>(
    frames: impl IntoIterator<Item = std::result::Result<(Photo, f64), E>>,
    darks: Vec<MasterDark>,
    noise: &NoiseModel,
    bayer: Bayer,
) -> std::result::Result<(HdrImage, MergeReport), E> {
    let response = Response::identity(1);
    let mut merger = Merger::new(&response, noise)?.with_darks(darks)?;
    for frame in frames {
        let (photo, exposure_s) = frame?;
        merger.add(photo, exposure_s)?;
    }
    let (mosaic, report) = merger.finish()?;
    Ok((bayer.quads(&mosaic)?, report))
}
