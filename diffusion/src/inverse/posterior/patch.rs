//! Patches: bumps of a given width against their surroundings, one in every voxel.

use crate::inverse::step_weights;
use material::Grid;
use rayon::prelude::*;

/// The widest patch that is looked at, mm: half the longest edge of the block (a wider one has no room for
/// its surroundings), or a cell where that is longer. Patches wider than the block is thick say
/// where on the face something is, and no longer at what depth.
pub fn widest_patch_mm(grid: &Grid) -> f64 {
    0.5 * grid.size_mm().into_iter().fold(2.0 * largest_edge_mm(grid), f64::max)
}

/// Of a cell.
fn largest_edge_mm(grid: &Grid) -> f64 {
    grid.spacing_mm().into_iter().fold(0.0, f64::max)
}

/// One patch in every voxel and for every width: a bump of width ℓ less one of width 2ℓ, both with
/// the sum 1.
///
/// A bump is the hat function along each axis (ℓ is its full width at half its height): an average
/// over ℓ taken twice, of what of it lies inside the block. Less the wider one it is a difference
/// from its surroundings, and says nothing about the block's mean.
pub(super) struct Ladder {
    grid: Grid,
    /// From narrow to wide; the last one is only what the last patch is a difference from.
    bumps: Vec<Bump>,
}

/// A bump in every voxel.
struct Bump {
    width_mm: f64,
    /// What an average in each cell of each axis is over.
    spans: [Vec<Span>; 3],
}

impl Ladder {
    /// Widths from [`widest_patch_mm`] down to the largest edge of a cell, a factor of two apart: so that
    /// the surroundings of one are the next.
    pub fn new(grid: &Grid) -> Self {
        let (least, most) = (largest_edge_mm(grid), widest_patch_mm(grid));
        // Without the rounding of an edge that is a power of two of cells.
        let steps = (most / least * (1.0 + 1e-9)).log2().floor() as i32;
        let widths = (-steps..=1).map(|k| most * 2.0f64.powi(k));
        Self { grid: *grid, bumps: widths.map(|width| Bump::new(grid, width)).collect() }
    }

    /// Of every patch, mm.
    pub fn widths_mm(&self) -> impl Iterator<Item = f64> {
        self.bumps.iter().rev().skip(1).rev().map(|bump| bump.width_mm)
    }

    /// For every width the scalar products of every voxel's patch with `v`.
    pub fn products(&self, v: &[f64]) -> impl Iterator<Item = Vec<f64>> {
        let mut narrow: Option<Vec<f64>> = None;
        self.bumps.iter().filter_map(move |bump| {
            let wide = self.average(v, &bump.spans);
            let patch = narrow.take().map(|mut patch| {
                patch.iter_mut().zip(&wide).for_each(|(p, w)| *p -= w);
                patch
            });
            narrow = Some(wide);
            patch
        })
    }

    /// R (see `smoothness.rs`) of every voxel's patch, for every width.
    ///
    /// Both bumps are products of three functions of one axis each, so that R is made of sums along
    /// the axes, each of them needed once a plane of cells.
    pub fn roughness(&self) -> impl Iterator<Item = Vec<f64>> {
        let weights = step_weights(&self.grid);
        let [nx, ny, _] = self.grid.cells();
        self.bumps.windows(2).map(move |pair| {
            let sums: [Vec<AxisSums>; 3] = std::array::from_fn(|a| {
                let [narrow, wide] = [0, 1].map(|k| rows(&pair[k].spans[a]));
                narrow.iter().zip(&wide).map(|(n, w)| AxisSums::new(n, w)).collect()
            });
            let each = (0..self.grid.len()).into_par_iter();
            let of = |i: usize| {
                let at = [&sums[0][i % nx], &sums[1][i / nx % ny], &sums[2][i / (nx * ny)]];
                let mut total = 0.0;
                for a in 0..3 {
                    for (j, factor) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                        let others = at[(a + 1) % 3].values[j] * at[(a + 2) % 3].values[j];
                        total += weights[a] * factor * at[a].steps[j] * others;
                    }
                }
                total
            };
            each.map(of).collect()
        })
    }

    /// Averages a map over the bumps of a patch's width, each within its slice.
    pub fn within_slices(&self, patch: usize, map: &mut [f32]) {
        let [x, y, _] = &self.bumps[patch].spans;
        let mut values: Vec<f64> = map.iter().map(|v| f64::from(*v)).collect();
        self.along_rows(&mut values, x);
        self.along_columns(&mut values, y);
        map.iter_mut().zip(values).for_each(|(out, v)| *out = v as f32);
    }

    fn average(&self, v: &[f64], [x, y, z]: &[Vec<Span>; 3]) -> Vec<f64> {
        let mut out = v.to_vec();
        self.along_rows(&mut out, x);
        self.along_columns(&mut out, y);
        let plane = self.grid.face_len();
        let mut sums = vec![0.0; out.len() + plane];
        for _ in 0..2 {
            integrate(&out, &mut sums, plane);
            let planes = out.par_chunks_exact_mut(plane);
            planes.zip(z).for_each(|(out, span)| span.average(&sums, out));
        }
        out
    }

    fn along_rows(&self, v: &mut [f64], spans: &[Span]) {
        v.par_chunks_exact_mut(self.grid.face_len()).for_each(|plane| {
            let mut sums = vec![0.0; spans.len() + 1];
            plane.chunks_exact_mut(spans.len()).for_each(|row| average_axis(row, spans, &mut sums));
        });
    }

    fn along_columns(&self, v: &mut [f64], spans: &[Span]) {
        v.par_chunks_exact_mut(self.grid.face_len()).for_each(|plane| {
            let mut sums = vec![0.0; plane.len() + plane.len() / spans.len()];
            average_axis(plane, spans, &mut sums);
        });
    }
}

