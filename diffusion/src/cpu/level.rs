//! Operators of the coarser grids, made from conductances alone.

use super::real::Real;
use crate::Operator;
use crate::hierarchy;
use crate::operator::{PER_THREAD, face_cells};
use rayon::prelude::*;
use std::borrow::Cow;

/// One grid of the hierarchy in working precision.
pub(crate) struct Level<T> {
    pub cells: [usize; 3],
    pub link: [Vec<T>; 3],
    pub minus_diagonal: Vec<T>,
    pub inverse_diagonal: Vec<T>,
    /// How many cells along each axis make one cell of the next level (1 or 2).
    pub factor: [usize; 3],
}

/// All levels, finest first, and the inverse of the coarsest matrix (row-major).
pub(crate) struct Hierarchy<T> {
    pub levels: Vec<Level<T>>,
    /// What of a cell's diagonal leads to no other cell (absorption and boundary), times −1;
    /// of the finest level.
    pub minus_leak: Vec<T>,
    pub coarsest_inverse: Vec<T>,
}

impl<T: Real> Hierarchy<T> {
    pub fn new(fine: &Operator) -> Self {
        let schedule = hierarchy::levels(fine.cells(), fine.spacing_mm());
        let mut levels = Vec::with_capacity(schedule.len());
        let mut here = Cow::Borrowed(fine);
        for next in &schedule[1..] {
            let cells = here.cells();
            let halved = |a: &usize| next[*a] != cells[*a];
            let factor = std::array::from_fn(|a| if halved(&a) { 2 } else { 1 });
            levels.push(Level::new(&here, factor));
            for axis in (0..3).filter(halved) {
                here = Cow::Owned(coarsen(&here, axis));
            }
        }
        levels.push(Level::new(&here, [1; 3]));
        let coarsest_inverse = invert(&here).into_iter().map(T::from_f64).collect();
        let minus_leak = fine.leak().into_iter().map(|leak| T::from_f64(-leak)).collect();
        Self { levels, minus_leak, coarsest_inverse }
    }
}

impl<T: Real> Level<T> {
    fn new(operator: &Operator, factor: [usize; 3]) -> Self {
        let map = |v: &[f64], f: fn(f64) -> f64| -> Vec<T> {
            v.par_iter().with_min_len(PER_THREAD).map(|&x| T::from_f64(f(x))).collect()
        };
        Self {
            cells: operator.cells(),
            link: std::array::from_fn(|a| map(&operator.link[a], |t| t)),
            minus_diagonal: map(&operator.diagonal, |d| -d),
            inverse_diagonal: map(&operator.diagonal, |d| 1.0 / d),
            factor,
        }
    }

    pub fn len(&self) -> usize {
        self.minus_diagonal.len()
    }
}

/// Halves one axis: pairs of cells become one; an odd last cell stays alone.
///
/// A coarse cell sits at the middle of its pair, so the way from one coarse centre to the next
/// is half the link inside each pair plus the link between them: resistances in series,
/// columns side by side in parallel. The result is again a finite-volume operator.
fn coarsen(fine: &Operator, axis: usize) -> Operator {
    let cells = fine.cells();
    let mut coarse_cells = cells;
    coarse_cells[axis] = cells[axis].div_ceil(2);
    let stride = [1, cells[0], cells[0] * cells[1]][axis];
    let n = cells[axis];
    let len: usize = coarse_cells.iter().product();

    // For every coarse cell, its first fine cell and whether it has a second one.
    let first: Vec<(usize, bool)> = (0..len)
        .into_par_iter()
        .with_min_len(PER_THREAD)
        .map(|i| {
            let mut p = [
                i % coarse_cells[0],
                i / coarse_cells[0] % coarse_cells[1],
                i / (coarse_cells[0] * coarse_cells[1]),
            ];
            p[axis] *= 2;
            ((p[2] * cells[1] + p[1]) * cells[0] + p[0], p[axis] + 1 < n)
        })
        .collect();
    let pair_sum = |values: &[f64]| -> Vec<f64> {
        first
            .par_iter()
            .with_min_len(PER_THREAD)
            .map(|&(f, two)| values[f] + if two { values[f + stride] } else { 0.0 })
            .collect()
    };
    // Half the resistance inside a pair that starts at fine cell f.
    let half = |f: usize, two: bool| if two { 0.5 / fine.link[axis][f] } else { 0.0 };

    let coarse_stride = [1, coarse_cells[0], coarse_cells[0] * coarse_cells[1]][axis];
    let link = std::array::from_fn(|a| {
        if a != axis {
            return pair_sum(&fine.link[a]);
        }
        (0..len)
            .into_par_iter()
            .with_min_len(PER_THREAD)
            .map(|i| {
                let position = (i / coarse_stride) % coarse_cells[axis];
                if position + 1 == coarse_cells[axis] {
                    return 0.0;
                }
                let (f, two) = first[i];
                let (next, next_two) = first[i + coarse_stride];
                1.0 / (half(f, two) + 1.0 / fine.link[axis][f + stride] + half(next, next_two))
            })
            .collect()
    });
    let edge = std::array::from_fn(|a| {
        std::array::from_fn(|side| {
            let values = &fine.edge[a][side];
            if a == axis {
                let inner = face_cells(coarse_cells, a, side).map(|i| first[i]);
                return inner
                    .zip(values)
                    .map(
                        |((f, two), &g)| {
                            if g == 0.0 { 0.0 } else { 1.0 / (1.0 / g + half(f, two)) }
                        },
                    )
                    .collect();
            }
            let inner_axis = if a == 0 { 1 } else { 0 };
            let along = usize::from(axis != inner_axis);
            sum_face_pairs(values, cells[inner_axis], along)
        })
    });
    let mut spacing_mm = fine.spacing_mm();
    spacing_mm[axis] *= 2.0;
    Operator::assemble(coarse_cells, spacing_mm, link, edge, pair_sum(&fine.absorption))
}

