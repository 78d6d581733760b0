//! One symmetric V-cycle, the preconditioner of the conjugate gradients.
//!
//! Smoother: two steps of Chebyshev's iteration on D⁻¹A before and after the coarse correction.
//! Transfers: sums down, constants up; the coarse operators are finite-volume operators
//! of their own (see `level`). Every pass is fused so that nothing is written that can be
//! computed again from what is being read anyway.

use super::level::{Hierarchy, Level};
use super::real::{Lanes, Real, lane_mul_add, scale, scale_add, splat, sum};
use super::sweep::{Around, Row, RowKernel, neighbour_sum, rows};
use crate::chebyshev::{Chebyshev, WEIGHTS};
use crate::field::Field;

/// The smoother's weights, in the forms in which the fused passes take them.
struct Weights<T> {
    first: T,
    minus_momentum: T,
    step: T,
    own: T,
    others: T,
    /// 1 − first.
    keep: T,
    /// 1 + momentum − step.
    half_way: T,
}

impl<T: Real> Weights<T> {
    fn new() -> Self {
        let Chebyshev { first, momentum, step, own, others } = WEIGHTS;
        Self {
            first: T::from_f64(first),
            minus_momentum: T::from_f64(-momentum),
            step: T::from_f64(step),
            own: T::from_f64(own),
            others: T::from_f64(others),
            keep: T::from_f64(1.0 - first),
            half_way: T::from_f64(1.0 + momentum - step),
        }
    }
}

/// Work space of one level.
struct Space<T, const L: usize> {
    /// Right-hand side (empty on the finest level, where the caller holds it).
    b: Field<T, L>,
    /// After smoothing down; then the answer.
    x: Field<T, L>,
    /// Half-way through smoothing up.
    y: Field<T, L>,
}

/// The cycle with its work space.
pub(crate) struct VCycle<T, const L: usize> {
    spaces: Vec<Space<T, L>>,
    weights: Weights<T>,
}

impl<T: Real, const L: usize> VCycle<T, L> {
    pub fn new(hierarchy: &Hierarchy<T>) -> Self {
        let spaces = hierarchy
            .levels
            .iter()
            .enumerate()
            .map(|(k, level)| {
                let field = |wanted: bool| Field::zeros(if wanted { level.len() } else { 0 });
                let smoothed = k + 1 < hierarchy.levels.len();
                Space { b: field(k > 0), x: field(true), y: field(smoothed) }
            })
            .collect();
        Self { spaces, weights: Weights::new() }
    }

    /// Whether the work space fits the levels of a hierarchy.
    pub fn fits(&self, hierarchy: &Hierarchy<T>) -> bool {
        let lengths = hierarchy.levels.iter().map(Level::len);
        self.spaces.iter().map(|space| space.x.len()).eq(lengths)
    }

    /// z ≈ A⁻¹ r; returns r · z lane by lane. The answer is in [`Self::answer`].
    pub fn apply(&mut self, hierarchy: &Hierarchy<T>, r: &[Lanes<T, L>]) -> [f64; L] {
        cycle(
            &hierarchy.levels,
            &hierarchy.coarsest_inverse,
            &mut self.spaces,
            &self.weights,
            Some(r),
        )
    }

    /// The last answer.
    pub fn answer(&self) -> &[Lanes<T, L>] {
        &self.spaces[0].x
    }
}

fn cycle<T: Real, const L: usize>(
    levels: &[Level<T>],
    coarsest_inverse: &[T],
    spaces: &mut [Space<T, L>],
    weights: &Weights<T>,
    outer_b: Option<&[Lanes<T, L>]>,
) -> [f64; L] {
    let (here, below) = match spaces.split_first_mut() {
        Some(parts) => parts,
        None => return [0.0; L],
    };
    let Space { b, x, y } = here;
    let b = outer_b.unwrap_or(&*b);
    let level = &levels[0];
    let Some(coarse) = below.first_mut() else {
        let solve = SolveDirectly { cells: level.cells, inverse: coarsest_inverse, b };
        return rows(level.cells, x, &solve);
    };
    let next = levels[1].cells;
    rows(level.cells, x, &SmoothFromZero { level, weights, b });
    rows(next, &mut coarse.b, &RestrictResidual { level, b, x });
    cycle(&levels[1..], coarsest_inverse, below, weights, None);
    let correction = Correction::new(level, next, &below[0].x);
    rows(level.cells, y, &FirstStepUp { level, weights, b, x, correction });
    rows(level.cells, x, &SecondStepUp { level, weights, b, half_way: y, correction })
}

