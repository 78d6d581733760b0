//! From one grid of a block to another: maps on a face and volumes.

use material::Grid;

/// For each of `to` equal cells along a length, the cells out of `from` that it overlaps and the share of it
/// that each of them covers; the shares add up to 1.
pub fn overlaps(from: usize, to: usize) -> Vec<Vec<(usize, f64)>> {
    let ratio = from as f64 / to as f64;
    (0..to)
        .map(|i| {
            let (low, high) = (i as f64 * ratio, (i + 1) as f64 * ratio);
            let cells = low as usize..(high.ceil() as usize).min(from);
            let share = |j: usize| (high.min((j + 1) as f64) - low.max(j as f64)).max(0.0) / ratio;
            // A sliver of rounding would carry a masked pixel's value into the next cell.
            cells.map(|j| (j, share(j))).filter(|(_, share)| *share > 1e-9).collect()
        })
        .collect()
}

/// The cells of a face that each cell of another division of it overlaps.
pub(crate) struct FaceOverlap {
    x: Vec<Vec<(usize, f64)>>,
    y: Vec<Vec<(usize, f64)>>,
    nx: usize,
}

impl FaceOverlap {
    /// From the cells of `from` to those of `to`, both of the same block.
    pub fn new(from: &Grid, to: &Grid) -> Self {
        let ([nx, ny, _], [mx, my, _]) = (from.cells(), to.cells());
        Self { x: overlaps(nx, mx), y: overlaps(ny, my), nx }
    }

    /// For every cell, x fastest: the cells it overlaps and their shares.
    pub fn cells(&self) -> impl Iterator<Item = impl Iterator<Item = (usize, f64)>> {
        self.y.iter().flat_map(move |ys| {
            self.x.iter().map(move |xs| {
                ys.iter()
                    .flat_map(move |(y, b)| xs.iter().map(move |(x, a)| (y * self.nx + x, a * b)))
            })
        })
    }

    /// The average over each cell.
    pub fn average(&self, map: &[f64]) -> Vec<f64> {
        self.cells().map(|cell| cell.map(|(i, share)| share * map[i]).sum()).collect()
    }
}

/// A volume at the cell centres of another grid of the same block: trilinear between the centres,
/// constant beyond the outermost.
pub(crate) fn interpolate(from: &Grid, to: &Grid, values: &[f64]) -> Vec<f64> {
    let (n, m) = (from.cells(), to.cells());
    // Below and above along one axis, and the share of the one above.
    let place = |axis: usize, i: usize| {
        let at = (i as f64 + 0.5) * n[axis] as f64 / m[axis] as f64 - 0.5;
        let at = at.clamp(0.0, (n[axis] - 1) as f64);
        let low = at as usize;
        (low, (low + 1).min(n[axis] - 1), at - low as f64)
    };
    let places: [Vec<_>; 3] =
        std::array::from_fn(|axis| (0..m[axis]).map(|i| place(axis, i)).collect());
    let mut out = Vec::with_capacity(to.len());
    for &(z0, z1, tz) in &places[2] {
        for &(y0, y1, ty) in &places[1] {
            let along = |y: usize, z: usize, &(x0, x1, tx): &(usize, usize, f64)| {
                let row = &values[(z * n[1] + y) * n[0]..][..n[0]];
                row[x0] * (1.0 - tx) + row[x1] * tx
            };
            out.extend(places[0].iter().map(|x| {
                let plane = |z| along(y0, z, x) * (1.0 - ty) + along(y1, z, x) * ty;
                plane(z0) * (1.0 - tz) + plane(z1) * tz
            }));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grids() -> [Grid; 2] {
        // 7 and 5 cells are no multiples of 4 and 3.
        let fine = Grid::new([7, 6, 5], [1.0, 2.0, 3.0]).unwrap();
        let coarse = Grid::new([4, 3, 3], [7.0 / 4.0, 4.0, 5.0]).unwrap();
        [fine, coarse]
    }

    /// Whatever the division, an average keeps the mean over the face, and a constant as it is.
    #[test]
    fn averages_keep_the_mean() {
        let [fine, coarse] = grids();
        let map: Vec<f64> = (0..42).map(|i| (f64::from(i) * 1.3).sin()).collect();
        let averaged = FaceOverlap::new(&fine, &coarse).average(&map);
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        assert_eq!(averaged.len(), 12);
        assert!((mean(&averaged) - mean(&map)).abs() < 1e-12);
        let flat = FaceOverlap::new(&fine, &coarse).average(&[2.0; 42]);
        assert!(flat.iter().all(|v| (v - 2.0).abs() < 1e-12));
        // The first cell covers one and three quarters of a cell along x, and two along y.
        let expected = (map[0] + 0.75 * map[1] + map[7] + 0.75 * map[8]) / 3.5;
        assert!((averaged[0] - expected).abs() < 1e-12);
    }

    /// A linear field is itself between the outermost centres.
    #[test]
    fn a_linear_field_is_interpolated_exactly() {
        let [fine, coarse] = grids();
        let field = |grid: &Grid| -> Vec<f64> {
            let [nx, ny, _] = grid.cells();
            let at = |i: usize| grid.centre_mm(i % nx, i / nx % ny, i / (nx * ny));
            (0..grid.len()).map(at).map(|[x, y, z]| 1.0 + x - 0.5 * y + 0.2 * z).collect()
        };
        let (expected, found) = (field(&fine), interpolate(&coarse, &fine, &field(&coarse)));
        let inner = |i: usize| {
            let [x, y, z] = fine.centre_mm(i % 7, i / 7 % 6, i / 42);
            let [hx, hy, hz] = coarse.spacing_mm().map(|h| h / 2.0);
            let [sx, sy, sz] = fine.size_mm();
            x >= hx && x <= sx - hx && y >= hy && y <= sy - hy && z >= hz && z <= sz - hz
        };
        assert!((0..210).filter(|i| inner(*i)).count() > 50);
        for i in (0..210).filter(|i| inner(*i)) {
            assert!((found[i] - expected[i]).abs() < 1e-12, "{i}");
        }
    }
}
