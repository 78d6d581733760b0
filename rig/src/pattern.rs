//! What the projector shows, as data: small, comparable, and independent of the projector.

use serde::{Deserialize, Serialize};

/// A pattern of light.
///
/// Levels are the projector's input as a share of full scale, 0 to 1. Only 0 and 1 say how
/// much light there is without knowing the projector's response.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Pattern {
    /// Every projector pixel off: what is left is ambient light and the projector's pedestal.
    Black,
    /// Every projector pixel full on.
    White,
    /// Every projector pixel at one level.
    Grey {
        /// 0 to 1.
        level: f64,
    },
    /// Rectangles on the lit face, dark elsewhere.
    Face {
        /// The rectangles; they do not overlap.
        rectangles: Vec<Rect>,
    },
    /// A chessboard in projector pixels, for calibrating the projector.
    Chessboard(Chessboard),
    /// One bit of the Gray code of the projector's columns (axis x) or rows (axis y).
    GrayCode {
        /// Along which the code counts.
        axis: Axis,
        /// Which bit of the Gray code c ⊕ (c ≫ 1) of column c; bit 0 changes most often.
        bit: u32,
        /// Whether light and dark are exchanged.
        inverse: bool,
    },
    /// A sinusoid over the projector's columns (axis x) or rows (axis y):
    /// 1/2 + 1/2 cos(2π (c / period − step / steps)) at column c.
    Phase {
        /// Along which it runs.
        axis: Axis,
        /// Projector pixels a period.
        period_px: u32,
        /// Which of the steps, from 0.
        step: u32,
        /// Into how many steps a period is divided, at least 3.
        steps: u32,
    },
}

/// A lit rectangle on the lit face.
///
/// Positions run from 0 to 1 across the face in the directions of the sample frame: x to the
/// right and y down as the camera sees it, on the front and on the back face alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rect {
    /// Left edge.
    pub x0: f64,
    /// Top edge.
    pub y0: f64,
    /// Right edge.
    pub x1: f64,
    /// Bottom edge.
    pub y1: f64,
    /// 0 to 1.
    pub level: f64,
}

/// A chessboard in the projector's image, on a white ground.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chessboard {
    /// Inner corners a row; there is one square more.
    pub columns: usize,
    /// Inner corners a column; there is one square more.
    pub rows: usize,
    /// Edge of a square, whole projector pixels, so that edges fall between pixels.
    pub square_px: u32,
    /// First projector column of the first square, which is black.
    pub x0: u32,
    /// First projector row of the first square.
    pub y0: u32,
}

/// More inner corners a row or column than any projector could show.
const MOST_CORNERS: usize = 500;

/// Bits that count more pixels than any projector has.
const MOST_BITS: u32 = 16;

/// A direction on the face or in the projector's picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axis {
    /// To the right.
    X,
    /// Down.
    Y,
}

/// What is wrong with a pattern.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PatternError {
    /// A level that no projector has.
    #[error("levels lie between 0 and 1, found {0}")]
    Level(f64),
    /// A rectangle outside of the face, inside out, or empty.
    #[error(
        "rectangle {index}: expected 0 ≤ x0 < x1 ≤ 1 and 0 ≤ y0 < y1 ≤ 1, found \
         x {} to {}, y {} to {}", rect.x0, rect.x1, rect.y0, rect.y1
    )]
    Rect {
        /// Which rectangle.
        index: usize,
        /// The rectangle.
        rect: Rect,
    },
    /// Two rectangles that share more than an edge.
    #[error("rectangles {0} and {1} overlap")]
    Overlap(usize, usize),
    /// A chessboard without corners or squares, or with more corners than a projector has pixels for.
    #[error(
        "a chessboard needs 2 to {MOST_CORNERS} inner corners a row and a column and squares of at least a pixel, found {0} × {1} and {2} px"
    )]
    Chessboard(usize, usize, u32),
    /// A bit that no projector's code has.
    #[error("a Gray code has {MOST_BITS} bits at most, counted from 0, found bit {0}")]
    Bit(u32),
    /// A sinusoid that is none.
    #[error(
        "a phase shift needs a period of at least 4 projector pixels, at least 3 steps and one of them, found {period_px} px and step {step} of {steps}"
    )]
    Phase {
        /// Projector pixels a period.
        period_px: u32,
        /// Which step.
        step: u32,
        /// Steps.
        steps: u32,
    },
}