/// x = A⁻¹ b by the dense inverse.
struct SolveDirectly<'a, T, const L: usize> {
    cells: [usize; 3],
    inverse: &'a [T],
    b: &'a [Lanes<T, L>],
}

impl<T: Real, const L: usize> RowKernel<T, L> for SolveDirectly<'_, T, L> {
    type Sum = T;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], dot: &mut Lanes<T, L>) {
        let n = self.b.len();
        let first = (z * self.cells[1] + y) * self.cells[0];
        for x in 0..out.len() {
            let i = first + x;
            let mut acc = splat(T::ZERO);
            for (a, value) in self.inverse[i * n..(i + 1) * n].iter().zip(self.b) {
                acc = scale_add(*a, value, &acc);
            }
            *dot = lane_mul_add(&acc, &self.b[i], dot);
            out[x] = acc;
        }
    }
}

/// x = two Chebyshev steps from zero.
struct SmoothFromZero<'a, T, const L: usize> {
    level: &'a Level<T>,
    weights: &'a Weights<T>,
    b: &'a [Lanes<T, L>],
}

impl<T: Real, const L: usize> RowKernel<T, L> for SmoothFromZero<'_, T, L> {
    type Sum = T;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], _: &mut Lanes<T, L>) {
        let Self { level, weights, b } = *self;
        let row = Row::new(level.cells, y, z);
        let (links, inverse, b) =
            (row.links(&level.link), row.around(&level.inverse_diagonal), row.around(b));
        for x in 0..b[0].len() {
            let zero = splat(T::ZERO);
            let s = neighbour_sum(&links, x, zero, |r, x| scale(inverse[r][x], &b[r][x]));
            let others = scale(inverse[0][x].mul(weights.others), &s);
            out[x] = scale_add(inverse[0][x].mul(weights.own), &b[0][x], &others);
        }
    }
}

/// out = Σ over the children of b − A x, on the coarse grid.
struct RestrictResidual<'a, T, const L: usize> {
    level: &'a Level<T>,
    b: &'a [Lanes<T, L>],
    x: &'a [Lanes<T, L>],
}

impl<T: Real, const L: usize> RowKernel<T, L> for RestrictResidual<'_, T, L> {
    type Sum = T;

    #[inline(always)]
    fn row(&self, cy: usize, cz: usize, out: &mut [Lanes<T, L>], _: &mut Lanes<T, L>) {
        let Self { level, b, x } = *self;
        let [_, ny, nz] = level.cells;
        let [fx, fy, fz] = level.factor;
        out.fill(splat(T::ZERO));
        for z in cz * fz..(cz * fz + fz).min(nz) {
            for y in cy * fy..(cy * fy + fy).min(ny) {
                let row = Row::new(level.cells, y, z);
                let (links, diagonal) = (row.links(&level.link), row.of(&level.minus_diagonal));
                let (b, v) = (row.of(b), row.around(x));
                for x in 0..diagonal.len() {
                    let own = scale_add(diagonal[x], &v[0][x], &b[x]);
                    let r = neighbour_sum(&links, x, own, |r, x| v[r][x]);
                    let o = &mut out[x / fx];
                    *o = sum(o, &r);
                }
            }
        }
    }
}

/// The coarse answer, looked up from the fine grid.
#[derive(Clone, Copy)]
struct Correction<'a, T, const L: usize> {
    shift: [u32; 3],
    cells: [usize; 3],
    values: &'a [Lanes<T, L>],
}

