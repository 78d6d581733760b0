//! Corners held against their neighbours on the board: distances, and who stands out of line.

use nalgebra::{SMatrix, SVector};

use crate::cv;
use crate::detection::board::Board;
use crate::detection::found::{DroppedCorner, SeenCorner};

/// Corners by their index on the board.
pub(crate) struct Grid<'a> {
    board: &'a Board,
    pixels: Vec<Option<[f64; 2]>>,
}

impl<'a> Grid<'a> {
    pub fn new(board: &'a Board, corners: &[SeenCorner]) -> Self {
        let mut pixels = vec![None; board.corners()];
        for corner in corners {
            if let Some(slot) = pixels.get_mut(corner.index) {
                *slot = Some(corner.pixel);
            }
        }
        Self { board, pixels }
    }

    /// The corner of a column and row, which may lie beyond the board.
    pub fn at(&self, column: isize, row: isize) -> Option<[f64; 2]> {
        let column = usize::try_from(column).ok().filter(|c| *c < self.board.columns)?;
        let row = usize::try_from(row).ok().filter(|r| *r < self.board.rows)?;
        self.pixels.get(row * self.board.columns + column).copied().flatten()
    }

    pub fn place(&self, index: usize) -> (isize, isize) {
        let columns = self.board.columns.max(1);
        ((index % columns) as isize, (index / columns) as isize)
    }

    /// Distance to the nearest neighbour along rows and columns, pixels; infinite without any.
    pub fn nearest(&self, index: usize) -> f64 {
        let (c, r) = self.place(index);
        let Some(own) = self.at(c, r) else { return f64::INFINITY };
        [(c - 1, r), (c + 1, r), (c, r - 1), (c, r + 1)]
            .into_iter()
            .filter_map(|(c, r)| self.at(c, r))
            .map(|q| (q[0] - own[0]).hypot(q[1] - own[1]))
            .fold(f64::INFINITY, f64::min)
    }

    /// Where the neighbours up to two places away say that a corner should be, by the plane map
    /// that fits them best: lens distortion is all but a plane map over so few squares. With it
    /// the standard deviation of seen minus predicted for corners with one of 1 in each axis: at
    /// the board's rim the map extrapolates.
    fn predicted(&self, index: usize) -> Option<([f64; 2], f64)> {
        let (c, r) = self.place(index);
        let (mut from, mut to) = (Vec::new(), Vec::new());
        for (dc, dr) in (-2..=2).flat_map(|dr| (-2..=2).map(move |dc| (dc, dr))) {
            if let (Some(pixel), false) = (self.at(c + dc, r + dr), dc == 0 && dr == 0) {
                from.push([dc as f64, dr as f64]);
                to.push(pixel);
            }
        }
        let rows = |axis: usize| {
            let mut seen: Vec<i64> = from.iter().map(|p: &[f64; 2]| p[axis] as i64).collect();
            seen.sort_unstable();
            seen.dedup();
            seen.len()
        };
        // Fewer, or all in a line or two short ones, fit any map.
        if from.len() < 6 || rows(0) < 2 || rows(1) < 2 {
            return None;
        }
        let map = cv::homography(&from, &to).ok()?;
        let at = cv::apply_homography(&map, [0.0, 0.0]);
        Some((at, (1.0 + variance_at_origin(&map, &from)?).sqrt()))
            .filter(|(p, _)| p[0].is_finite())
    }

    fn residual(&self, index: usize) -> Option<Residual> {
        let (c, r) = self.place(index);
        let (seen, (said, deviation)) = (self.at(c, r)?, self.predicted(index)?);
        let px = (seen[0] - said[0]).hypot(seen[1] - said[1]);
        Some(Residual { px, scaled: px / deviation })
    }
}

#[derive(Clone, Copy)]
struct Residual {
    px: f64,
    /// Over the standard deviation that it would have among corners with one of 1.
    scaled: f64,
}

/// Variance per axis of a plane map's value at (0, 0), fitted to points with variance 1: the
/// third and sixth diagonal elements of (JᵀJ)⁻¹, J by the map's first eight elements.
fn variance_at_origin(map: &[f64; 9], from: &[[f64; 2]]) -> Option<f64> {
    let h: [f64; 9] = map.map(|v| v / map[8]);
    let mut normal = SMatrix::<f64, 8, 8>::zeros();
    for &[x, y] in from {
        let w = h[6] * x + h[7] * y + 1.0;
        let [u, v] = cv::apply_homography(&h, [x, y]);
        let (x, y, one) = (x / w, y / w, 1.0 / w);
        let across = SVector::from([x, y, one, 0.0, 0.0, 0.0, -u * x, -u * y]);
        let down = SVector::from([0.0, 0.0, 0.0, x, y, one, -v * x, -v * y]);
        normal += across * across.transpose() + down * down.transpose();
    }
    // The last two elements are in inverse pixels: without scaling the inverse loses digits.
    let scale = SVector::<f64, 8>::from_fn(|i, _| normal[(i, i)].max(f64::MIN_POSITIVE).sqrt());
    let scaled = SMatrix::<f64, 8, 8>::from_fn(|i, j| normal[(i, j)] / (scale[i] * scale[j]));
    let inverse = scaled.cholesky()?.inverse();
    let variance = |i: usize| inverse[(i, i)] / (scale[i] * scale[i]);
    Some((variance(2) + variance(5)) / 2.0)
}

/// A corner this many times farther from its neighbours' prediction than the median corner, in
/// units of what is to be expected there, ...
const OUTLIER_RATIO: f64 = 8.0;
/// ... this many pixels, ...
const OUTLIER_PX: f64 = 0.5;
/// ... and this share of its square is not where the board has a corner. Paper that lies a little
/// hollow shifts corners by 3 % where it is seen at a slant; that is for the fit to judge.
const OUTLIER_SQUARES: f64 = 0.05;

/// Takes out the corners that disagree with their neighbours, the worst first, since one wrong
/// corner spoils the predictions around it.
pub(crate) fn drop_outliers(board: &Board, corners: &mut Vec<SeenCorner>) -> Vec<DroppedCorner> {
    let mut dropped = Vec::new();
    let mut grid = Grid::new(board, corners);
    let mut residuals: Vec<Option<Residual>> =
        (0..board.corners()).map(|i| grid.residual(i)).collect();
    while corners.len() > 4 {
        let mut sorted: Vec<f64> = residuals.iter().flatten().map(|r| r.scaled).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let Some(&median) = sorted.get(sorted.len() / 2) else { break };
        let worst = residuals
            .iter()
            .enumerate()
            .filter_map(|(i, r)| r.map(|r| (i, r)))
            .max_by(|a, b| a.1.scaled.total_cmp(&b.1.scaled));
        let Some((index, residual)) = worst else { break };
        let least = OUTLIER_PX.max(OUTLIER_SQUARES * grid.nearest(index));
        if residual.scaled <= OUTLIER_RATIO * median || residual.px <= least {
            break;
        }
        let Some(at) = corners.iter().position(|c| c.index == index) else { break };
        let SeenCorner { pixel, .. } = corners.remove(at);
        dropped.push(DroppedCorner { index, pixel, residual_px: residual.px });
        grid = Grid::new(board, corners);
        let (c, r) = grid.place(index);
        for (i, residual) in residuals.iter_mut().enumerate() {
            let (column, row) = grid.place(i);
            if (column - c).abs() <= 2 && (row - r).abs() <= 2 {
                *residual = grid.residual(i);
            }
        }
    }
    dropped
}
