//! Pictures as the camera wrote them: integer codes, nothing linearised.

use std::path::{Path, PathBuf};

use image::DynamicImage;
use raw::is_raw;
use rayon::prelude::*;

use crate::error::{CalibrationError, Result};
use crate::radiometry::raw::read_raw;

/// A picture: `width × height` pixels of `channels` (1 grey or 3 RGB) integer codes.
#[derive(Clone, Debug, PartialEq)]
pub struct Photo {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 1 (grey) or 3 (R, G, B).
    pub channels: usize,
    /// Codes, row by row from the top, channels interleaved; `width · height · channels` long.
    pub data: Vec<u16>,
    /// Full scale: 255 or 65535.
    pub max_value: u16,
    /// What to call it in messages: the file name.
    pub name: String,
}

impl Photo {
    /// Reads a PNG, JPEG or TIFF of 8 or 16 bits; alpha is dropped, floats are refused, and so
    /// are camera raw files, which are no pictures yet.
    ///
    /// # Errors
    /// Names the file when it is missing, truncated, corrupt or of another kind.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(CalibrationError::io(path))?;
        let bad = |found: String| CalibrationError::BadFile {
            path: path.to_path_buf(),
            expected: "a whole PNG, JPEG or TIFF picture of 8 or 16 bits".into(),
            found,
        };
        if is_raw(path) {
            return Err(bad("a camera raw file, to be developed or merged first".into()));
        }
        if jpeg_is_truncated(&bytes) {
            return Err(bad("a JPEG that ends before its end marker (truncated)".into()));
        }
        let picture = image::load_from_memory(&bytes).map_err(|error| bad(error.to_string()))?;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Self::from_image(picture, name)
            .ok_or_else(|| bad("an empty picture or one of floating-point pixels".into()))
    }

    /// Reads what is measured rather than looked at: a picture as [`Self::load`] does, or a camera
    /// raw file as the mosaic of its codes.
    ///
    /// # Errors
    /// As [`Self::load`] and [`read_raw`].
    pub fn load_codes(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        if is_raw(path) { Ok(read_raw(path)?.photo) } else { Self::load(path) }
    }

    fn from_image(picture: DynamicImage, name: String) -> Option<Self> {
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let widen = |bytes: Vec<u8>| bytes.into_iter().map(u16::from).collect();
        let (channels, max_value, data): (usize, u16, Vec<u16>) = match picture {
            DynamicImage::ImageLuma8(p) => (1, 255, widen(p.into_raw())),
            DynamicImage::ImageRgb8(p) => (3, 255, widen(p.into_raw())),
            p @ DynamicImage::ImageLumaA8(_) => (1, 255, widen(p.into_luma8().into_raw())),
            p @ DynamicImage::ImageRgba8(_) => (3, 255, widen(p.into_rgb8().into_raw())),
            DynamicImage::ImageLuma16(p) => (1, u16::MAX, p.into_raw()),
            DynamicImage::ImageRgb16(p) => (3, u16::MAX, p.into_raw()),
            p @ DynamicImage::ImageLumaA16(_) => (1, u16::MAX, p.into_luma16().into_raw()),
            p @ DynamicImage::ImageRgba16(_) => (3, u16::MAX, p.into_rgb16().into_raw()),
            _ => return None,
        };
        (width > 0 && height > 0).then_some(Self { width, height, channels, data, max_value, name })
    }

    /// The picture as 8-bit grey (Rec. 601 luma of the codes).
    pub fn grey_u8(&self) -> Vec<u8> {
        self.scaled_grey(255.0 / f32::from(self.max_value))
    }

    /// Grey for detectors: as [`Self::grey_u8`], but a dark 16-bit picture is brightened, up to
    /// 16 times, until its brightest thousandth is white. 8 bits hold nothing to bring out.
    pub(crate) fn detector_grey(&self) -> Vec<u8> {
        let full = f32::from(self.max_value);
        let mut codes: Vec<u16> = self.data.iter().copied().step_by(17).collect();
        let place = codes.len().saturating_sub(1) * 999 / 1000;
        if self.max_value == 255 || codes.is_empty() {
            return self.grey_u8();
        }
        let bright = f32::from(*codes.select_nth_unstable(place).1);
        self.scaled_grey(255.0 / bright.clamp(full / 16.0, full))
    }

    fn scaled_grey(&self, scale: f32) -> Vec<u8> {
        self.data
            .chunks_exact(self.channels)
            .map(|px| {
                let code = match *px {
                    [r, g, b] => 0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b),
                    _ => px.first().map_or(0.0, |&v| f32::from(v)),
                };
                (code * scale + 0.5) as u8
            })
            .collect()
    }

    /// At most about `pixels` of a picture, as square tiles from all over it, one below the other:
    /// enough to learn a response from, where memory does not hold whole brackets.
    pub fn tiles(&self, pixels: usize) -> Self {
        const EDGE: usize = 64;
        let (columns, rows) = (self.width / EDGE, self.height / EDGE);
        let wanted = (pixels / (EDGE * EDGE)).max(1);
        if columns * rows <= wanted {
            return self.clone();
        }
        let row = self.width * self.channels;
        let mut data = Vec::with_capacity(wanted * EDGE * EDGE * self.channels);
        for k in 0..wanted {
            let tile = k * columns * rows / wanted;
            let (x, y) = (tile % columns * EDGE, tile / columns * EDGE);
            for line in y..y + EDGE {
                let from = line * row + x * self.channels;
                data.extend_from_slice(&self.data[from..from + EDGE * self.channels]);
            }
        }
        let (width, height) = (EDGE, wanted * EDGE);
        Self { width, height, data, name: self.name.clone(), ..*self }
    }

    /// Samples in the picture, `width · height · channels`.
    pub fn samples(&self) -> usize {
        self.width * self.height * self.channels
    }

    /// Size and depth in words, for messages.
    pub(crate) fn shape(&self) -> String {
        let bits = if self.max_value == 255 { 8 } else { 16 };
        format!("{}x{} pixels, {} channel(s), {bits} bits", self.width, self.height, self.channels)
    }

    /// The same picture without its codes: what its shape is known by.
    pub(crate) fn without_codes(&self) -> Self {
        Self { name: self.name.clone(), data: Vec::new(), ..*self }
    }

    /// Fails unless `data` really has the promised number of samples, none beyond full scale.
    pub(crate) fn check(&self) -> Result<()> {
        let largest_of = |part: &[u16]| part.iter().copied().max();
        let largest = self.data.par_chunks(1 << 17).filter_map(largest_of).max().unwrap_or(0);
        let shaped = self.data.len() == self.samples() && matches!(self.channels, 1 | 3);
        let scaled = matches!(self.max_value, 255 | u16::MAX) && largest <= self.max_value;
        if shaped && scaled && !self.data.is_empty() {
            return Ok(());
        }
        Err(CalibrationError::Mismatch {
            picture: self.name.clone(),
            expected: format!("{} samples up to 255 or 65535", self.samples()),
            found: format!("{} up to {largest}, {}", self.data.len(), self.shape()),
        })
    }
}

