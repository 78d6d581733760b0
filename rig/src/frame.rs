//! Frames in memory and on disk: 16-bit PNG with everything about the frame inside.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use material::{FileError, Overwrite, Unfinished};
use serde::{Deserialize, Serialize};

use crate::encode::{self, encode_frame};
use crate::{Pattern, Purpose, Target};

/// The text chunk that holds [`FrameMetadata`] as JSON.
pub(crate) const KEYWORD: &str = "diaphane";
/// Deflate cannot do better than 1032 : 1, so an image that claims more is lying.
const MOST_COMPRESSION: u64 = 1032;

/// A picture as the camera gave it, before anything was done to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Values a pixel: 1 (grey) or 3 (R, G, B).
    pub channels: u8,
    /// Bits that the camera uses, 8 to 16.
    pub bit_depth: u8,
    /// Digital numbers from 0 to 2^bit_depth − 1, row by row, channels interleaved.
    pub data: Vec<u16>,
    /// Exposure time that the camera says it used, seconds.
    pub exposure_s: f64,
}

/// All that is known about a frame beside its pixels; it travels inside the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameMetadata {
    /// Name of the shot.
    pub shot: String,
    /// What the shot is for.
    pub purpose: Purpose,
    /// What was in front of the camera.
    pub target: Target,
    /// What the projector showed.
    pub pattern: Pattern,
    /// Which exposure of the shot, from 0.
    pub exposure_index: usize,
    /// Which repeat of that exposure, from 0.
    pub repeat: u32,
    /// Exposure time that was asked for, seconds.
    pub requested_s: f64,
    /// Exposure time that the camera says it used, seconds.
    pub exposure_s: f64,
    /// Bits that the camera uses; values are not scaled to 16 bits.
    pub bit_depth: u8,
    /// Name of the camera.
    pub camera: String,
    /// Name of the projector.
    pub projector: String,
}

/// The least that tells a good frame from a bad one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameStats {
    /// Smallest digital number.
    pub min: u16,
    /// Largest digital number.
    pub max: u16,
    /// Mean digital number.
    pub mean: f64,
    /// Share of values at the largest number that the camera can give.
    pub clipped_share: f64,
    /// How much neighbours differ, over the square of the mean: Brenner's focus score. It compares
    /// frames of one thing in one light; 0 in journals from before it was measured.
    #[serde(default)]
    pub focus: f64,
    /// The reference patch alone, where the rig has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub patch: Option<PatchStats>,
}

/// What the reference patch looks like in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PatchStats {
    /// Mean digital number.
    pub mean: f64,
    /// As in [`FrameStats`].
    pub focus: f64,
}

