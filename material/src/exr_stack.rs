//! A stack of slices in one OpenEXR picture, for programs that work on pictures.
//!
//! One part, as wide and high as the front face in voxels; each slice in depth is two layers,
//! `kappa_z000` (mm) and `mu_z000` (1/mm), whose channels are those of the material. The first
//! slice is the front face's; pictures stand as the rig's camera sees them. 32-bit floats without
//! loss. A material with a surface has one layer more, `surface_reflectance`.

use std::io::Cursor;
use std::path::Path;

use exr::meta::BlockDescription;
use exr::meta::header::Header as Part;
use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, LineOrder, MetaData,
    ReadChannels, ReadLayers, SmallVec, Text, Vec2, WritableImage, read as exr_read,
};

use crate::header::{Header, KEY, Optional};
use crate::reading::{Known, Reading};
use crate::{FileError, Grid, Material, Overwrite, Surface, atomic_write};

/// What zip can do at best: no more bytes than this for each byte of a file.
const MOST_BYTES_A_BYTE: usize = 1032;

/// The layer of the surface.
const SURFACE: &str = "surface_reflectance";

/// A layer's name.
fn layer(coefficient: &str, slice: usize) -> String {
    format!("{coefficient}_z{slice:03}")
}

/// Writes the stack.
///
/// # Errors
/// The file is there already and `overwrite` refuses, or the system does.
pub fn write(path: &Path, material: &Material, overwrite: Overwrite) -> Result<(), FileError> {
    let [nx, ny, nz] = material.grid().cells();
    let face = material.grid().face_len();
    let mut channels = SmallVec::new();
    for slice in 0..nz {
        for channel in material.channels() {
            if Text::new_or_none(&channel.name).is_none() {
                let reason = format!("a channel cannot be called {:?} in OpenEXR", channel.name);
                return Err(FileError::CannotHold { path: path.into(), reason });
            }
            for (name, values) in [("kappa", &channel.kappa_mm), ("mu", &channel.mu_per_mm)] {
                let name = format!("{}.{}", layer(name, slice), channel.name);
                let samples = values[slice * face..(slice + 1) * face].to_vec();
                channels.push(AnyChannel::new(name.as_str(), FlatSamples::F32(samples)));
            }
        }
    }
    for (channel, surface) in material.channels().iter().zip(material.surface().unwrap_or_default())
    {
        let samples = FlatSamples::F32(surface.reflectance.clone());
        channels.push(AnyChannel::new(format!("{SURFACE}.{}", channel.name).as_str(), samples));
    }
    // Blocks in the file's order, not in that in which threads get done with them. The last bits of
    // coefficients are noise: what zip would save is not worth its time.
    let encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::FAST_LOSSLESS };
    let mut image = Image::from_encoded_channels((nx, ny), encoding, AnyChannels::sort(channels));
    let failed = |source| FileError::Io { path: path.into(), action: "write", source };
    let header = Header::of(material).ascii().map_err(failed)?;
    // The only attribute of its map: others would be written in a random order.
    let header = AttributeValue::Text(Text::from(header.as_str()));
    image.layer_data.attributes.other.insert(Text::from(KEY), header);
    atomic_write(path, overwrite, |out| {
        image.write().to_buffered(out).map_err(|error| std::io::Error::other(error.to_string()))
    })
}

