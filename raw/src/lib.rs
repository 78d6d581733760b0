//! Camera raw files: the sensor's own codes under its colour filter, before any development.
//!
//! The lowest room: whoever photographs (`rig`) and whoever measures (`calibration`) decodes with
//! it. The decoders are the crate rawler's, behind the feature `decoders`.

mod bayer;
#[cfg(feature = "decoders")]
mod decode;
#[cfg(feature = "decoders")]
mod directories;
mod error;

use std::path::Path;

pub use bayer::Bayer;
pub use error::RawError;

/// Raw files by extension: Adobe's and whoever writes DNG, Canon, Nikon, Sony.
const EXTENSIONS: [&str; 5] = ["dng", "cr2", "cr3", "nef", "arw"];

/// Whether a file is a camera raw file by its extension: dng, cr2, cr3, nef or arw.
pub fn is_raw(path: impl AsRef<Path>) -> bool {
    path.as_ref().extension().is_some_and(|extension| {
        EXTENSIONS.contains(&extension.to_string_lossy().to_ascii_lowercase().as_str())
    })
}

/// What a camera raw file holds: linear codes of one colour a pixel, cropped to the pixels that
/// see light.
#[derive(Clone, Debug, PartialEq)]
pub struct RawMosaic {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Codes as the sensor gave them, DN, black included; row by row from the top,
    /// `width · height` long.
    pub codes: Vec<u16>,
    /// Colours of its upper left 2 × 2 pixels.
    pub bayer: Bayer,
    /// Code without light of the upper left 2 × 2 pixels, row by row, DN.
    pub black_levels: [f64; 4],
    /// Code at which the sensor clips, DN; above all black levels.
    pub white_level: u16,
    /// Exposure time that the camera noted, s; None if it did not.
    pub exposure_s: Option<f64>,
}

/// Reads a camera raw file (DNG, CR2, CR3, NEF, ARW).
///
/// # Errors
/// The file cannot be read, or as [`decode`].
pub fn read(path: impl AsRef<Path>) -> Result<RawMosaic, RawError> {
    let path = path.as_ref();
    decode(path, whole(path)?)
}

/// Decodes the bytes of a camera raw file; `path` is what to call it in errors, and need not exist.
///
/// # Errors
/// Names the file when it is truncated or corrupt; when it holds developed or floating-point
/// pixels; when its colour filter repeats otherwise than every 2 × 2 pixels (X-Trans) or has other
/// colours than red, green and blue; when its levels make no sense. Every file is refused where
/// the crate was built without its feature `decoders`.
pub fn decode(path: impl AsRef<Path>, bytes: Vec<u8>) -> Result<RawMosaic, RawError> {
    decoder::mosaic(path.as_ref(), bytes)
}

/// The exposure time that a camera raw file notes, s; the pixels are not looked at.
///
/// # Errors
/// As [`read`], as far as the file's directories go.
pub fn exposure_s(path: impl AsRef<Path>) -> Result<Option<f64>, RawError> {
    let path = path.as_ref();
    decoder::exposure_s(path, whole(path)?)
}

fn whole(path: &Path) -> Result<Vec<u8>, RawError> {
    std::fs::read(path).map_err(|source| RawError::Io { path: path.to_path_buf(), source })
}

#[cfg(feature = "decoders")]
use decode as decoder;

/// Stands in where the decoders were left out.
#[cfg(not(feature = "decoders"))]
mod decoder {
    use super::{Path, RawError, RawMosaic};

    fn left_out(path: &Path) -> RawError {
        RawError::BadFile {
            path: path.to_path_buf(),
            expected: "a developed picture: this program was built without the feature raw",
            found: "a camera raw file".into(),
        }
    }

    pub fn mosaic(path: &Path, _: Vec<u8>) -> Result<RawMosaic, RawError> {
        Err(left_out(path))
    }

    pub fn exposure_s(path: &Path, _: Vec<u8>) -> Result<Option<f64>, RawError> {
        Err(left_out(path))
    }
}
