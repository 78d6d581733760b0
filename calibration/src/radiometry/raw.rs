//! Camera raw files: the sensor's own codes under its colour filter, before any development.

use std::path::Path;

use raw::Bayer;

use crate::error::Result;
use crate::photo::Photo;
use crate::radiometry::noise::NoiseModel;

/// A camera raw file: linear codes of one colour a pixel, cropped to the pixels that see light.
#[derive(Clone, Debug, PartialEq)]
pub struct RawPhoto {
    /// The codes, `width × height` of one channel. Full scale is 65535 whatever the sensor's
    /// depth: how far the codes really go is `white_level`.
    pub photo: Photo,
    /// Colours of its upper left 2 × 2 pixels.
    pub bayer: Bayer,
    /// Code without light of the upper left 2 × 2 pixels, row by row, DN.
    pub black_levels: [f64; 4],
    /// Code at which the sensor clips, DN.
    pub white_level: u16,
    /// Exposure time that the camera noted, s; None if it did not.
    pub exposure_s: Option<f64>,
}

impl RawPhoto {
    /// Mean of the four black levels, DN.
    pub fn black_level(&self) -> f64 {
        self.black_levels.iter().sum::<f64>() / 4.0
    }

    /// The noise of a middling sensor of 20 000 electrons between black and white where nothing
    /// else is known, for codes as [`Self::levelled`] at [`Self::black_level`] has them.
    pub fn noise(&self) -> NoiseModel {
        let black_level = self.black_level();
        let shifts = self.shifts(black_level);
        let lowest = shifts.into_iter().fold(0, i32::min);
        let range = (f64::from(self.white_level) + f64::from(lowest) - black_level).max(0.0);
        let gain = range / 20_000.0;
        let saturation = black_level + 0.98 * range;
        let full_scale = f64::from(self.photo.max_value);
        NoiseModel { black_level, read_noise: 5.0 * gain, gain, full_scale, saturation }
    }

    /// The mosaic with the black of every site brought to `black_level`, DN, by whole codes, as
    /// a bracket needs it: cameras measure it anew for each picture and differently for each
    /// colour. Where black is there already the codes stay as they are.
    pub fn levelled(self, black_level: f64) -> Photo {
        let shifts = self.shifts(black_level);
        let mut photo = self.photo;
        if shifts != [0; 4] {
            for (y, row) in photo.data.chunks_exact_mut(photo.width).enumerate() {
                for (x, code) in row.iter_mut().enumerate() {
                    let shift = shifts[y % 2 * 2 + x % 2];
                    *code = (i32::from(*code) + shift).clamp(0, i32::from(u16::MAX)) as u16;
                }
            }
        }
        photo
    }

    /// Codes to add at each site of a quad.
    fn shifts(&self, black_level: f64) -> [i32; 4] {
        self.black_levels.map(|black| (black_level - black).round() as i32)
    }
}

/// Reads a camera raw file (DNG, CR2, CR3, NEF, ARW).
///
/// # Errors
/// As [`raw::read`]. Every file is refused where the crate was built without its feature `raw`.
pub fn read_raw(path: impl AsRef<Path>) -> Result<RawPhoto> {
    let path = path.as_ref();
    let raw = raw::read(path)?;
    let photo = Photo {
        width: raw.width,
        height: raw.height,
        channels: 1,
        data: raw.codes,
        max_value: u16::MAX,
        name: path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned(),
    };
    Ok(RawPhoto {
        photo,
        bayer: raw.bayer,
        black_levels: raw.black_levels,
        white_level: raw.white_level,
        exposure_s: raw.exposure_s,
    })
}