/// Reads what [`write`] wrote, also after another program saved it; `path` is for messages.
///
/// # Errors
/// Something else than an OpenEXR picture, a damaged or truncated one, other layers, or values
/// that are no material's.
pub fn read(bytes: &[u8], path: &Path) -> Result<Reading, FileError> {
    let malformed = |reason: String| FileError::malformed(path, reason);
    let failed = |e: exr::error::Error| malformed(format!("expected an OpenEXR picture: {e}"));
    let about = MetaData::read_from_buffered(Cursor::new(bytes), true).map_err(failed)?;
    // Pictures are made as large as their header says before their content is looked at, and so is
    // the room for each block of them.
    let pictures = about.headers.iter().map(picture_bytes).fold(0, usize::saturating_add);
    let block = about.headers.iter().map(block_bytes).max().unwrap_or(0);
    if pictures.max(block) > bytes.len().saturating_mul(MOST_BYTES_A_BYTE) {
        return Err(malformed("it claims more pixels than a file of its size can hold".into()));
    }
    let image = exr_read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .map_err(failed)?;
    let Vec2(nx, ny) = image.layer_data.size;
    let planes: Vec<(String, &FlatSamples)> = image
        .layer_data
        .channel_data
        .list
        .iter()
        .map(|channel| (channel.name.to_string(), &channel.sample_data))
        .collect();
    let told = image.layer_data.attributes.other.get(&Text::from(KEY));
    let told = told.or_else(|| image.attributes.other.get(&Text::from(KEY)));
    let known = match told {
        Some(AttributeValue::Text(json)) => Known::told(json.to_string().as_bytes()),
        _ => assumed([nx, ny], &planes),
    };
    let known = known.map_err(malformed)?;
    let [width, height, nz] = known.header.grid.cells();
    if [width, height] != [nx, ny] || nz.saturating_mul(2) > planes.len() {
        let found = format!("{nx} × {ny} pixels and {} channels", planes.len());
        return Err(malformed(format!("expected {width} × {height} × {nz} voxels, found {found}")));
    }
    let plane = |layer: &str, channel: &str| {
        let name = format!("{layer}.{channel}");
        let plane = planes.iter().find(|(found, _)| *found == name);
        let (_, plane) = plane.ok_or_else(|| FileError::MissingArray {
            path: path.into(),
            name: name.clone(),
            available: planes.iter().map(|(name, _)| name.clone()).collect(),
        })?;
        // Sub-sampled channels have fewer: the material's own check counts them.
        Ok(plane.values_as_f32())
    };
    let volume = |coefficient: &str, channel: &str| {
        let mut out = Vec::with_capacity(nx * ny * nz);
        for slice in 0..nz {
            out.extend(plane(&layer(coefficient, slice), channel)?);
        }
        Ok(out)
    };
    let names: Vec<String> = known.header.channels.iter().map(|c| c.name.clone()).collect();
    let volumes = |coefficient: &str| {
        names.iter().map(|name| volume(coefficient, name)).collect::<Result<Vec<_>, FileError>>()
    };
    let (kappa, mu) = (volumes("kappa")?, volumes("mu")?);
    let surface = |name: &String| Ok(Surface { reflectance: plane(SURFACE, name)?.collect() });
    let there = names.iter().any(|channel| {
        let name = format!("{SURFACE}.{channel}");
        planes.iter().any(|(found, _)| *found == name)
    });
    let surface: Option<Result<Vec<Surface>, FileError>> =
        there.then(|| names.iter().map(surface).collect());
    let optional = Optional { surface: surface.transpose()?, ..Optional::default() };
    known.whole(path, kappa, mu, optional)
}

/// Bytes of all samples of a part, as f32.
fn picture_bytes(part: &Part) -> usize {
    let Vec2(width, height) = part.layer_size;
    let samples = width.saturating_mul(height).saturating_mul(part.channels.list.len());
    samples.saturating_mul(size_of::<f32>())
}

/// Bytes of a block of a part: a tile, or as many lines as its compression takes at a time. Either
/// may be larger than the picture.
fn block_bytes(part: &Part) -> usize {
    let Vec2(width, height) = match part.blocks {
        BlockDescription::Tiles(tiles) => tiles.tile_size,
        BlockDescription::ScanLines => {
            Vec2(part.layer_size.0, part.compression.scan_lines_per_block())
        }
    };
    width.saturating_mul(height).saturating_mul(part.channels.bytes_per_pixel)
}

/// Where nothing is told of the material: as many slices as there are layers of κ, cubes of 1 mm.
fn assumed([nx, ny]: [usize; 2], planes: &[(String, &FlatSamples)]) -> Result<Known, String> {
    let named = |name: &String| planes.iter().any(|(found, _)| found == name);
    let slices = |channel: &str| {
        (0..).take_while(|&slice| named(&format!("{}.{channel}", layer("kappa", slice)))).count()
    };
    let (colour, grey) = (slices("R"), slices("Y"));
    let channels = if colour > 0 { 3 } else { 1 };
    let grid = Grid::new([nx, ny, colour.max(grey)], [1.0; 3])
        .map_err(|e| format!("expected layers kappa_z000 and mu_z000 and so on: {e}"))?;
    let mut known = Known::nothing(grid, channels);
    known.assumed.push("voxels are cubes of 1 mm".into());
    Ok(known)
}
