//! Conjugate gradients for a block of fields in step, each with its own coefficients.

use super::level::{Hierarchy, Level};
use super::multigrid::VCycle;
use super::real::{Lanes, Real, lane_mul_add, scale, splat};
use super::sweep::{Row, RowKernel, neighbour_sum, rows};

/// Vectors of one solve.
pub(crate) struct Krylov<T, const L: usize> {
    pub r: Vec<Lanes<T, L>>,
    pub x: Vec<Lanes<T, L>>,
    p: Vec<Lanes<T, L>>,
    p_next: Vec<Lanes<T, L>>,
    cycle: VCycle<T, L>,
}

impl<T: Real, const L: usize> Krylov<T, L> {
    pub fn new(hierarchy: &Hierarchy<T>) -> Self {
        let field = || vec![splat(T::ZERO); hierarchy.levels[0].len()];
        Self { r: field(), x: field(), p: field(), p_next: field(), cycle: VCycle::new(hierarchy) }
    }

    /// Whether the vectors fit the levels of a hierarchy, so that they can serve it too.
    pub fn fits(&self, hierarchy: &Hierarchy<T>) -> bool {
        self.cycle.fits(hierarchy)
    }

    /// Reduces the residual `r` of every lane to `target` (absolute norms) from x = 0, at
    /// most `limit` iterations, and leaves the solution in `x`. Pushes the largest
    /// residual ratio of every iteration onto `history`; returns the iterations made.
    pub fn run(
        &mut self,
        hierarchy: &Hierarchy<T>,
        norm: &[f64; L],
        target: &[f64; L],
        limit: usize,
        history: &mut Vec<f64>,
    ) -> usize {
        let level = &hierarchy.levels[0];
        self.x.fill(splat(T::ZERO));
        self.p.fill(splat(T::ZERO));
        let mut rz_old = [0.0; L];
        let mut live: [bool; L] = std::array::from_fn(|l| norm[l] > 0.0);
        for iteration in 0..limit {
            let rz = self.cycle.apply(hierarchy, &self.r);
            let beta: [f64; L] = std::array::from_fn(|l| {
                if live[l] && rz_old[l] > 0.0 { rz[l] / rz_old[l] } else { 0.0 }
            });
            let z = self.cycle.answer();
            let search = SearchDirection { level, z, beta: beta.map(T::from_f64), p: &self.p };
            let minus_pap = rows(level.cells, &mut self.p_next, &search);
            std::mem::swap(&mut self.p, &mut self.p_next);
            let alpha: [f64; L] = std::array::from_fn(|l| {
                if live[l] && minus_pap[l] < 0.0 { -rz[l] / minus_pap[l] } else { 0.0 }
            });
            let (alpha_t, p) = (alpha.map(T::from_f64), &self.p[..]);
            rows(level.cells, &mut self.x, &AdvanceSolution { level, alpha: alpha_t, p });
            let rr = rows(level.cells, &mut self.r, &AdvanceResidual { level, alpha: alpha_t, p });
            let mut worst = 0.0f64;
            for l in 0..L {
                if norm[l] > 0.0 {
                    let now = rr[l].sqrt();
                    worst = worst.max(now / norm[l]);
                    live[l] = now > target[l] && alpha[l] > 0.0;
                }
            }
            history.push(worst);
            rz_old = rz;
            if !worst.is_finite() || live.iter().all(|l| !l) {
                return iteration + 1;
            }
        }
        limit
    }
}

/// out = z + β p; the dot is −out · A out.
struct SearchDirection<'a, T, const L: usize> {
    level: &'a Level<T>,
    z: &'a [Lanes<T, L>],
    beta: Lanes<T, L>,
    p: &'a [Lanes<T, L>],
}

impl<T: Real, const L: usize> RowKernel<T, L> for SearchDirection<'_, T, L> {
    #[inline(always)]
    fn row(&self, y: usize, zz: usize, out: &mut [Lanes<T, L>], dot: &mut Lanes<T, L>) {
        let Self { level, z, ref beta, p } = *self;
        let row = Row::new(level.cells, y, zz);
        let (links, minus_diagonal) = (row.links(&level.link), row.of(&level.minus_diagonal));
        let (z, p) = (row.around(z), row.around(p));
        let direction = |r: usize, x: usize| lane_mul_add(beta, &p[r][x], &z[r][x]);
        for x in 0..minus_diagonal.len() {
            let here = direction(0, x);
            out[x] = here;
            let own = scale(minus_diagonal[x], &here);
            *dot = lane_mul_add(&here, &neighbour_sum(&links, x, own, direction), dot);
        }
    }
}

/// out (holding x) += α p.
struct AdvanceSolution<'a, T, const L: usize> {
    level: &'a Level<T>,
    alpha: Lanes<T, L>,
    p: &'a [Lanes<T, L>],
}

impl<T: Real, const L: usize> RowKernel<T, L> for AdvanceSolution<'_, T, L> {
    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], _: &mut Lanes<T, L>) {
        let p = Row::new(self.level.cells, y, z).of(self.p);
        for (o, p) in out.iter_mut().zip(p) {
            *o = lane_mul_add(&self.alpha, p, o);
        }
    }
}

/// out (holding r) −= α A p, computing A p once more instead of having stored it; the dot is
/// r · r.
struct AdvanceResidual<'a, T, const L: usize> {
    level: &'a Level<T>,
    alpha: Lanes<T, L>,
    p: &'a [Lanes<T, L>],
}

impl<T: Real, const L: usize> RowKernel<T, L> for AdvanceResidual<'_, T, L> {
    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [Lanes<T, L>], dot: &mut Lanes<T, L>) {
        let Self { level, ref alpha, p } = *self;
        let row = Row::new(level.cells, y, z);
        let (links, minus_diagonal) = (row.links(&level.link), row.of(&level.minus_diagonal));
        let p = row.around(p);
        for x in 0..minus_diagonal.len() {
            let own = scale(minus_diagonal[x], &p[0][x]);
            let minus_ap = neighbour_sum(&links, x, own, |r, x| p[r][x]);
            let r = lane_mul_add(alpha, &minus_ap, &out[x]);
            out[x] = r;
            *dot = lane_mul_add(&r, &r, dot);
        }
    }
}
