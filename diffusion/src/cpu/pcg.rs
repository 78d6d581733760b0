//! Conjugate gradients for a block of fields in step, each with its own coefficients.

use super::level::{Hierarchy, Level};
use super::multigrid::VCycle;
use super::real::{Lanes, Real, difference, lane_mul_add, scale, scale_add, splat};
use super::sweep::{Row, RowKernel, inflow, rows};
use crate::field::Field;

/// Vectors of one solve.
pub(crate) struct Krylov<T, const L: usize> {
    pub r: Field<T, L>,
    p: Field<T, L>,
    /// The direction before `p`; what the next one is written to.
    p_before: Field<T, L>,
    cycle: VCycle<T, L>,
}

impl<T: Real, const L: usize> Krylov<T, L> {
    pub fn new(hierarchy: &Hierarchy<T>) -> Self {
        let field = || Field::zeros(hierarchy.levels[0].len());
        Self { r: field(), p: field(), p_before: field(), cycle: VCycle::new(hierarchy) }
    }

    /// Whether the vectors fit the levels of a hierarchy, so that they can serve it too.
    pub fn fits(&self, hierarchy: &Hierarchy<T>) -> bool {
        self.cycle.fits(hierarchy)
    }

    /// Reduces the residual `r` of every lane to `target` (absolute norms), at most `limit`
    /// iterations, and adds to `solution` what that takes. Pushes the largest residual ratio of
    /// every iteration onto `history`; returns the iterations made.
    pub fn run(
        &mut self,
        hierarchy: &Hierarchy<T>,
        norm: &[f64; L],
        target: &[f64; L],
        limit: usize,
        solution: &mut Solution<'_, L>,
        history: &mut Vec<f64>,
    ) -> usize {
        let level = &hierarchy.levels[0];
        let mut rz_before = [0.0; L];
        // Step along `p_before` that the solution has not taken yet.
        let mut owed: Option<[f64; L]> = None;
        let mut live: [bool; L] = std::array::from_fn(|l| norm[l] > 0.0);
        for iteration in 1..=limit {
            let rz = self.cycle.apply(hierarchy, &self.r);
            let beta: [f64; L] = std::array::from_fn(|l| {
                if live[l] && rz_before[l] > 0.0 { rz[l] / rz_before[l] } else { 0.0 }
            });
            let z = self.cycle.answer();
            // The first direction is z alone: β is 0, and z is at hand.
            let p = if iteration == 1 { z } else { &*self.p };
            let minus_leak = &hierarchy.minus_leak;
            let beta = beta.map(T::from_f64);
            let search = SearchDirection { level, minus_leak, z, beta, p };
            let minus_pap = rows(level.cells, &mut self.p_before, &search);
            std::mem::swap(&mut self.p, &mut self.p_before);
            let alpha: [f64; L] = std::array::from_fn(|l| {
                if live[l] && minus_pap[l] < 0.0 { -rz[l] / minus_pap[l] } else { 0.0 }
            });
            // The residual must take the very step that the solution takes.
            let alpha_t = alpha.map(T::from_f64);
            let alpha = alpha_t.map(T::to_f64);
            let advance = AdvanceResidual { level, minus_leak, alpha: alpha_t, p: &self.p };
            let rr = rows(level.cells, &mut self.r, &advance);
            let mut worst = 0.0f64;
            for l in 0..L {
                if norm[l] > 0.0 {
                    let now = rr[l].sqrt();
                    worst = worst.max(now / norm[l]);
                    live[l] = now > target[l] && alpha[l] > 0.0;
                }
            }
            history.push(worst);
            rz_before = rz;
            let done = iteration == limit || !worst.is_finite() || live.iter().all(|l| !l);
            match owed.take() {
                Some(before) => {
                    solution.advance(level.cells, [(before, &self.p_before), (alpha, &self.p)]);
                }
                None if done => solution.advance(level.cells, [(alpha, &self.p)]),
                None => owed = Some(alpha),
            }
            if done {
                return iteration;
            }
        }
        limit
    }
}

/// The solution, double whatever the precision of the iteration: rounded to single precision
/// it alone would leave a residual of ε ‖A‖ ‖x‖, some 10⁻⁶ of ‖b‖.
pub(crate) struct Solution<'a, const L: usize> {
    pub x: &'a mut [Lanes<f64, L>],
    /// `x` holds zeros that nobody has written, and need not be read.
    pub blank: bool,
}