impl Pattern {
    /// The whole lit face and nothing beside it.
    pub fn full_face() -> Self {
        Self::face([Rect::lit(0.0, 0.0, 1.0, 1.0)])
    }

    /// Region `index` (row by row) of the lit face cut into `columns` × `rows`.
    pub fn region(columns: usize, rows: usize, index: usize) -> Self {
        Self::shifted_region(columns, rows, index, [0.0, 0.0])
    }

    /// A region moved by `shift` regions to the right and down and cut off at the edge of
    /// the face; nothing is lit where it has left the face altogether.
    pub fn shifted_region(columns: usize, rows: usize, index: usize, shift: [f64; 2]) -> Self {
        let (columns, rows) = (columns.max(1), rows.max(1));
        let edge = |i: usize, n: usize, shift: f64| ((i as f64 + shift) / n as f64).clamp(0.0, 1.0);
        let (column, row) = (index % columns, index / columns);
        let rect = Rect::lit(
            edge(column, columns, shift[0]),
            edge(row, rows, shift[1]),
            edge(column + 1, columns, shift[0]),
            edge(row + 1, rows, shift[1]),
        );
        Self::face((rect.x0 < rect.x1 && rect.y0 < rect.y1).then_some(rect))
    }

    /// Those regions of the lit face, cut into `columns` × `rows`, whose index `lit` tells, row by
    /// row; neighbours in a row become one rectangle.
    pub fn regions(columns: usize, rows: usize, lit: impl Fn(usize) -> bool) -> Self {
        let edge = |i: usize, n: usize| i as f64 / n as f64;
        let mut rectangles = Vec::new();
        for row in 0..rows {
            let on = |column: usize| column < columns && lit(row * columns + column);
            let mut column = 0;
            while column < columns {
                let end = (column..columns).find(|&c| !on(c)).unwrap_or(columns);
                if end > column {
                    let (x0, x1) = (edge(column, columns), edge(end, columns));
                    rectangles.push(Rect::lit(x0, edge(row, rows), x1, edge(row + 1, rows)));
                }
                column = end + 1;
            }
        }
        Self::face(rectangles)
    }

    /// `count` lit stripes that follow each other along `axis`, each followed by a dark one
    /// as wide.
    pub fn stripes(count: usize, axis: Axis) -> Self {
        let edge = |i: usize| i as f64 / (2 * count) as f64;
        Self::face((0..count).map(|i| {
            let (from, to) = (edge(2 * i), edge(2 * i + 1));
            match axis {
                Axis::X => Rect::lit(from, 0.0, to, 1.0),
                Axis::Y => Rect::lit(0.0, from, 1.0, to),
            }
        }))
    }

    /// Every other of `columns` × `rows` fields, the first one lit.
    pub fn checker(columns: usize, rows: usize) -> Self {
        let edge = |i: usize, n: usize| i as f64 / n as f64;
        let fields = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
        Self::face(fields.filter(|(x, y)| (x + y) % 2 == 0).map(|(x, y)| {
            Rect::lit(edge(x, columns), edge(y, rows), edge(x + 1, columns), edge(y + 1, rows))
        }))
    }

    fn face(rectangles: impl IntoIterator<Item = Rect>) -> Self {
        Self::Face { rectangles: rectangles.into_iter().collect() }
    }