impl<'a, T: Real, const L: usize> Correction<'a, T, L> {
    fn new(level: &Level<T>, cells: [usize; 3], values: &'a [Lanes<T, L>]) -> Self {
        Self { shift: level.factor.map(|f| u32::from(f == 2)), cells, values }
    }

    /// The coarse row that lies under the fine row at (y, z).
    #[inline(always)]
    fn under(&self, y: usize, z: usize) -> &'a [Lanes<T, L>] {
        let [_, sy, sz] = self.shift;
        Row::new(self.cells, y >> sy, z >> sz).of(self.values)
    }

    /// The coarse rows that lie under the fine row at (y, z) and under those around it.
    #[inline(always)]
    fn around(&self, [_, ny, nz]: [usize; 3], y: usize, z: usize) -> Around<'a, Lanes<T, L>> {
        [
            self.under(y, z),
            self.under(y.saturating_sub(1), z),
            self.under((y + 1).min(ny - 1), z),
            self.under(y, z.saturating_sub(1)),
            self.under(y, (z + 1).min(nz - 1)),
        ]
    }
}

/// out = v + D⁻¹(b − A v)/θ with v = x + correction.
struct FirstStepUp<'a, T, const L: usize> {
    level: &'a Level<T>,
    weights: &'a Weights<T>,
    b: &'a [Lanes<T, L>],
    x: &'a [Lanes<T, L>],
    correction: Correction<'a, T, L>,
}

impl<T: Real, const L: usize> RowKernel<T, L> for FirstStepUp<'_, T, L> {
    type Sum = T;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], _: &mut Lanes<T, L>) {
        let Self { level, weights, b, x, correction } = *self;
        let row = Row::new(level.cells, y, z);
        let (links, inverse) = (row.links(&level.link), row.of(&level.inverse_diagonal));
        let (b, x) = (row.of(b), row.around(x));
        let (coarse, shift) = (correction.around(level.cells, y, z), correction.shift[0]);
        let corrected = |r: usize, i: usize| sum(&x[r][i], &coarse[r][i >> shift]);
        for i in 0..inverse.len() {
            let s = neighbour_sum(&links, i, b[i], corrected);
            let kept = scale(weights.keep, &corrected(0, i));
            out[i] = scale_add(inverse[i].mul(weights.first), &s, &kept);
        }
    }
}

/// out (holding x) = h + momentum (h − v) + step D⁻¹(b − A h) with h the half-way point and
/// v = x + correction; the dot is out · b.
struct SecondStepUp<'a, T, const L: usize> {
    level: &'a Level<T>,
    weights: &'a Weights<T>,
    b: &'a [Lanes<T, L>],
    half_way: &'a [Lanes<T, L>],
    correction: Correction<'a, T, L>,
}

impl<T: Real, const L: usize> RowKernel<T, L> for SecondStepUp<'_, T, L> {
    type Sum = T;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], dot: &mut Lanes<T, L>) {
        let Self { level, weights, b, half_way: h, correction } = *self;
        let row = Row::new(level.cells, y, z);
        let (links, inverse) = (row.links(&level.link), row.of(&level.inverse_diagonal));
        let (b, h) = (row.of(b), row.around(h));
        let (coarse, shift) = (correction.under(y, z), correction.shift[0]);
        for i in 0..inverse.len() {
            // D⁻¹(b − A h) = D⁻¹(b + Σ t h) − h, and the −h is in `weights.half_way`.
            let s = neighbour_sum(&links, i, b[i], |r, i| h[r][i]);
            let v = sum(&out[i], &coarse[i >> shift]);
            let kept = scale_add(weights.minus_momentum, &v, &scale(weights.half_way, &h[0][i]));
            let answer = scale_add(inverse[i].mul(weights.step), &s, &kept);
            out[i] = answer;
            *dot = lane_mul_add(&answer, &b[i], dot);
        }
    }
}
