//! Small maps as PNG inside the page, one pixel a cell; the browser scales them up.

use crate::Failure;
use crate::report::colour::{MASKED, diverging, sequential, srgb};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// A picture as a `data:` address.
fn data_uri([width, height]: [usize; 2], pixels: &[[u8; 3]]) -> Result<String, Failure> {
    let mut png = Vec::new();
    let size = |n: usize| u32::try_from(n).map_err(Failure::other);
    PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::Adaptive)
        .write_image(pixels.as_flattened(), size(width)?, size(height)?, ExtendedColorType::Rgb8)
        .map_err(|e| Failure::other(format!("a picture of the report cannot be encoded: {e}")))?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(png)))
}

/// Radiance maps, one a channel, as a picture: R, G, B where there are three, else grey.
/// `white` is the radiance that comes out white.
pub(crate) fn radiance(
    cells: [usize; 2],
    maps: &[Vec<f64>],
    white: f64,
) -> Result<String, Failure> {
    let at =
        |c: usize, i: usize| maps.get(c).and_then(|m| m.get(i)).copied().unwrap_or(0.0) / white;
    let pixel = |i: usize| match maps.len() {
        3 => [0, 1, 2].map(|c| srgb(at(c, i))),
        n => [srgb((0..n).map(|c| at(c, i)).sum::<f64>() / n.max(1) as f64); 3],
    };
    let pixels: Vec<_> = (0..cells[0] * cells[1]).map(pixel).collect();
    data_uri(cells, &pixels)
}

/// A signed map; None is a cell that was not compared.
pub(crate) fn signed(
    cells: [usize; 2],
    values: &[Option<f64>],
    limit: f64,
) -> Result<String, Failure> {
    let pixels: Vec<_> =
        values.iter().map(|v| v.map_or(MASKED, |v| diverging(v / limit))).collect();
    data_uri(cells, &pixels)
}

/// All slices of a volume below each other, in logarithmic colours over `range`; grey where infinite.
pub(crate) fn slices(
    [nx, ny, nz]: [usize; 3],
    values: &[f32],
    range: [f64; 2],
) -> Result<String, Failure> {
    let [low, high] = range.map(f64::ln);
    let pixel = |v: &f32| match f64::from(*v) {
        f64::INFINITY => MASKED,
        v => sequential((v.ln() - low) / (high - low)),
    };
    let pixels: Vec<_> = values.iter().map(pixel).collect();
    data_uri([nx, ny * nz], &pixels)
}

/// Shares of a maximum, 0 to 1, row by row.
pub(crate) fn shares(size: [usize; 2], values: &[f64]) -> Result<String, Failure> {
    let pixels: Vec<_> = values.iter().map(|v| sequential(*v)).collect();
    data_uri(size, &pixels)
}
