//! Patterns in the projector's pixels.

use crate::{Axis, Chessboard, Pattern, PixelRect};

/// Where a projector pixel falls on the lit face.
///
/// Takes a position in the projector's image, the centre of the first pixel being (0, 0), and
/// returns the position on the face from 0 to 1 as in [`crate::Rect`] (beyond that range
/// outside of the face), or `None` where the pixel's ray never meets the face's plane.
pub type FaceMap<'a> = &'a (dyn Fn([f64; 2]) -> Option<[f64; 2]> + Sync);

/// An image for the projector: one byte a pixel, shown as grey.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProjectorImage {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width · height` levels, row by row; 255 is projector white.
    pub data: Vec<u8>,
}

impl ProjectorImage {
    /// Sets the part of a rectangle that lies in the picture to one level.
    pub fn paint(&mut self, rect: PixelRect, level: u8) {
        let columns = rect.x0.min(self.width) as usize..rect.x1.min(self.width) as usize;
        let rows = self.data.chunks_mut(self.width.max(1) as usize);
        for row in rows.take(rect.y1 as usize).skip(rect.y0 as usize) {
            if let Some(part) = row.get_mut(columns.clone()) {
                part.fill(level);
            }
        }
    }
}

/// Samples along each edge of a pixel that an edge of the pattern runs through.
const SAMPLES: u32 = 8;

impl Pattern {
    /// The pattern in the pixels of a projector. `None` for a pattern on the face where no
    /// `face` map is known.
    ///
    /// Pixels that an edge runs through get the share of their area that is lit, from 8 × 8
    /// samples (to 1/64); whether that share of the light comes out depends on the
    /// projector's response. Rectangles narrower than a projector pixel may be missed.
    pub fn render(
        &self,
        width: u32,
        height: u32,
        face: Option<FaceMap<'_>>,
    ) -> Option<ProjectorImage> {
        let pixels = width as usize * height as usize;
        let data = match self {
            Self::Black => vec![0; pixels],
            Self::White => vec![255; pixels],
            Self::Grey { level } => vec![byte(*level); pixels],
            Self::Chessboard(board) => {
                let row = |y| (0..width).map(move |x| if board.is_dark(x, y) { 0 } else { 255 });
                (0..height).flat_map(row).collect()
            }
            &Self::GrayCode { axis, bit, inverse } => along(axis, width, height, |c| {
                let lit = ((c ^ (c >> 1)) >> bit.min(31)) & 1 == 1;
                if lit == inverse { 0 } else { 255 }
            }),
            &Self::Phase { axis, period_px, step, steps } => along(axis, width, height, |c| {
                let turns =
                    f64::from(c) / f64::from(period_px) - f64::from(step) / f64::from(steps);
                byte(0.5 + 0.5 * (std::f64::consts::TAU * turns).cos())
            }),
            Self::Face { .. } => self.render_face(width, height, face?),
        };
        Some(ProjectorImage { width, height, data })
    }

    fn render_face(&self, width: u32, height: u32, face: FaceMap<'_>) -> Vec<u8> {
        let level = |x: f64, y: f64| face([x, y]).map_or(0.0, |position| self.level_at(position));
        // Levels at the corners of all pixels: where the four of a pixel agree it is flat.
        let corner_row = |y: u32| -> Vec<f64> {
            (0..=width).map(|x| level(f64::from(x) - 0.5, f64::from(y) - 0.5)).collect()
        };
        let mut data = Vec::with_capacity(width as usize * height as usize);
        let mut above = corner_row(0);
        for y in 0..height {
            let below = corner_row(y + 1);
            for (x, (top, bottom)) in (0..width).zip(above.windows(2).zip(below.windows(2))) {
                let flat = top[0] == top[1] && top[0] == bottom[0] && top[0] == bottom[1];
                data.push(byte(if flat {
                    top[0]
                } else {
                    let offset = |i| (f64::from(i) + 0.5) / f64::from(SAMPLES) - 0.5;
                    let samples = (0..SAMPLES).flat_map(|j| (0..SAMPLES).map(move |i| (i, j)));
                    let at = |(i, j)| level(f64::from(x) + offset(i), f64::from(y) + offset(j));
                    samples.map(at).sum::<f64>() / f64::from(SAMPLES * SAMPLES)
                }));
            }
            above = below;
        }
        data
    }

    /// The level at a position on the face; 0 outside of every rectangle.
    fn level_at(&self, [x, y]: [f64; 2]) -> f64 {
        let Self::Face { rectangles } = self else { return 0.0 };
        let within = |from: f64, to: f64, at: f64| from <= at && at < to;
        let hit = rectangles.iter().find(|r| within(r.x0, r.x1, x) && within(r.y0, r.y1, y));
        hit.map_or(0.0, |r| r.level)
    }
}

