//! Passes over all cells of a level: rows are handed to threads in fixed pieces, so that
//! sums come out the same whatever the number of threads.

use super::real::{Lanes, Real, difference, scale_add, splat};
use rayon::prelude::*;

/// Values that make a piece of work worth handing to another thread (about 20 µs).
const PIECE: usize = 1 << 15;

/// Values of one field in a slab one cell thick along y, at most: three such slabs of the field
/// that a stencil reads stay in a core's share of the cache, so that memory delivers every value
/// once a pass and not once for each neighbour.
const SLAB: usize = 1 << 17;

/// What a pass does with one row of cells.
///
/// A trait and not a closure: implementations are `#[inline(always)]`, which carries through to
/// the function that is compiled for the machine's vector unit; a closure's call does not.
pub(crate) trait RowKernel<T, const L: usize>: Sync {
    /// Precision in which the values of one row are summed.
    type Sum: Real;

    /// Fills `out`, the row at (y, z); what is added to `dot` is summed over all rows.
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], dot: &mut Lanes<Self::Sum, L>);
}

/// Rows that one thread goes through: a range along y of a range along z.
struct Piece<'a, K, T, const L: usize> {
    kernel: &'a K,
    nx: usize,
    first_y: usize,
    first_z: usize,
    /// The rows of every plane.
    planes: Vec<&'a mut [Lanes<T, L>]>,
}

impl<K: RowKernel<T, L>, T: Real, const L: usize> pulp::WithSimd for Piece<'_, K, T, L> {
    type Output = [f64; L];

    /// z runs fastest, for the sake of [`SLAB`].
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> [f64; L] {
        let Self { kernel, nx, first_y, first_z, mut planes } = self;
        let mut total = [0.0; L];
        let rows = planes.first().map_or(0, |plane| plane.len() / nx);
        for y in 0..rows {
            for (z, plane) in planes.iter_mut().enumerate() {
                let mut partial = splat(K::Sum::ZERO);
                let out = &mut plane[y * nx..(y + 1) * nx];
                kernel.row(first_y + y, first_z + z, out, &mut partial);
                widen_and_add(&mut total, &partial);
            }
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
/// rows' dots, lane by lane, added up in an order that depends on the grid alone.
pub(crate) fn rows<T: Real, const L: usize>(
    cells: [usize; 3],
    out: &mut [Lanes<T, L>],
    kernel: &impl RowKernel<T, L>,
) -> [f64; L] {
    let [nx, ny, nz] = cells;
    let alone = out.len() * L <= PIECE;
    let deep = if alone { nz } else { (SLAB / (nx * L)).clamp(1, nz) };
    let wide = if alone { ny } else { (PIECE / (nx * deep * L)).clamp(1, ny) };
    let across = ny.div_ceil(wide);
    let mut pieces: Vec<_> = (0..nz.div_ceil(deep) * across)
        .map(|n| Piece {
            kernel,
            nx,
            first_y: n % across * wide,
            first_z: n / across * deep,
            planes: Vec::with_capacity(deep),
        })
        .collect();
    for (z, plane) in out.chunks_exact_mut(nx * ny).enumerate() {
        let first = z / deep * across;
        for (piece, rows) in pieces[first..].iter_mut().zip(plane.chunks_mut(nx * wide)) {
            piece.planes.push(rows);
        }
    }
    let arch = pulp::Arch::new();
    let add = |mut total: [f64; L], part: [f64; L]| {
        for l in 0..L {
            total[l] += part[l];
        }
        total
    };
    if alone {
        return pieces.into_iter().map(|piece| arch.dispatch(piece)).fold([0.0; L], add);
    }
    let parts: Vec<[f64; L]> = pieces.into_par_iter().map(|piece| arch.dispatch(piece)).collect();
    parts.into_iter().fold([0.0; L], add)
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

/// Σ over the six neighbours of the row's cell x of conductance · (value − own): the operator in
/// the form of fluxes. Differences are taken before they are weighted, so that single precision
/// loses nothing where the field is smooth.
#[inline(always)]
pub(crate) fn inflow<T: Real, const L: usize>(
    links: &Around<'_, T>,
    values: &Around<'_, Lanes<T, L>>,
    x: usize,
) -> Lanes<T, L> {
    let own = &values[0][x];
    let mut acc = splat(T::ZERO);
    if x > 0 {
        acc = scale_add(links[0][x - 1], &difference(&values[0][x - 1], own), &acc);
    }
    if x + 1 < links[0].len() {
        acc = scale_add(links[0][x], &difference(&values[0][x + 1], own), &acc);
    }
    acc = scale_add(links[1][x], &difference(&values[1][x], own), &acc);
    acc = scale_add(links[2][x], &difference(&values[2][x], own), &acc);
    acc = scale_add(links[3][x], &difference(&values[3][x], own), &acc);
    scale_add(links[4][x], &difference(&values[4][x], own), &acc)
}
