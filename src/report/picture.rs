//! Small maps as PNG inside the page, one pixel a cell; the browser scales them up.

use crate::Failure;
use crate::report::colour::{MASKED, diverging, sequential, srgb};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError, Filter};

/// Steps of a scale of colours: a step in lightness is hardly seen, and noise below it, which would make
/// up most of a large page, is not shown.
const STEPS: u8 = 96;

/// A picture as a `data:` address: bytes of `RGB`, or places in a palette where there is one.
fn data_uri(
    [width, height]: [usize; 2],
    bytes: &[u8],
    palette: Option<&[[u8; 3]]>,
) -> Result<String, Failure> {
    let size = |n: usize| u32::try_from(n).map_err(Failure::other);
    let (width, height) = (size(width)?, size(height)?);
    let encode = || -> Result<Vec<u8>, EncodingError> {
        let mut png = Vec::new();
        let mut encoder = Encoder::new(&mut png, width, height);
        encoder.set_depth(BitDepth::Eight);
        match palette {
            Some(colours) => {
                encoder.set_color(ColorType::Indexed);
                encoder.set_palette(colours.as_flattened().to_vec());
            }
            None => encoder.set_color(ColorType::Rgb),
        }
        encoder.set_compression(Compression::High);
        // Places in a palette follow the scale, so that neighbours differ little there too.
        encoder.set_filter(Filter::Adaptive);
        encoder.write_header()?.write_image_data(bytes)?;
        Ok(png)
    };
    let png = encode()
        .map_err(|e| Failure::other(format!("a picture of the report cannot be encoded: {e}")))?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(png)))
}

/// A picture in the colours of a scale: `values` are places on it from 0 to 1, None is grey.
fn scaled(
    size: [usize; 2],
    values: impl Iterator<Item = Option<f64>>,
    colour: impl Fn(f64) -> [u8; 3],
) -> Result<String, Failure> {
    let steps = f64::from(STEPS);
    let mut palette: Vec<[u8; 3]> = (0..=STEPS).map(|i| colour(f64::from(i) / steps)).collect();
    palette.push(MASKED);
    // What is no number comes out as 0, which is where the scales put it.
    let place = |v: f64| (v.clamp(0.0, 1.0) * steps).round() as u8;
    let places: Vec<u8> = values.map(|v| v.map_or(STEPS + 1, place)).collect();
    data_uri(size, &places, Some(&palette))
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
    data_uri(cells, pixels.as_flattened(), None)
}

/// A signed map; None is a cell that was not compared.
pub(crate) fn signed(
    cells: [usize; 2],
    values: &[Option<f64>],
    limit: f64,
) -> Result<String, Failure> {
    let places = values.iter().map(|v| v.map(|v| 0.5 + 0.5 * v / limit));
    scaled(cells, places, |t| diverging(2.0 * t - 1.0))
}

/// All slices of a volume below each other, in logarithmic colours over `range`; grey where infinite.
pub(crate) fn slices(
    [nx, ny, nz]: [usize; 3],
    values: &[f32],
    range: [f64; 2],
) -> Result<String, Failure> {
    let [low, high] = range.map(f64::ln);
    let place = |v: &f32| match f64::from(*v) {
        f64::INFINITY => None,
        v => Some((v.ln() - low) / (high - low)),
    };
    scaled([nx, ny * nz], values.iter().map(place), sequential)
}

/// Shares of a maximum, 0 to 1, row by row.
pub(crate) fn shares(size: [usize; 2], values: &[f64]) -> Result<String, Failure> {
    scaled(size, values.iter().map(|v| Some(*v)), sequential)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(uri: &str) -> Vec<[u8; 3]> {
        let text = uri.strip_prefix("data:image/png;base64,").unwrap();
        let png = image::load_from_memory(&STANDARD.decode(text).unwrap()).unwrap();
        png.to_rgb8().pixels().map(|p| p.0).collect()
    }

    /// Values at the ends and the middle of a scale have its very colours, others those of the next
    /// step; what is beyond has the colour of the end.
    #[test]
    fn colours_are_those_of_the_scale() {
        let values = [0.1_f32, 1.0, 10.0, 100.0, f32::INFINITY, 0.11];
        let seen = decoded(&slices([3, 1, 2], &values, [0.1, 10.0]).unwrap());
        let [first, middle, last] = [0.0, 0.5, 1.0].map(sequential);
        let near = sequential((0.11_f64 / 0.1).ln() / 100_f64.ln());
        assert_eq!(seen[..5], [first, middle, last, last, MASKED]);
        // Half a step of 96 in lightness is 0.004 of 1, a few codes of 255.
        assert!(
            seen[5].iter().zip(near).all(|(a, b)| a.abs_diff(b) <= 4),
            "{:?} {near:?}",
            seen[5]
        );
        let seen = decoded(&signed([3, 1], &[Some(-2.0), Some(0.0), None], 2.0).unwrap());
        assert_eq!(seen, [diverging(-1.0), diverging(0.0), MASKED]);
    }

    #[test]
    fn radiance_is_shown_as_it_is() {
        let maps = [vec![0.0, 0.5], vec![1.0, 0.5], vec![2.0, 0.5]];
        let seen = decoded(&radiance([2, 1], &maps, 1.0).unwrap());
        assert_eq!(seen, [[0, 255, 255], [srgb(0.5); 3]]);
    }
}