/// Sums neighbouring pairs of a face array of rows of `inner` values, along the rows (0) or
/// across them (1).
fn sum_face_pairs(values: &[f64], inner: usize, along: usize) -> Vec<f64> {
    if along == 0 {
        values.chunks(inner).flat_map(|row| row.chunks(2).map(|pair| pair.iter().sum())).collect()
    } else {
        values
            .chunks(2 * inner)
            .flat_map(|rows| {
                (0..inner).map(|i| rows[i] + rows.get(inner + i).copied().unwrap_or(0.0))
            })
            .collect()
    }
}

/// Dense inverse of the coarsest matrix, at most [`hierarchy::DIRECT_CELLS`] rows, row-major.
fn invert(operator: &Operator) -> Vec<f64> {
    let n = operator.len();
    let [nx, ny, _] = operator.cells();
    let mut a = vec![0.0; n * n];
    for i in 0..n {
        a[i * n + i] = operator.diagonal[i];
        for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
            let t = operator.link[axis][i];
            if t != 0.0 {
                a[i * n + i + stride] = -t;
                a[(i + stride) * n + i] = -t;
            }
        }
    }
    // Gauss–Jordan without pivoting is stable for a symmetric positive definite matrix.
    for k in 0..n {
        let pivot = 1.0 / a[k * n + k];
        a[k * n + k] = 1.0;
        for j in 0..n {
            a[k * n + j] *= pivot;
        }
        for i in (0..n).filter(|&i| i != k) {
            let factor = a[i * n + k];
            if factor != 0.0 {
                a[i * n + k] = 0.0;
                for j in 0..n {
                    a[i * n + j] -= factor * a[k * n + j];
                }
            }
        }
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Medium;
    use material::{Grid, Optics};

    /// Coarsening keeps the exact conductance of a uniform block: from outside to outside along
    /// z the series resistance per area is 4C + D/κ whatever the grid.
    #[test]
    fn coarse_operators_keep_the_resistance_of_a_uniform_block() {
        let grid = Grid::new([5, 4, 9], [1.0, 0.7, 0.3]).unwrap();
        let medium = Medium::homogeneous(grid, 0.4, 0.01).unwrap();
        let fine = Operator::new(&medium, &Optics::from_eta(1.3));
        let coarse = coarsen(&coarsen(&coarsen(&fine, 2), 0), 1);
        let through = |o: &Operator| {
            let [nx, ny, nz] = o.cells();
            let mut total = 0.0;
            for c in 0..nx * ny {
                let mut r = 1.0 / o.edge[2][0][c] + 1.0 / o.edge[2][1][c];
                for z in 0..nz - 1 {
                    r += 1.0 / o.link[2][z * nx * ny + c];
                }
                total += 1.0 / r;
            }
            total
        };
        assert_eq!(coarse.cells(), [3, 2, 5]);
        assert!((through(&fine) / through(&coarse) - 1.0).abs() < 1e-12);
        let mass = |o: &Operator| o.absorption.iter().sum::<f64>();
        assert!((mass(&fine) / mass(&coarse) - 1.0).abs() < 1e-12);
        for a in 0..3 {
            for (i, face) in fine.edge[a].iter().enumerate() {
                let expected = if a == 2 {
                    3 * 2
                } else if a == 1 {
                    3 * 5
                } else {
                    2 * 5
                };
                assert_eq!(coarse.edge[a][i].len(), expected);
                assert!(face.len() > expected);
            }
        }
    }

    /// The dense inverse times the matrix is the identity, to rounding.
    #[test]
    fn dense_inverse() {
        let grid = Grid::new([4, 3, 2], [1.0, 0.7, 0.3]).unwrap();
        let medium = Medium::homogeneous(grid, 0.4, 0.01).unwrap();
        let operator = Operator::new(&medium, &Optics::from_eta(1.0));
        let inverse = invert(&operator);
        let n = operator.len();
        let mut b = crate::Batch::zeros(n, 1);
        b.set(0, 7, 1.0);
        let mut x = crate::Batch::zeros(n, 1);
        (0..n).for_each(|i| x.set(0, i, inverse[i * n + 7]));
        let r = operator.residual(&b, &x).field(0);
        assert!(r.iter().all(|r| r.abs() < 1e-13), "{r:?}");
    }
}