impl<const L: usize> Solution<'_, L> {
    /// x += Σ α p. Two steps at a time halve the traffic of the longest vector there is.
    fn advance<T: Real, const N: usize>(
        &mut self,
        cells: [usize; 3],
        steps: [([f64; L], &Field<T, L>); N],
    ) {
        let steps = steps.map(|(alpha, p)| (alpha, &p[..]));
        rows(cells, self.x, &AdvanceSolution { cells, blank: self.blank, steps });
        self.blank = false;
    }
}

/// out (holding x) += Σ α p.
struct AdvanceSolution<'a, T, const L: usize, const N: usize> {
    cells: [usize; 3],
    blank: bool,
    steps: [([f64; L], &'a [Lanes<T, L>]); N],
}

impl<T: Real, const L: usize, const N: usize> RowKernel<f64, L> for AdvanceSolution<'_, T, L, N> {
    type Sum = f64;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<f64, L>], _: &mut Lanes<f64, L>) {
        let row = Row::new(self.cells, y, z);
        let steps = self.steps.each_ref().map(|(alpha, p)| (alpha, row.of(p)));
        for x in 0..out.len() {
            let mut sum = if self.blank { splat(0.0) } else { out[x] };
            for (alpha, p) in &steps {
                for l in 0..L {
                    sum[l] = alpha[l].mul_add(p[x][l].to_f64(), sum[l]);
                }
            }
            out[x] = sum;
        }
    }
}

/// out = z + β p; the dot is −out · A out.
///
/// As an energy, A's quadratic form is Σ leak p² + Σ over faces of conductance · (Δp)², and every
/// face is met from one of its sides: half the neighbours do, whose p is computed anew.
struct SearchDirection<'a, T, const L: usize> {
    level: &'a Level<T>,
    minus_leak: &'a [T],
    z: &'a [Lanes<T, L>],
    beta: Lanes<T, L>,
    p: &'a [Lanes<T, L>],
}

impl<T: Real, const L: usize> RowKernel<T, L> for SearchDirection<'_, T, L> {
    type Sum = T;

    #[inline(always)]
    fn row(&self, y: usize, zz: usize, out: &mut [Lanes<T, L>], dot: &mut Lanes<T, L>) {
        let Self { level, minus_leak, z, ref beta, p } = *self;
        let row = Row::new(level.cells, y, zz);
        let (links, minus_leak) = (row.links(&level.link), row.of(minus_leak));
        let (z, p) = (row.around(z), row.around(p));
        let direction = |r: usize, x: usize| lane_mul_add(beta, &p[r][x], &z[r][x]);
        let mut before = direction(0, 0);
        for x in 0..minus_leak.len() {
            let here = direction(0, x);
            out[x] = here;
            let mut minus_energy = scale(minus_leak[x], &here);
            minus_energy = lane_mul_add(&minus_energy, &here, dot);
            let below = [
                (if x > 0 { links[0][x - 1] } else { T::ZERO }, before),
                (links[1][x], direction(1, x)),
                (links[3][x], direction(3, x)),
            ];
            for (link, below) in &below {
                let drop = difference(below, &here);
                let minus_flux = scale(link.neg(), &drop);
                minus_energy = lane_mul_add(&minus_flux, &drop, &minus_energy);
            }
            *dot = minus_energy;
            before = here;
        }
    }
}

/// out (holding r) −= α A p, computing A p once more instead of having stored it; the dot is
/// r · r.
///
/// In the form of fluxes, and with the solution in double: the residual carried along stays with
/// the true one down to a few 10⁻⁷ of where it began, also in single precision.
struct AdvanceResidual<'a, T, const L: usize> {
    level: &'a Level<T>,
    minus_leak: &'a [T],
    alpha: Lanes<T, L>,
    p: &'a [Lanes<T, L>],
}

impl<T: Real, const L: usize> RowKernel<T, L> for AdvanceResidual<'_, T, L> {
    type Sum = T;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], dot: &mut Lanes<T, L>) {
        let Self { level, minus_leak, ref alpha, p } = *self;
        let row = Row::new(level.cells, y, z);
        let (links, minus_leak) = (row.links(&level.link), row.of(minus_leak));
        let p = row.around(p);
        for x in 0..minus_leak.len() {
            let minus_ap = scale_add(minus_leak[x], &p[0][x], &inflow(&links, &p, x));
            let r = lane_mul_add(alpha, &minus_ap, &out[x]);
            out[x] = r;
            *dot = lane_mul_add(&r, &r, dot);
        }
    }
}
