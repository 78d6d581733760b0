//! Patches: bumps of a given width against their surroundings, one in every voxel.

use crate::inverse::step_weights;
use material::Grid;
use rayon::prelude::*;

/// One patch in every voxel: a bump of width ℓ less one of width 2ℓ, both with the sum 1.
///
/// A bump is the hat function along each axis (ℓ is its full width at half its height): an average
/// over ℓ taken twice, of what of it lies inside the block. Less the wider one it is a difference
/// from its surroundings, and says nothing about the block's mean.
pub(super) struct Patch {
    grid: Grid,
    pub width_mm: f64,
    narrow: [Vec<Span>; 3],
    wide: [Vec<Span>; 3],
}

/// What an average in one cell of an axis is over: from `low` to `high` in cells, both inside.
#[derive(Clone, Copy)]
struct Span {
    low: f64,
    high: f64,
}

impl Patch {
    pub fn new(grid: &Grid, width_mm: f64) -> Self {
        let spans = |width: f64| {
            std::array::from_fn(|a| {
                let n = grid.cells()[a] as f64;
                // A patch cannot be narrower than a cell.
                let half = (0.5 * width / grid.spacing_mm()[a]).max(0.5);
                let span = |i: usize| {
                    let centre = i as f64 + 0.5;
                    Span { low: (centre - half).max(0.0), high: (centre + half).min(n) }
                };
                (0..grid.cells()[a]).map(span).collect()
            })
        };
        let (narrow, wide) = (spans(width_mm), spans(2.0 * width_mm));
        Self { grid: *grid, width_mm, narrow, wide }
    }

    /// Widths from the largest edge of a cell to the shortest edge of the block, about a factor of
    /// two apart. Beyond the latter a patch would no longer lie at a depth.
    pub fn ladder(grid: &Grid) -> Vec<Self> {
        let first = grid.spacing_mm().into_iter().fold(0.0, f64::max);
        let last = grid.size_mm().into_iter().fold(f64::INFINITY, f64::min).max(first);
        let steps = (last / first).log2().ceil();
        let width = |k: usize| first * (last / first).powf(k as f64 / steps.max(1.0));
        (0..=steps as usize).map(|k| Self::new(grid, width(k))).collect()
    }

    /// The scalar product of every voxel's patch with `v`.
    pub fn products(&self, v: &[f64]) -> Vec<f64> {
        let mut out = self.average(v, &self.narrow);
        for (o, w) in out.iter_mut().zip(self.average(v, &self.wide)) {
            *o -= w;
        }
        out
    }

    /// R (see `smoothness.rs`) of every voxel's patch.
    ///
    /// Both bumps are products of three functions of one axis each, so that R is made of sums along
    /// the axes, each of them needed once a plane of cells.
    pub fn roughness(&self) -> Vec<f64> {
        let sums: [Vec<AxisSums>; 3] = std::array::from_fn(|a| {
            let (narrow, wide) = (rows(&self.narrow[a]), rows(&self.wide[a]));
            narrow.iter().zip(&wide).map(|(n, w)| AxisSums::new(n, w)).collect()
        });
        let weights = step_weights(&self.grid);
        let [nx, ny, _] = self.grid.cells();
        let each = (0..self.grid.len()).into_par_iter();
        each.map(|i| {
            let at = [&sums[0][i % nx], &sums[1][i / nx % ny], &sums[2][i / (nx * ny)]];
            let mut total = 0.0;
            for a in 0..3 {
                for (j, factor) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                    let others = at[(a + 1) % 3].values[j] * at[(a + 2) % 3].values[j];
                    total += weights[a] * factor * at[a].steps[j] * others;
                }
            }
            total
        })
        .collect()
    }

    fn average(&self, v: &[f64], spans: &[Vec<Span>; 3]) -> Vec<f64> {
        let mut out = v.to_vec();
        let mut stride = 1;
        for spans in spans {
            out.par_chunks_mut(spans.len() * stride).for_each(|block| {
                average_axis(block, spans, stride);
                average_axis(block, spans, stride);
            });
            stride *= spans.len();
        }
        out
    }
}

/// Averages over spans along one axis, whose cells are `stride` values apart.
fn average_axis(block: &mut [f64], spans: &[Span], stride: usize) {
    // sums[i] is the sum of the cells before i: the integral, which is linear in between.
    let mut sums = vec![0.0; block.len() + stride];
    for (i, v) in block.iter().enumerate() {
        sums[i + stride] = sums[i] + v;
    }
    let last = spans.len() - 1;
    for (out, span) in block.chunks_exact_mut(stride).zip(spans) {
        let place = |t: f64| {
            let cell = (t as usize).min(last);
            (cell * stride, t - cell as f64)
        };
        let ((low, low_part), (high, high_part)) = (place(span.low), place(span.high));
        let scale = 1.0 / (span.high - span.low);
        for (k, out) in out.iter_mut().enumerate() {
            let integral = |at: usize, part: f64| sums[at] + part * (sums[at + stride] - sums[at]);
            *out = scale * (integral(high + k, high_part) - integral(low + k, low_part));
        }
    }
}

/// The bump of every cell of an axis.
fn rows(spans: &[Span]) -> Vec<Vec<f64>> {
    let n = spans.len();
    let mut rows = vec![vec![0.0; n]; n];
    for j in 0..n {
        let mut unit = vec![0.0; n];
        unit[j] = 1.0;
        average_axis(&mut unit, spans, 1);
        average_axis(&mut unit, spans, 1);
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
