//! The surface's diffuse reflectance as a picture, which a `bitmap` texture takes.

use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, LineOrder, SmallVec, WritableImage,
};

use crate::{FileError, Grid, Overwrite, Surface, atomic_write};

/// Its name, beside the scene.
pub(super) const PICTURE: &str = "surface_reflectance.exr";

/// Writes it in 32-bit floats, one pixel a cell of the front face as the rig's camera sees it; the
/// channels are R, G, B or Y, since textures know no others.
pub(super) fn write(
    path: &Path,
    grid: &Grid,
    surface: &[Surface],
    overwrite: Overwrite,
) -> Result<(), FileError> {
    let [nx, ny, _] = grid.cells();
    let names: &[&str] = if surface.len() == 3 { &["R", "G", "B"] } else { &["Y"] };
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = names
        .iter()
        .zip(surface)
        .map(|(name, s)| AnyChannel::new(*name, FlatSamples::F32(s.reflectance.clone())))
        .collect();
    let encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::FAST_LOSSLESS };
    let image = Image::from_encoded_channels((nx, ny), encoding, AnyChannels::sort(channels));
    atomic_write(path, overwrite, |out| {
        image.write().to_buffered(out).map_err(|error| std::io::Error::other(error.to_string()))
    })
}