/// A frame that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// It could not be written or read.
    #[error(transparent)]
    File(#[from] FileError),
    /// The pixels are not those of the stated size.
    #[error(
        "a frame of {width} × {height} with {channels} channels of {bit_depth} bits (1 or 3 channels of 8 to 16 bits), {found} values"
    )]
    Shape {
        /// Pixels a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Values a pixel.
        channels: u8,
        /// Bits a value.
        bit_depth: u8,
        /// Values found.
        found: usize,
    },
    /// A value beyond the bit depth.
    #[error("expected values up to {max}, found {value} at position {index}")]
    Value {
        /// Largest number that the bit depth allows.
        max: u16,
        /// Position in the data.
        index: usize,
        /// The value found.
        value: u16,
    },
    /// What is known about it is no text.
    #[error("what is known about the frame cannot be written down: {0}")]
    Encode(
        /// Why.
        String,
    ),
    /// The file is no whole 16-bit PNG.
    #[error("{}: expected a whole 16-bit PNG, grey or RGB: {reason}", path.display())]
    Png {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The file is a PNG, but none of ours.
    #[error(
        "{}: expected a text chunk \"diaphane\" about the frame, {reason}",
        path.display()
    )]
    Metadata {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

impl Frame {
    /// Largest number that the camera can give.
    pub fn max_value(&self) -> u16 {
        u16::MAX >> 16_u8.saturating_sub(self.bit_depth)
    }

    /// Checks a frame that a device or a file delivered.
    ///
    /// # Errors
    /// The pixels do not fit the size, or exceed the bit depth.
    pub fn check(&self) -> Result<(), FrameError> {
        self.check_shape()?;
        let max = self.max_value();
        match self.data.iter().position(|&v| v > max) {
            None => Ok(()),
            Some(index) => Err(FrameError::Value { max, index, value: self.data[index] }),
        }
    }

    /// Whether there are as many values as the size says.
    pub(crate) fn check_shape(&self) -> Result<(), FrameError> {
        let &Frame { width, height, channels, bit_depth, .. } = self;
        let found = self.data.len();
        let pixels = (width as usize).checked_mul(height as usize);
        let expected = pixels.and_then(|n| n.checked_mul(usize::from(channels)));
        let plausible = matches!(channels, 1 | 3) && (8..=16).contains(&bit_depth);
        if found == 0 || expected != Some(found) || !plausible {
            return Err(FrameError::Shape { width, height, channels, bit_depth, found });
        }
        Ok(())
    }
}

/// Writes a frame as a 16-bit PNG, values unscaled, whole or not at all.
///
/// # Errors
/// The frame does not [`Frame::check`], the file is there already and `overwrite` refuses,
/// or the system does.
pub fn write_frame(
    path: &Path,
    frame: &Frame,
    metadata: &FrameMetadata,
    overwrite: Overwrite,
) -> Result<(), FrameError> {
    let mut unfinished = Unfinished::begin(path, overwrite)?;
    let failed = |e| encode::named(e, path);
    encode_frame(frame, metadata, None, unfinished.file()).map_err(failed)?;
    Ok(unfinished.finish()?)
}

/// Reads a frame that [`write_frame`] wrote.
///
/// # Errors
/// The file cannot be read, is cut short or damaged, is no 16-bit grey or RGB PNG, or does
/// not carry our text chunk.
pub fn read_frame(path: &Path) -> Result<(Frame, FrameMetadata), FrameError> {
    let broken = |reason: String| FrameError::Png { path: path.into(), reason };
    let io_error = |source| FileError::Io { path: path.into(), action: "read", source };
    let file = File::open(path).map_err(io_error)?;
    let size = file.metadata().map_err(io_error)?.len();
    let possible = size.saturating_mul(MOST_COMPRESSION);
    let limits = png::Limits { bytes: usize::try_from(possible).unwrap_or(usize::MAX) };
    let mut decoder = png::Decoder::new_with_limits(BufReader::new(file), limits);
    decoder.set_transformations(png::Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(|e| broken(e.to_string()))?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    let channels = match (info.color_type, info.bit_depth) {
        (png::ColorType::Grayscale, png::BitDepth::Sixteen) => 1,
        (png::ColorType::Rgb, png::BitDepth::Sixteen) => 3,
        (color, depth) => return Err(broken(format!("found {color:?} of {} bits", depth as u8))),
    };
    let needed = reader
        .output_buffer_size()
        .filter(|&n| n as u64 <= possible)
        .ok_or_else(|| broken(format!("{width} × {height} pixels cannot be in {size} bytes")))?;
    let mut bytes = vec![0; needed];
    reader.next_frame(&mut bytes).map_err(|e| broken(e.to_string()))?;
    // Text may stand behind the pixels, and damage too.
    reader.finish().map_err(|e| broken(e.to_string()))?;

    let metadata = |reason: String| FrameError::Metadata { path: path.into(), reason };
    let chunk = reader.info().utf8_text.iter().find(|chunk| chunk.keyword == KEYWORD);
    let text = chunk
        .ok_or_else(|| metadata("found none".into()))?
        .get_text()
        .map_err(|e| metadata(format!("found one that cannot be read: {e}")))?;
    let metadata: FrameMetadata = serde_json::from_str(&text)
        .map_err(|e| metadata(format!("found one that cannot be understood: {e}")))?;
    let frame = Frame {
        width,
        height,
        channels,
        bit_depth: metadata.bit_depth,
        data: bytes.as_chunks::<2>().0.iter().map(|b| u16::from_be_bytes(*b)).collect(),
        exposure_s: metadata.exposure_s,
    };
    frame.check().map_err(|e| broken(e.to_string()))?;
    Ok((frame, metadata))
}
