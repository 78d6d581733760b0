//! Pictures of one colour a pixel, as a sensor under a Bayer filter takes them.

use raw::Bayer;

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::radiometry::hdr::HdrImage;
use crate::radiometry::masters::MasterDark;
use crate::radiometry::merge::{MergeReport, Merger};
use crate::radiometry::noise::NoiseModel;
use crate::radiometry::response::Response;

/// A colour picture of half the width and height from the quads of a merged mosaic: red and
/// blue as they are, green the mean of both its sites (of the one that was measured, where
/// the other is clipped). No value is interpolated, so the variances hold.
///
/// # Errors
/// A picture of several channels, or smaller than a quad.
pub fn quads(bayer: Bayer, mosaic: &HdrImage) -> Result<HdrImage> {
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
    let places = bayer.places();
    for y in 0..height {
        for x in 0..width {
            let [red, one, other, blue] = places.map(|place| {
                let at = (2 * y + place / 2) * mosaic.width + 2 * x + place % 2;
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

/// Merges a bracket of linear mosaics, less their dark frames (none is fine), site by site, and
/// makes a colour picture of half the size of it.
///
/// # Errors
/// What the iterator yields as an error, and as [`Merger`] and [`quads`].
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
    Ok((quads(bayer, &mosaic)?, report))
}