impl Bump {
    fn new(grid: &Grid, width_mm: f64) -> Self {
        let spans = std::array::from_fn(|a| {
            let n = grid.cells()[a];
            // A bump cannot be narrower than a cell.
            let half = (0.5 * width_mm / grid.spacing_mm()[a]).max(0.5);
            (0..n).map(|i| Span::around(i as f64 + 0.5, half, n)).collect()
        });
        Self { width_mm, spans }
    }
}

/// What an average is over: from `low` to `high` in cells, each a cell and the part of it that lies
/// before.
#[derive(Clone, Copy)]
struct Span {
    low: (usize, f64),
    high: (usize, f64),
    /// One over the length.
    scale: f64,
}

impl Span {
    /// `half` to both sides of `centre`, as far as it lies in 0 to `n`.
    fn around(centre: f64, half: f64, n: usize) -> Self {
        let (low, high) = ((centre - half).max(0.0), (centre + half).min(n as f64));
        let place = |t: f64| {
            let cell = (t as usize).min(n - 1);
            (cell, t - cell as f64)
        };
        Self { low: place(low), high: place(high), scale: 1.0 / (high - low) }
    }

    /// The average of what `sums` (see [`integrate`]) has the integral of; `out` is one place of the
    /// axis.
    fn average(&self, sums: &[f64], out: &mut [f64]) {
        let stride = out.len();
        let at = |(cell, _): (usize, f64)| sums[cell * stride..][..2 * stride].split_at(stride);
        let ((low, low_next), (high, high_next)) = (at(self.low), at(self.high));
        for (k, out) in out.iter_mut().enumerate() {
            let low = low[k] + self.low.1 * (low_next[k] - low[k]);
            let high = high[k] + self.high.1 * (high_next[k] - high[k]);
            *out = self.scale * (high - low);
        }
    }
}

/// Averages twice over spans along one axis, whose cells are `block.len() / spans.len()` values apart.
fn average_axis(block: &mut [f64], spans: &[Span], sums: &mut [f64]) {
    let stride = block.len() / spans.len();
    for _ in 0..2 {
        integrate(block, sums, stride);
        block.chunks_exact_mut(stride).zip(spans).for_each(|(out, span)| span.average(sums, out));
    }
}

/// sums[i] is the sum of the cells before i: the integral, which is linear in between.
fn integrate(values: &[f64], sums: &mut [f64], stride: usize) {
    sums[..stride].fill(0.0);
    for (i, v) in values.chunks_exact(stride).enumerate() {
        let (before, after) = sums[i * stride..][..2 * stride].split_at_mut(stride);
        after.iter_mut().zip(before).zip(v).for_each(|((after, before), v)| *after = *before + v);
    }
}

/// The bump of every cell of an axis.
fn rows(spans: &[Span]) -> Vec<Vec<f64>> {
    let n = spans.len();
    let mut rows = vec![vec![0.0; n]; n];
    let mut sums = vec![0.0; n + 1];
    for j in 0..n {
        let mut unit = vec![0.0; n];
        unit[j] = 1.0;
        average_axis(&mut unit, spans, &mut sums);
        for (row, value) in rows.iter_mut().zip(unit) {
            row[j] = value;
        }
    }
    rows
}

/// Sums along one axis of products of two bumps, and of their steps: narrow and narrow, narrow and
/// wide, wide and wide.
struct AxisSums {
    values: [f64; 3],
    steps: [f64; 3],
}

impl AxisSums {
    fn new(narrow: &[f64], wide: &[f64]) -> Self {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let steps = |v: &[f64]| v.windows(2).map(|w| w[1] - w[0]).collect::<Vec<f64>>();
        let of = |n: &[f64], w: &[f64]| [dot(n, n), dot(n, w), dot(w, w)];
        Self { values: of(narrow, wide), steps: of(&steps(narrow), &steps(wide)) }
    }
}