/// Decoders fill what is missing from a cut-off JPEG with grey; its end marker says better.
fn jpeg_is_truncated(bytes: &[u8]) -> bool {
    if !bytes.starts_with(&[0xff, 0xd8]) {
        return false;
    }
    let marker = |code: u8| bytes.windows(2).rposition(|pair| pair == [0xff, code]);
    match (marker(0xda), marker(0xd9)) {
        (Some(scan), Some(end)) => end < scan,
        _ => true,
    }
}

/// The pictures in a folder by file name, sorted; sub-folders are not entered.
///
/// # Errors
/// The folder is missing or holds no png, jpg, jpeg, tif, tiff or camera raw file, or raw files
/// beside others: cameras write both of one exposure, which must not count twice.
pub fn list_pictures(dir: impl AsRef<Path>) -> Result<Vec<PathBuf>> {
    let dir = dir.as_ref();
    let mut pictures = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(CalibrationError::io(dir))? {
        let path = entry.map_err(CalibrationError::io(dir))?.path();
        let known = path.extension().is_some_and(|extension| {
            let extension = extension.to_string_lossy().to_ascii_lowercase();
            ["png", "jpg", "jpeg", "tif", "tiff"].contains(&extension.as_str())
        });
        if (known || is_raw(&path)) && path.is_file() {
            pictures.push(path);
        }
    }
    if pictures.is_empty() {
        return Err(CalibrationError::NoPictures { path: dir.to_path_buf() });
    }
    pictures.sort();
    let raw = pictures.iter().find(|path| is_raw(path));
    let other = pictures.iter().find(|path| !is_raw(path));
    if let (Some(raw), Some(other)) = (raw, other) {
        return Err(CalibrationError::BadFile {
            path: dir.to_path_buf(),
            expected: "either camera raw files or other pictures".into(),
            found: format!("{} beside {}", raw.display(), other.display()),
        });
    }
    Ok(pictures)
}
