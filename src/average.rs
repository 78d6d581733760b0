//! Rectified pictures onto the sample's grid.

use calibration::{FaceMap, HdrImage};
use diffusion::overlaps;

/// Averages a picture whose extent is the face over nx × ny cells: every pixel counts by the share
/// of the cell that it covers.
///
/// Variances are those of the mean of independent pixels; a cell that touches a pixel without a
/// value has infinite variance. The picture has at least one pixel a cell (the caller's to check).
pub(crate) fn onto_cells(image: &HdrImage, [nx, ny]: [usize; 2]) -> FaceMap {
    let (columns, rows) = (overlaps(image.width, nx), overlaps(image.height, ny));
    let channels = image.channels;
    let face = nx * ny;
    let mut radiance = vec![0.0; channels * face];
    let mut variance = vec![0.0; channels * face];
    for (y, row) in rows.iter().enumerate() {
        for (x, column) in columns.iter().enumerate() {
            for c in 0..channels {
                let (mut mean, mut spread) = (0.0, 0.0);
                for (j, wy) in row {
                    for (i, wx) in column {
                        let at = (j * image.width + i) * channels + c;
                        let w = wx * wy;
                        mean += w * f64::from(image.radiance[at]);
                        spread += w * w * f64::from(image.variance[at]);
                    }
                }
                radiance[c * face + y * nx + x] = mean as f32;
                variance[c * face + y * nx + x] = spread as f32;
            }
        }
    }
    FaceMap { nx, ny, channels, radiance, variance }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> HdrImage {
        let radiance: Vec<f32> = (0..width * height).map(|i| value(i % width, i / width)).collect();
        HdrImage {
            width,
            height,
            channels: 1,
            variance: vec![1.0; radiance.len()],
            radiance,
            variance_known: true,
            clipped_shortest: 0,
            lost_longest: 0,
        }
    }

    /// The mean over a cell of a ramp is its value in the middle: exact but for f32's rounding.
    #[test]
    fn a_ramp_stays_a_ramp() {
        for (width, cells) in [(12, 4), (10, 4), (7, 7), (9, 2)] {
            // Radiance of pixel i is the integral of x over it.
            let map = onto_cells(&picture(width, 3, |x, _| x as f32 + 0.5), [cells, 2]);
            let size = width as f64 / cells as f64;
            for c in 0..cells {
                // A linear function of x, pixel by pixel constant: weigh the pixels by hand.
                let (from, to) = (c as f64 * size, (c + 1) as f64 * size);
                let by_hand: f64 = (0..width)
                    .map(|p| {
                        let share = ((p + 1) as f64).min(to) - (p as f64).max(from);
                        share.max(0.0) / size * (p as f64 + 0.5)
                    })
                    .sum();
                assert!((f64::from(map.radiance[c]) - by_hand).abs() < 1e-5, "{width} {cells} {c}");
            }
        }
    }

    /// Four pixels of variance 1 have a mean of variance 1/4; the hole spoils its cell only.
    #[test]
    fn variance_is_that_of_the_mean() {
        let mut image = picture(4, 4, |_, _| 1.0);
        image.variance[0] = f32::INFINITY;
        let map = onto_cells(&image, [2, 2]);
        assert_eq!(map.variance, [f32::INFINITY, 0.25, 0.25, 0.25]);
        assert_eq!(map.radiance, [1.0; 4]);
    }
}
