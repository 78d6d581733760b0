//! The squares between corners: whether they are a chessboard's, and what is beyond the last ones.

use crate::detection::board::Board;
use crate::detection::found::SeenCorner;
use crate::detection::neighbours::Grid;

/// A grid of corners laid over a grey picture.
pub(crate) struct Squares<'a> {
    grid: Grid<'a>,
    columns: isize,
    rows: isize,
    grey: &'a [u8],
    width: usize,
}

/// Share of the squares that have the other colour than the ones beside them: a reflection may
/// spoil some.
const ALTERNATING: f64 = 0.9;

/// Share of a side's outermost corners at which squares of both colours meet; along a board's
/// own edge, taken for a row of corners, none.
const REAL_CORNERS: f64 = 0.7;

/// A difference counts as one of colour from this share of the usual one on.
const COLOUR_SHARE: f64 = 0.3;

/// Fewer codes are noise.
const FEWEST_CODES: f64 = 2.0;

impl<'a> Squares<'a> {
    pub fn new(board: &'a Board, corners: &[SeenCorner], grey: &'a [u8], width: usize) -> Self {
        let (columns, rows) = (board.columns as isize, board.rows as isize);
        Self { grid: Grid::new(board, corners), columns, rows, grey, width }
    }

    fn value(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let [x, y] = [x + 0.5, y + 0.5];
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64;
        let at = y as usize * self.width + x as usize;
        self.grey.get(at).filter(|_| inside).map(|&v| f64::from(v))
    }

    /// Grey in the middle of the square below and to the right of a corner.
    fn middle(&self, c: isize, r: isize) -> Option<f64> {
        let four = [(c, r), (c + 1, r), (c, r + 1), (c + 1, r + 1)];
        let mut sum = [0.0; 2];
        for (c, r) in four {
            let pixel = self.grid.at(c, r)?;
            sum = [sum[0] + pixel[0] / 4.0, sum[1] + pixel[1] / 4.0];
        }
        self.value(sum)
    }

    /// Whether the colours are those of a chessboard and these corners are all inner ones of it.
    pub fn are_a_board(&self) -> bool {
        let real = self.sides().into_iter().all(|line| {
            let outermost: Vec<_> = line.iter().map(|&[a, b, _]| [a, b]).collect();
            line.len() < 2 || self.corners_along(&outermost) >= REAL_CORNERS
        });
        real && self.alternating() >= ALTERNATING
    }

    /// Share of the squares that differ from the squares beside them the way a chessboard's do.
    fn alternating(&self) -> f64 {
        let mut steps = Vec::new();
        for r in 0..self.rows - 1 {
            for c in 0..self.columns - 1 {
                let Some(own) = self.middle(c, r) else { continue };
                let beside = [(c - 1, r), (c + 1, r), (c, r - 1), (c, r + 1)];
                let greys: Vec<f64> =
                    beside.into_iter().filter_map(|(c, r)| self.middle(c, r)).collect();
                if greys.is_empty() {
                    continue;
                }
                let mean = greys.iter().sum::<f64>() / greys.len() as f64;
                steps.push(if (c + r) % 2 == 0 { own - mean } else { mean - own });
            }
        }
        let mut sorted = steps.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        let Some(&usual) = sorted.get(sorted.len() / 2) else { return 0.0 };
        if usual.abs() < FEWEST_CODES {
            return 0.0;
        }
        let right = |s: &&f64| **s / usual > COLOUR_SHARE;
        steps.iter().filter(right).count() as f64 / steps.len() as f64
    }

    /// For each side of the grid its outermost corners, each followed by the two behind it.
    fn sides(&self) -> [Vec<[[f64; 2]; 3]>; 4] {
        [[0, 1], [0, -1], [1, 1], [1, -1]].map(|[axis, step]| {
            let (across, along) =
                if axis == 0 { (self.columns, self.rows) } else { (self.rows, self.columns) };
            let outermost = if step > 0 { across - 1 } else { 0 };
            let corner = |depth: isize, i: isize| {
                let j = outermost - step * depth;
                if axis == 0 { self.grid.at(j, i) } else { self.grid.at(i, j) }
            };
            (0..along).filter_map(|i| Some([corner(0, i)?, corner(1, i)?, corner(2, i)?])).collect()
        })
    }

    /// For each side the corners that one more line would have, each with the outermost corner
    /// that it continues from.
    fn beyond(&self) -> [Vec<[[f64; 2]; 2]>; 4] {
        self.sides().map(|line| {
            let next = line.into_iter().map(|[a, b, c]| {
                [std::array::from_fn(|k: usize| 3.0 * a[k] - 3.0 * b[k] + c[k]), a]
            });
            next.collect()
        })
    }

    /// Whether on some side the row or column beyond the outermost one has chessboard corners too.
    pub fn go_on(&self) -> bool {
        self.beyond().iter().any(|line| line.len() >= 2 && self.corners_along(line) >= REAL_CORNERS)
    }

    /// Share of a line of places, each with the one behind it, at which four squares of
    /// alternating colour meet.
    fn corners_along(&self, line: &[[[f64; 2]; 2]]) -> f64 {
        let real = line.iter().enumerate().filter(|&(i, &[at, last])| {
            let next = line.get(i + 1).or_else(|| line.get(i.wrapping_sub(1)));
            next.is_some_and(|&[next, _]| self.is_corner(at, last, next))
        });
        real.count() as f64 / line.len().max(1) as f64
    }

    /// Whether four squares of alternating colour meet at a place; `last` and `next` are the
    /// corners beside it across and along.
    fn is_corner(&self, at: [f64; 2], last: [f64; 2], next: [f64; 2]) -> bool {
        // A third of a square into each of the four.
        let square = |s: f64, t: f64| {
            self.value(std::array::from_fn(|k: usize| {
                at[k] + 0.3 * (s * (at[k] - last[k]) + t * (next[k] - at[k]))
            }))
        };
        let four = [square(1.0, 1.0), square(-1.0, -1.0), square(1.0, -1.0), square(-1.0, 1.0)];
        let [Some(a), Some(b), Some(c), Some(d)] = four else { return false };
        let gap = (a.min(b) - c.max(d)).max(c.min(d) - a.max(b));
        let spread = [a, b, c, d].iter().fold(0.0_f64, |w, v| w.max((v - a).abs()));
        gap > FEWEST_CODES && gap > COLOUR_SHARE * spread
    }

    /// Whether on some side one more line of corners would lie outside of the picture, or so near
    /// its edge that no detector sees it.
    pub fn cut_off(&self) -> bool {
        let height = self.grey.len() / self.width.max(1);
        self.beyond().iter().any(|line| {
            let outside = line.iter().filter(|[at, last]| {
                let rim = 0.35 * (at[0] - last[0]).hypot(at[1] - last[1]);
                let far = |v: f64, size: usize| v < rim || v > size as f64 - rim;
                far(at[0], self.width) || far(at[1], height)
            });
            outside.count() * 2 > line.len()
        })
    }
}