impl Chessboard {
    /// Whether a projector pixel is dark: every other square of the board, the first included.
    fn is_dark(&self, x: u32, y: u32) -> bool {
        let square = |at: u32, first: u32, corners: usize| {
            let square = (at.checked_sub(first)? / self.square_px.max(1)) as usize;
            (square <= corners).then_some(square)
        };
        match (square(x, self.x0, self.columns), square(y, self.y0, self.rows)) {
            (Some(i), Some(j)) => (i + j) % 2 == 0,
            _ => false,
        }
    }
}

/// A picture of stripes: `level` of a pixel's column (x) or row (y).
fn along(axis: Axis, width: u32, height: u32, level: impl Fn(u32) -> u8) -> Vec<u8> {
    match axis {
        Axis::X => {
            let row: Vec<u8> = (0..width).map(level).collect();
            row.repeat(height as usize)
        }
        Axis::Y => {
            (0..height).flat_map(|y| std::iter::repeat_n(level(y), width as usize)).collect()
        }
    }
}

fn byte(level: f64) -> u8 {
    (level * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A face of 37.3 × 21.7 projector pixels, turned by 20 degrees: the light on it must add
    /// up to the area of the region.
    #[test]
    fn a_turned_region_keeps_its_area() {
        let (sin, cos) = 20_f64.to_radians().sin_cos();
        let map = |[x, y]: [f64; 2]| {
            let (x, y) = (x - 30.0, y - 30.0);
            Some([(cos * x + sin * y) / 37.3 + 0.5, (-sin * x + cos * y) / 21.7 + 0.5])
        };
        let image = Pattern::region(2, 1, 1).render(64, 64, Some(&map)).unwrap();
        let lit: f64 = image.data.iter().map(|&v| f64::from(v) / 255.0).sum();
        // About 80 edge pixels, each to 1/64 and unrelated to each other: 0.15 px in all.
        let area = 37.3 / 2.0 * 21.7;
        assert!((lit - area).abs() < 0.6, "{lit} instead of {area}");
    }

    #[test]
    fn pixel_centres_are_whole_numbers() {
        let map = |[x, y]: [f64; 2]| Some([(x + 0.5) / 4.0, (y + 0.5) / 2.0]);
        let image = Pattern::region(4, 2, 4 + 2).render(4, 2, Some(&map)).unwrap();
        assert_eq!(image.data, [0, 0, 0, 0, 0, 0, 255, 0]);
        assert!(Pattern::full_face().render(4, 2, None).is_none());
    }

    #[test]
    fn a_pixel_that_is_half_lit_gets_half() {
        // Three pixels across the face: the edge between two columns halves the middle one.
        let map = |[x, y]: [f64; 2]| Some([(x + 0.5) / 3.0, y + 0.5]);
        let image = Pattern::region(2, 1, 0).render(3, 1, Some(&map)).unwrap();
        assert_eq!(image.data, [255, 128, 0]);
    }

    #[test]
    fn codes_count_columns_and_rows() {
        let lit = |axis, bit, inverse| {
            Pattern::GrayCode { axis, bit, inverse }.render(4, 3, None).unwrap().data
        };
        // Gray code of 0 to 3: 00 01 11 10.
        assert_eq!(lit(Axis::X, 0, false)[..4], [0, 255, 255, 0]);
        assert_eq!(lit(Axis::X, 1, true)[8..], [255, 255, 0, 0]);
        assert_eq!(lit(Axis::Y, 1, false), [0, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255, 255]);
        let wave = Pattern::Phase { axis: Axis::X, period_px: 4, step: 1, steps: 4 };
        // What lies half-way between two bytes may go to either.
        assert_eq!(wave.render(4, 1, None).unwrap().data, [128, 255, 128, 0]);
    }

    #[test]
    fn corners_lie_where_the_squares_meet() {
        let board = Chessboard { columns: 3, rows: 2, square_px: 5, x0: 7, y0: 4 };
        let image = Pattern::Chessboard(board).render(40, 30, None).unwrap();
        let at = |x: f64, y: f64| image.data[y as usize * 40 + x as usize];
        assert_eq!(board.corners_px().len(), 6);
        for [x, y] in board.corners_px() {
            // Between pixels, whose centres are whole numbers.
            assert_eq!((x.fract(), y.fract()), (0.5, 0.5));
            // The pixels around a corner: equal across the diagonal, different along an edge.
            let around = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
            let [a, b, c, d] = around.map(|(dx, dy)| at(x + dx, y + dy));
            assert!(a == c && b == d && a != b, "({x}, {y}): {a} {b} {c} {d}");
        }
        // Dark at the first square, white ground outside.
        assert_eq!((at(7.0, 4.0), at(6.0, 4.0), at(27.0, 4.0)), (0, 255, 255));
    }
}