    /// Checks a pattern that came from outside.
    ///
    /// # Errors
    /// Levels or rectangles out of range, rectangles that overlap, a chessboard without corners.
    pub fn check(&self) -> Result<(), PatternError> {
        match self {
            Self::Black | Self::White => Ok(()),
            Self::Grey { level } => check_level(*level),
            Self::Face { rectangles } => {
                for (index, &rect) in rectangles.iter().enumerate() {
                    let inside = |from: f64, to: f64| 0.0 <= from && from < to && to <= 1.0;
                    if !(inside(rect.x0, rect.x1) && inside(rect.y0, rect.y1)) {
                        return Err(PatternError::Rect { index, rect });
                    }
                    check_level(rect.level)?;
                    if let Some(other) = rectangles[..index].iter().position(|o| o.overlaps(&rect))
                    {
                        return Err(PatternError::Overlap(other, index));
                    }
                }
                Ok(())
            }
            &Self::GrayCode { bit, .. } if bit >= MOST_BITS => Err(PatternError::Bit(bit)),
            Self::GrayCode { .. } => Ok(()),
            &Self::Phase { period_px, step, steps, .. } => {
                if period_px < 4 || steps < 3 || step >= steps {
                    return Err(PatternError::Phase { period_px, step, steps });
                }
                Ok(())
            }
            &Self::Chessboard(Chessboard { columns, rows, square_px, .. }) => {
                if ![columns, rows].iter().all(|n| (2..=MOST_CORNERS).contains(n)) || square_px == 0
                {
                    return Err(PatternError::Chessboard(columns, rows, square_px));
                }
                Ok(())
            }
        }
    }

    /// Irradiance on each of `nx × ny` cells of the lit face, projector white being 1: the
    /// exact share of the cell's area that is lit, times the level. x fastest.
    ///
    /// `None` for chessboards and codes, which lie in the projector's pixels, not on the face.
    pub fn coverage(&self, nx: usize, ny: usize) -> Option<Vec<f32>> {
        match self {
            Self::Black => Some(vec![0.0; nx * ny]),
            Self::White => Some(vec![1.0; nx * ny]),
            Self::Grey { level } => Some(vec![*level as f32; nx * ny]),
            Self::Chessboard(_) | Self::GrayCode { .. } | Self::Phase { .. } => None,
            Self::Face { rectangles } => {
                let mut total = vec![0.0_f64; nx * ny];
                for rect in rectangles {
                    let (across, down) =
                        (shares(rect.x0, rect.x1, nx), shares(rect.y0, rect.y1, ny));
                    for (row, &y) in total.chunks_exact_mut(nx.max(1)).zip(&down) {
                        if y > 0.0 {
                            row.iter_mut().zip(&across).for_each(|(t, x)| *t += rect.level * x * y);
                        }
                    }
                }
                Some(total.into_iter().map(|t| t as f32).collect())
            }
        }
    }
}

fn check_level(level: f64) -> Result<(), PatternError> {
    if (0.0..=1.0).contains(&level) { Ok(()) } else { Err(PatternError::Level(level)) }
}

/// The share of each of `n` equal cells of [0, 1] that lies between `from` and `to`.
fn shares(from: f64, to: f64, n: usize) -> Vec<f64> {
    let (from, to) = (from * n as f64, to * n as f64);
    (0..n).map(|i| (to.min(i as f64 + 1.0) - from.max(i as f64)).clamp(0.0, 1.0)).collect()
}

impl Rect {
    /// A rectangle at full level.
    pub fn lit(x0: f64, y0: f64, x1: f64, y1: f64) -> Self {
        Self { x0, y0, x1, y1, level: 1.0 }
    }

    fn overlaps(&self, other: &Rect) -> bool {
        // Edges computed in two ways may differ in the last digits.
        const ROUNDING: f64 = 1e-9;
        let shared = |a0: f64, a1: f64, b0: f64, b1: f64| a1.min(b1) - a0.max(b0) > ROUNDING;
        shared(self.x0, self.x1, other.x0, other.x1) && shared(self.y0, self.y1, other.y0, other.y1)
    }
}

