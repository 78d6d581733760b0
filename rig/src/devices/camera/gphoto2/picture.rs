//! From the file that a still camera hands over to digital numbers.

use image::ImageFormat;
use raw::{RawError, RawMosaic};

use crate::DeviceError;
use crate::devices::camera::superpixels;

/// A picture of three channels.
#[derive(Debug, PartialEq)]
pub struct Picture {
    pub width: u32,
    pub height: u32,
    /// 8 of a JPEG, those of the sensor of a raw file.
    pub bit_depth: u8,
    /// Row by row, channels interleaved.
    pub data: Vec<u16>,
    /// What a raw file notes, s.
    pub exposure_s: Option<f64>,
}

/// By content as far as that tells: most raw files are TIFFs, others are known by name.
pub fn decode(device: &str, name: &str, bytes: Vec<u8>) -> Result<Picture, DeviceError> {
    let bad = |expected: &str, found: String| DeviceError::BadFrame {
        device: device.to_owned(),
        expected: expected.into(),
        found,
    };
    let format = image::guess_format(&bytes).ok();
    if format == Some(ImageFormat::Jpeg) {
        let picture = image::load_from_memory_with_format(&bytes, ImageFormat::Jpeg);
        let picture = picture.map_err(|error| bad("a whole JPEG", format!("{name}: {error}")))?;
        let picture = picture.into_rgb8();
        let (width, height) = picture.dimensions();
        let data = picture.into_raw().into_iter().map(u16::from).collect();
        return Ok(Picture { width, height, bit_depth: 8, data, exposure_s: None });
    }
    if format != Some(ImageFormat::Tiff) && !raw::is_raw(name) {
        let reason = format!(
            "{name} is neither a JPEG nor a raw file that can be read (DNG, CR2, CR3, NEF, ARW); set image_format, or the camera, to one that is"
        );
        return Err(DeviceError::Unsupported { device: device.to_owned(), reason });
    }
    let mosaic = raw::decode(name, bytes).map_err(|error| match error {
        RawError::BadFile { expected, found, .. } => bad(expected, format!("{name}: {found}")),
        other => bad("a whole camera raw file", other.to_string()),
    })?;
    developed(mosaic)
        .map_err(|found| bad("a raw file of 2 x 2 pixels or more", format!("{name}: {found}")))
}

/// The quads of a mosaic, black left in.
///
/// Sensors clip below the largest number of their bits, at a code of their own. All that comes after
/// takes the largest number for clipped: from the white level on values become that, or light
/// that was cut off would pass for measured light.
fn developed(mosaic: RawMosaic) -> Result<Picture, String> {
    let RawMosaic { width, height, codes, bayer, white_level, exposure_s, .. } = mosaic;
    let halves = (u32::try_from(width / 2), u32::try_from(height / 2));
    let (Ok(out_width @ 1..), Ok(out_height @ 1..)) = halves else {
        return Err(format!("{width} x {height} pixels"));
    };
    let bit_depth = (u16::BITS - white_level.leading_zeros()).max(8) as u8;
    let largest = u16::MAX >> (u16::BITS - u32::from(bit_depth));
    let mut data = superpixels(bayer, width, &codes, white_level);
    for value in data.iter_mut().filter(|value| **value >= white_level) {
        *value = largest;
    }
    Ok(Picture { width: out_width, height: out_height, bit_depth, data, exposure_s })
}

#[cfg(test)]
#[path = "../../../../../raw/tests/common/dng.rs"]
mod dng;

#[cfg(test)]
mod tests {
    use super::dng::Dng;
    use super::*;
    use crate::DeviceErrorKind;

    /// 7 × 5 pixels of a sensor of 14 bits that clips at 15 000; the last column and row of what
    /// sees light, 6 × 4 from (1, 1), stay whole quads. Counted from there, red is first.
    fn sensor() -> Dng {
        Dng {
            width: 7,
            height: 5,
            codes: (0..35).map(|i| 600 + 100 * i).collect(),
            filter: (2, vec![0, 1, 1, 2]),
            black: [512; 4],
            white: 15_000,
            active: [1, 1, 5, 7],
            exposure: (10, 300),
        }
    }

    #[test]
    fn a_raw_file_becomes_codes_of_half_the_size() {
        let picture = decode("x", "DSC_1.DNG", sensor().bytes()).unwrap();
        assert_eq!((picture.width, picture.height, picture.bit_depth), (3, 2, 14));
        assert_eq!(picture.exposure_s, Some(10.0 / 300.0));
        // Pixel (x, y) of the sensor has 600 + 100 (7 y + x), black of 512 among it; both greens'
        // mean is in the quad's middle. The DNG's filter is counted from the active area.
        let at = |x: usize, y: usize| 600 + 100 * (7 * y + x) as u16;
        let quad = |x: usize, y: usize| {
            let green = (at(x + 1, y) + at(x, y + 1)) / 2;
            [at(x, y), green, at(x + 1, y + 1)]
        };
        let made: Vec<u16> = [(1, 1), (3, 1), (5, 1), (1, 3), (3, 3), (5, 3)]
            .into_iter()
            .flat_map(|(x, y)| quad(x, y))
            .collect();
        assert_eq!(picture.data, made);
    }

    #[test]
    fn what_the_sensor_clipped_is_full_scale_and_what_it_did_not_is_as_it_was() {
        let mut dng = sensor();
        // Red of the first quad just below white, of the second at it; one green of the third.
        (dng.codes[7 + 1], dng.codes[7 + 3], dng.codes[7 + 6]) = (14_999, 15_000, 15_400);
        let picture = decode("x", "IMG_1.dng", dng.bytes()).unwrap();
        assert_eq!([picture.data[0], picture.data[3], picture.data[7]], [14_999, 16_383, 16_383]);
        assert_eq!(picture.data.iter().filter(|v| **v > 15_000).count(), 2);
    }

    #[test]
    fn the_bits_are_those_that_white_needs() {
        for (white, bits) in [(1_023, 10), (4_095, 12), (4_096, 13), (16_383, 14), (65_535, 16)] {
            let dng = Dng { white, black: [0; 4], ..sensor() };
            let picture = decode("x", "a.dng", dng.bytes()).unwrap();
            assert_eq!(picture.bit_depth, bits, "{white}");
            let most = u32::from(*picture.data.iter().max().unwrap());
            assert!(most < 1 << bits, "{most} in {bits} bits");
        }
    }

    #[test]
    fn other_files_and_broken_ones_are_refused_by_name() {
        let kind = |name: &str, bytes: &[u8]| {
            let error = decode("x", name, bytes.to_vec()).unwrap_err();
            assert!(error.to_string().contains(name), "{error}");
            error.kind()
        };
        assert_eq!(kind("MVI_1.MOV", b"\0\0\0\x14ftypqt"), DeviceErrorKind::Unsupported);
        let name = "a raw file by another name";
        assert_eq!(decode("x", name, sensor().bytes()).unwrap().bit_depth, 14);
        assert_eq!(kind("DSC_1.NEF", b"II*\0...."), DeviceErrorKind::Protocol);
        assert_eq!(kind("DSC_1.JPG", &[0xFF, 0xD8, 0xFF, 0xE0, 0, 16]), DeviceErrorKind::Protocol);
        let whole = sensor().bytes();
        for length in [0, 6, 20, whole.len() / 2, whole.len() - 30] {
            assert_eq!(kind("DSC_1.DNG", &whole[..length]), DeviceErrorKind::Protocol, "{length}");
        }
    }
}
