//! A frame in a few numbers, gathered row by row while it is in the processor's cache.

use serde::{Deserialize, Serialize};

use crate::{Frame, FrameError, FrameStats, PatchStats};

/// Every how many rows the focus score looks: it is one number of millions of pixels.
const FOCUS_STEP: usize = 4;

/// Tiles that a frame is cut into, columns and rows.
pub(crate) const TILES: [usize; 2] = [8, 32];

/// Single pixels that are remembered of a frame, columns and rows.
pub(crate) const PROBES: [usize; 2] = [128, 64];

/// A rectangle of the camera's picture or the projector's, whole pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelRect {
    /// First column.
    pub x0: u32,
    /// First row.
    pub y0: u32,
    /// Column after the last.
    pub x1: u32,
    /// Row after the last.
    pub y1: u32,
}

impl PixelRect {
    /// Whether it holds a pixel, and none outside of a picture of that size.
    pub fn fits(&self, width: u32, height: u32) -> bool {
        self.x0 < self.x1 && self.y0 < self.y1 && self.x1 <= width && self.y1 <= height
    }
}

impl Frame {
    /// Range, mean and clipping over all pixels and channels, and focus.
    pub fn stats(&self) -> FrameStats {
        let mut survey = Survey::new(self, None);
        let row_values = self.width as usize * usize::from(self.channels);
        for row in self.data.chunks(row_values.max(1)) {
            // Values that no camera gives are the business of `check`.
            let _ = survey.row(row);
        }
        survey.stats()
    }
}

/// The middle of part `i` of `parts` of so many pixels.
pub(crate) fn probed(i: usize, parts: usize, pixels: usize) -> usize {
    (2 * i + 1) * pixels / (2 * parts)
}

/// Sum and contrast of some rows, and how many values there were.
#[derive(Clone, Copy, Debug, Default)]
struct Contrast {
    sum: u64,
    values: u64,
    differences: u64,
    compared: u64,
}

impl Contrast {
    fn add(&mut self, row: &[u16], apart: usize) {
        // Brenner et al. 1976: squared differences of pixels two apart, of the same colour.
        for (a, b) in row.iter().zip(row.iter().skip(apart)) {
            let difference = u64::from(a.abs_diff(*b));
            self.differences += difference * difference;
        }
        self.compared += row.len().saturating_sub(apart) as u64;
    }

    fn mean(&self) -> f64 {
        self.sum as f64 / self.values.max(1) as f64
    }

    fn focus(&self) -> f64 {
        let focus = self.differences as f64 / self.compared.max(1) as f64 / self.mean().powi(2);
        // A frame of zeros has no contrast.
        if focus.is_finite() { focus } else { 0.0 }
    }
}

/// Part of the frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Tile {
    sum: u64,
    values: u64,
    clipped: u64,
}

impl Tile {
    /// Mean digital number, where nothing is clipped.
    pub fn mean(&self) -> Option<f64> {
        (self.values > 0 && self.clipped == 0).then(|| self.sum as f64 / self.values as f64)
    }
}

/// The frame in a few numbers.
pub(crate) struct Survey {
    channels: usize,
    width: usize,
    height: usize,
    clip: u16,
    rows: usize,
    min: u16,
    max: u16,
    clipped: u64,
    all: Contrast,
    patch: Option<(PixelRect, Contrast)>,
    /// Row by row, [`TILES`].
    tiles: Vec<Tile>,
    /// Green, or the only channel, of single pixels, row by row, [`PROBES`].
    probes: Vec<u16>,
}

impl Survey {
    /// Of a frame with a reference patch, or without.
    pub fn new(frame: &Frame, patch: Option<PixelRect>) -> Self {
        Self {
            channels: usize::from(frame.channels),
            width: frame.width as usize,
            height: frame.height as usize,
            clip: frame.max_value(),
            rows: 0,
            min: u16::MAX,
            max: 0,
            clipped: 0,
            all: Contrast::default(),
            patch: patch
                .filter(|patch| patch.fits(frame.width, frame.height))
                .map(|patch| (patch, Contrast::default())),
            tiles: vec![Tile::default(); TILES[0] * TILES[1]],
            probes: Vec::with_capacity(PROBES[0] * PROBES[1]),
        }
    }