impl Chessboard {
    /// Inner corners in projector pixels, row by row; the centre of the first pixel is (0, 0).
    pub fn corners_px(&self) -> Vec<[f64; 2]> {
        let at = |first: u32, i: usize| {
            f64::from(first) + (i + 1) as f64 * f64::from(self.square_px) - 0.5
        };
        let row = |j: usize| (0..self.columns).map(move |i| [at(self.x0, i), at(self.y0, j)]);
        (0..self.rows).flat_map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sum(pattern: &Pattern, nx: usize, ny: usize) -> f64 {
        let cells = pattern.coverage(nx, ny).unwrap();
        cells.iter().map(|&c| f64::from(c)).sum::<f64>() / (nx * ny) as f64
    }

    #[test]
    fn the_regions_tile_the_face_whatever_the_grid() {
        let (nx, ny) = (13, 7);
        let mut total = vec![0.0_f64; nx * ny];
        for index in 0..16 {
            let region = Pattern::region(4, 4, index);
            region.check().unwrap();
            // Sixteen f32 roundings of shares below 1.
            assert!((sum(&region, nx, ny) - 1.0 / 16.0).abs() < 1e-7);
            let cells = region.coverage(nx, ny).unwrap();
            total.iter_mut().zip(cells).for_each(|(t, c)| *t += f64::from(c));
        }
        assert!(total.iter().all(|t| (t - 1.0).abs() < 1e-6));
    }

    #[test]
    fn region_lies_where_its_row_and_column_say() {
        // Column 1 of 4 and row 2 of 3 on a grid that has two cells a column.
        let cells = Pattern::region(4, 3, 2 * 4 + 1).coverage(8, 3).unwrap();
        let lit: Vec<usize> =
            cells.iter().enumerate().filter(|(_, c)| **c > 0.5).map(|(i, _)| i).collect();
        assert_eq!(lit, [2 * 8 + 2, 2 * 8 + 3]);
    }

    #[test]
    fn regions_that_touch_in_a_row_are_one_rectangle() {
        let lit = [1, 2, 4, 7, 8, 9, 10, 11];
        let pattern = Pattern::regions(4, 3, |i| lit.contains(&i));
        pattern.check().unwrap();
        let Pattern::Face { rectangles } = &pattern else { panic!("{pattern:?}") };
        assert_eq!(rectangles.len(), 4, "{rectangles:?}");
        let mut sum = vec![0.0_f32; 13 * 7];
        for index in lit {
            let cells = Pattern::region(4, 3, index).coverage(13, 7).unwrap();
            sum.iter_mut().zip(cells).for_each(|(s, c)| *s += c);
        }
        // A few roundings of single precision.
        let together = pattern.coverage(13, 7).unwrap();
        assert!(sum.iter().zip(&together).all(|(a, b)| (a - b).abs() < 1e-6), "{together:?}");
    }

    #[test]
    fn half_covered_cells_count_half() {
        let cells = Pattern::shifted_region(2, 1, 0, [0.5, 0.0]).coverage(2, 1).unwrap();
        assert_eq!(cells, [0.5, 0.5]);
        assert_eq!(Pattern::shifted_region(2, 1, 1, [1.0, 0.0]).coverage(2, 1).unwrap(), [0.0; 2]);
    }

    #[test]
    fn held_out_patterns_light_half_of_the_face() {
        for pattern in
            [Pattern::stripes(3, Axis::X), Pattern::stripes(5, Axis::Y), Pattern::checker(4, 6)]
        {
            pattern.check().unwrap();
            assert!((sum(&pattern, 11, 9) - 0.5).abs() < 1e-7, "{pattern:?}");
        }
    }

    #[test]
    fn bad_patterns_are_named() {
        let two =
            |second: Rect| Pattern::Face { rectangles: vec![Rect::lit(0., 0., 0.5, 0.5), second] };
        assert!(two(Rect::lit(0.5, 0.0, 1.0, 0.5)).check().is_ok());
        assert_eq!(two(Rect::lit(0.4, 0.4, 1.0, 1.0)).check(), Err(PatternError::Overlap(0, 1)));
        assert!(matches!(
            two(Rect::lit(0.5, f64::NAN, 1.0, 1.0)).check(),
            Err(PatternError::Rect { index: 1, .. })
        ));
        assert_eq!(Pattern::Grey { level: 1.5 }.check(), Err(PatternError::Level(1.5)));
        let board = Chessboard { columns: 1, rows: 5, square_px: 8, x0: 0, y0: 0 };
        assert!(Pattern::Chessboard(board).check().is_err());
        let board = Chessboard { columns: usize::MAX, ..board };
        assert!(Pattern::Chessboard(board).check().is_err());
        let bit = Pattern::GrayCode { axis: Axis::X, bit: 16, inverse: false };
        assert_eq!(bit.check(), Err(PatternError::Bit(16)));
        for (period_px, step, steps) in [(3, 0, 4), (16, 0, 2), (16, 4, 4)] {
            let phase = Pattern::Phase { axis: Axis::Y, period_px, step, steps };
            assert!(matches!(phase.check(), Err(PatternError::Phase { .. })), "{phase:?}");
        }
    }
}
