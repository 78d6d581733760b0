//! Passes over all cells of a level: rows are handed to threads in fixed pieces, so that
//! sums come out the same whatever the number of threads.

use super::level::Level;
use super::real::{Lanes, Real, scale_add, splat};
use rayon::prelude::*;

/// Values that make a piece of work worth handing to another thread (about 20 µs).
const PIECE: usize = 1 << 15;

/// What a pass does with one row of cells.
///
/// A trait and not a closure: implementations are `#[inline(always)]`, which carries through to
/// the function that is compiled for the machine's vector unit; a closure's call does not.
pub(crate) trait RowKernel<T, const L: usize>: Sync {
    /// Fills `out`, the row at (y, z); what is added to `dot` is summed over all rows.
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], dot: &mut Lanes<T, L>);
}

/// A few consecutive rows of a pass.
struct Piece<'a, K, T, const L: usize> {
    kernel: &'a K,
    cells: [usize; 3],
    first_row: usize,
    out: &'a mut [Lanes<T, L>],
}

impl<K: RowKernel<T, L>, T: Real, const L: usize> pulp::WithSimd for Piece<'_, K, T, L> {
    type Output = [f64; L];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> [f64; L] {
        let [nx, ny, _] = self.cells;
        let mut total = [0.0; L];
        for (k, out_row) in self.out.chunks_exact_mut(nx).enumerate() {
            let r = self.first_row + k;
            let mut partial = splat(T::ZERO);
            self.kernel.row(r % ny, r / ny, out_row, &mut partial);
            for l in 0..L {
                total[l] += partial[l].to_f64();
            }
        }
        total
    }
}

/// Runs a kernel on every row of `out`, in parallel where it pays, and returns the sum of the
/// rows' dots, lane by lane, added up in storage order.
pub(crate) fn rows<T: Real, const L: usize>(
    cells: [usize; 3],
    out: &mut [Lanes<T, L>],
    kernel: &impl RowKernel<T, L>,
) -> [f64; L] {
    let nx = cells[0];
    let rows_a_piece = (PIECE / (nx * L)).max(1);
    let arch = pulp::Arch::new();
    if out.len() * L <= PIECE {
        return arch.dispatch(Piece { kernel, cells, first_row: 0, out });
    }
    let parts: Vec<[f64; L]> = out
        .par_chunks_mut(rows_a_piece * nx)
        .enumerate()
        .map(|(n, out)| arch.dispatch(Piece { kernel, cells, first_row: n * rows_a_piece, out }))
        .collect();
    parts.into_iter().fold([0.0; L], |mut total, part| {
        for l in 0..L {
            total[l] += part[l];
        }
        total
    })
}

/// start + Σ over the neighbours of cell i of conductance · value.
///
/// `value(j, d)` is the value of neighbour j, which lies one step along direction d
/// (0 −x, 1 +x, 2 −y, 3 +y, 4 −z, 5 +z).
#[inline(always)]
pub(crate) fn neighbour_sum<T: Real, const L: usize>(
    level: &Level<T>,
    [x, y, z]: [usize; 3],
    i: usize,
    start: Lanes<T, L>,
    value: impl Fn(usize, usize) -> Lanes<T, L>,
) -> Lanes<T, L> {
    let [nx, ny, nz] = level.cells;
    let plane = nx * ny;
    let mut acc = start;
    if x > 0 {
        acc = scale_add(level.link[0][i - 1], &value(i - 1, 0), &acc);
    }
    if x + 1 < nx {
        acc = scale_add(level.link[0][i], &value(i + 1, 1), &acc);
    }
    if y > 0 {
        acc = scale_add(level.link[1][i - nx], &value(i - nx, 2), &acc);
    }
    if y + 1 < ny {
        acc = scale_add(level.link[1][i], &value(i + nx, 3), &acc);
    }
    if z > 0 {
        acc = scale_add(level.link[2][i - plane], &value(i - plane, 4), &acc);
    }
    if z + 1 < nz {
        acc = scale_add(level.link[2][i], &value(i + plane, 5), &acc);
    }
    acc
}
