//! Passes over all cells of a level: rows are handed to threads in fixed pieces, so that
//! sums come out the same whatever the number of threads.

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
            widen_and_add(&mut total, &partial);
        }
        total
    }
}

/// Not inlined: conversion to double goes by four lanes, and where the compiler sees it, it cuts
/// the whole row's arithmetic into vectors of four instead of eight.
#[inline(never)]
fn widen_and_add<T: Real, const L: usize>(total: &mut [f64; L], partial: &Lanes<T, L>) {
    for l in 0..L {
        total[l] += partial[l].to_f64();
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

/// Where a row's cells and those of the four rows beside it stand in a field: the row itself,
/// then its neighbours at −y, +y, −z and +z.
///
/// Slices of one row each, so that no index into a field has to be checked cell by cell.
pub(crate) type Around<'a, V> = [&'a [V]; 5];

/// A row of a block of cells, to look things up around it.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    cells: [usize; 3],
    y: usize,
    z: usize,
}

impl Row {
    #[inline(always)]
    pub fn new(cells: [usize; 3], y: usize, z: usize) -> Self {
        Self { cells, y, z }
    }

    #[inline(always)]
    fn at<'a, V>(&self, field: &'a [V], y: usize, z: usize) -> &'a [V] {
        let [nx, ny, _] = self.cells;
        let first = (z * ny + y) * nx;
        &field[first..first + nx]
    }

    /// The row's own values.
    #[inline(always)]
    pub fn of<'a, V>(&self, field: &'a [V]) -> &'a [V] {
        self.at(field, self.y, self.z)
    }

    /// Values around the row; past an end of the block it is the row itself, which counts
    /// with conductance 0.
    #[inline(always)]
    pub fn around<'a, V>(&self, field: &'a [V]) -> Around<'a, V> {
        let Self { cells: [_, ny, nz], y, z } = *self;
        [
            self.at(field, y, z),
            self.at(field, y.saturating_sub(1), z),
            self.at(field, (y + 1).min(ny - 1), z),
            self.at(field, y, z.saturating_sub(1)),
            self.at(field, y, (z + 1).min(nz - 1)),
        ]
    }

    /// Conductances from the row's cells to the next along x, then to −y, +y, −z and +z.
    ///
    /// The last link of an axis is 0. That is the link across the high end, and it also
    /// serves for the one across the low end.
    #[inline(always)]
    pub fn links<'a, T>(&self, link: &'a [Vec<T>; 3]) -> Around<'a, T> {
        let Self { cells: [_, ny, nz], y, z } = *self;
        [
            self.at(&link[0], y, z),
            self.at(&link[1], y.checked_sub(1).unwrap_or(ny - 1), z),
            self.at(&link[1], y, z),
            self.at(&link[2], y, z.checked_sub(1).unwrap_or(nz - 1)),
            self.at(&link[2], y, z),
        ]
    }
}

/// start + Σ over the six neighbours of the row's cell x of conductance · value.
///
/// `value(r, x)` is the value of cell x in row r of the [`Around`].
#[inline(always)]
pub(crate) fn neighbour_sum<T: Real, const L: usize>(
    links: &Around<'_, T>,
    x: usize,
    start: Lanes<T, L>,
    value: impl Fn(usize, usize) -> Lanes<T, L>,
) -> Lanes<T, L> {
    let mut acc = start;
    if x > 0 {
        acc = scale_add(links[0][x - 1], &value(0, x - 1), &acc);
    }
    if x + 1 < links[0].len() {
        acc = scale_add(links[0][x], &value(0, x + 1), &acc);
    }
    acc = scale_add(links[1][x], &value(1, x), &acc);
    acc = scale_add(links[2][x], &value(2, x), &acc);
    acc = scale_add(links[3][x], &value(3, x), &acc);
    scale_add(links[4][x], &value(4, x), &acc)
}