    /// The next row.
    ///
    /// # Errors
    /// A value beyond the bit depth.
    pub fn row(&mut self, row: &[u16]) -> Result<(), FrameError> {
        let (mut min, mut max) = (self.min, self.max);
        let band = (self.rows * TILES[1] / self.height.max(1)).min(TILES[1] - 1);
        let width = self.tile_width() * self.channels;
        for (column, part) in row.chunks(width).enumerate() {
            let tile = &mut self.tiles[band * TILES[0] + column.min(TILES[0] - 1)];
            // 32 bits hold the sum of 65,536 values.
            for piece in part.chunks(1 << 15) {
                let (mut sum, mut clipped) = (0_u32, 0_u32);
                for &value in piece {
                    min = min.min(value);
                    max = max.max(value);
                    sum += u32::from(value);
                    clipped += u32::from(value >= self.clip);
                }
                tile.sum += u64::from(sum);
                tile.clipped += u64::from(clipped);
                self.all.sum += u64::from(sum);
                self.clipped += u64::from(clipped);
            }
            tile.values += part.len() as u64;
        }
        (self.min, self.max) = (min, max);
        self.all.values += row.len() as u64;
        if self.rows.is_multiple_of(FOCUS_STEP) {
            self.all.add(row, 2 * self.channels);
        }
        if let Some((rect, contrast)) = &mut self.patch
            && (rect.y0 as usize..rect.y1 as usize).contains(&self.rows)
        {
            let columns = rect.x0 as usize * self.channels..rect.x1 as usize * self.channels;
            let part = row.get(columns).unwrap_or_default();
            contrast.add(part, 2 * self.channels);
            contrast.sum += part.iter().map(|&v| u64::from(v)).sum::<u64>();
            contrast.values += part.len() as u64;
        }
        // In the middle of each part; a picture of fewer rows is probed more than once.
        while self.probes.len() < PROBES[0] * PROBES[1]
            && probed(self.probes.len() / PROBES[0], PROBES[1], self.height) == self.rows
        {
            let channel = self.channels / 2;
            let at = |i| probed(i, PROBES[0], self.width) * self.channels + channel;
            self.probes.extend((0..PROBES[0]).map(|i| row.get(at(i)).copied().unwrap_or(0)));
        }
        self.rows += 1;
        if max > self.clip {
            let within = row.iter().position(|&v| v > self.clip).unwrap_or(0);
            let index = self.all.values as usize - row.len() + within;
            return Err(FrameError::Value { max: self.clip, index, value: row[within] });
        }
        Ok(())
    }

    /// Means of the tiles, row by row; `None` where something is clipped, or part of the patch,
    /// which is lit in every picture.
    pub fn tiles(&self) -> Vec<Option<f64>> {
        let width = self.tile_width();
        let of_patch = |tile: usize| {
            self.patch.is_some_and(|(rect, _)| {
                let x = tile % TILES[0] * width;
                let y = |band: usize| (band * self.height).div_ceil(TILES[1]);
                let band = tile / TILES[0];
                (rect.x0 as usize) < x + width
                    && x < rect.x1 as usize
                    && (rect.y0 as usize) < y(band + 1)
                    && y(band) < rect.y1 as usize
            })
        };
        let mean = |(i, tile): (usize, &Tile)| tile.mean().filter(|_| !of_patch(i));
        self.tiles.iter().enumerate().map(mean).collect()
    }

    /// Pixels.
    fn tile_width(&self) -> usize {
        self.width.div_ceil(TILES[0]).max(1)
    }

    /// Single pixels, row by row; `None` where one is clipped or of the patch.
    pub fn probes(&self) -> Vec<Option<u16>> {
        let of_patch = |i: usize| {
            self.patch.is_some_and(|(rect, _)| {
                let x = probed(i % PROBES[0], PROBES[0], self.width) as u32;
                let y = probed(i / PROBES[0], PROBES[1], self.height) as u32;
                (rect.x0..rect.x1).contains(&x) && (rect.y0..rect.y1).contains(&y)
            })
        };
        let value = |(i, &v): (usize, &u16)| (v < self.clip && !of_patch(i)).then_some(v);
        self.probes.iter().enumerate().map(value).collect()
    }

    /// Rows of the frame.
    pub fn height(&self) -> u32 {
        self.height as u32
    }

    /// Largest number that the camera can give.
    pub fn full_scale(&self) -> f64 {
        f64::from(self.clip)
    }

    pub fn stats(&self) -> FrameStats {
        FrameStats {
            min: self.min.min(self.max),
            max: self.max,
            mean: self.all.mean(),
            clipped_share: self.clipped as f64 / self.all.values.max(1) as f64,
            focus: self.all.focus(),
            patch: self.patch.map(|(_, c)| PatchStats { mean: c.mean(), focus: c.focus() }),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn frame(width: u32, height: u32, channels: u8) -> Frame {
        let n = width * height * u32::from(channels);
        // Squares modulo a prime: every digit changes from value to value.
        let data = (0..n).map(|i| (i.wrapping_mul(i) % 4093) as u16).collect();
        Frame { width, height, channels, bit_depth: 12, data, exposure_s: 0.5 }
    }

    #[test]
    fn a_frame_is_surveyed_as_its_definition_says() {
        let frame = frame(50, 9, 3);
        let stats = frame.stats();
        let mean = frame.data.iter().map(|&v| f64::from(v)).sum::<f64>() / 1350.0;
        let mut focus = 0.0;
        for row in [0_usize, 4, 8] {
            for column in 0..48 {
                for channel in 0..3 {
                    let at = |column| f64::from(frame.data[(row * 50 + column) * 3 + channel]);
                    focus += (at(column + 2) - at(column)).powi(2);
                }
            }
        }
        focus /= f64::from(3 * 48 * 3) * mean * mean;
        // Rounding of some thousand additions in double precision.
        assert!((stats.mean - mean).abs() < 1e-9 && (stats.focus / focus - 1.0).abs() < 1e-12);
        assert_eq!(stats.max, *frame.data.iter().max().unwrap());
        assert_eq!(stats.min, 0);
        let mut clipped = frame.clone();
        clipped.data[..27].fill(4095);
        assert_eq!(clipped.stats().clipped_share, 0.02);
    }
}
