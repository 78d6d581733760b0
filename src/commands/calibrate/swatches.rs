//! The chart as a picture: what each patch should be, beside what it came out as.

use crate::Failure;
use calibration::ColourCalibration;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

/// Edge of a patch and width of the lines between, pixels.
const PATCH: usize = 96;
const LINE: usize = 8;
const SIZE: [usize; 2] = [6 * (PATCH + LINE) + LINE, 4 * (PATCH + LINE) + LINE];

/// A PNG: in each patch the reference on the left and the corrected colour on the right.
pub(crate) fn draw(result: &ColourCalibration) -> Result<Vec<u8>, Failure> {
    let pixel = |i: usize| -> [u8; 3] {
        let place = [i % SIZE[0], i / SIZE[0]];
        let cell = place.map(|v| v / (PATCH + LINE));
        let within = place.map(|v| v % (PATCH + LINE));
        let line = within.iter().any(|v| *v < LINE);
        match result.patches.get(6 * cell[1] + cell[0]) {
            Some(patch) if !line => patch.srgb[usize::from(within[0] >= LINE + PATCH / 2)],
            _ => [24; 3],
        }
    };
    let pixels: Vec<u8> = (0..SIZE[0] * SIZE[1]).flat_map(pixel).collect();
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(&pixels, SIZE[0] as u32, SIZE[1] as u32, ExtendedColorType::Rgb8)
        .map_err(|e| Failure::other(format!("the picture of the chart cannot be encoded: {e}")))?;
    Ok(png)
}
