//! Limited-memory BFGS on D(u) + λ R(u), for vectors that live on any device.
//!
//! Of its own rather than argmin's: λ changes while the minimisation runs, and the pairs of steps
//! and gradient changes are kept for both terms apart, so that what they say about D outlives the
//! change; a step that is rejected costs no adjoint; and a vector needs four operations instead
//! of argmin's fifteen (Nocedal & Wright, Numerical Optimization, 2006, algorithms 7.4 and 3.1).

use super::InverseError;
use super::accuracy::Accuracy;
use super::objective::{Misfit, Objective, Vector};
use std::collections::VecDeque;

/// Pairs of steps and gradient changes that are remembered.
const MEMORY: usize = 10;
/// A step is taken when it lowers the objective by this share of what its slope promises.
const SUFFICIENT: f64 = 1e-4;
/// The first step moves no log κ or log μ by more than this, later ones by no more than the second.
const FIRST_STEP: f64 = 0.3;
const LONGEST_STEP: f64 = 2.0;
/// Shorter steps than this many halvings and there is nothing left to gain.
const MOST_TRIALS: usize = 12;

/// How far a shift goes along which the curvature is measured: small against what logarithms differ by in a
/// block, large against what solves are off by.
const SHIFT: f64 = 0.05;
/// The least curvature of a combination of the two shifts, relative to their largest.
const LEAST_CURVATURE: f64 = 1e-5;

/// Curvature of D along the two shifts, of log κ and of log μ in all cells alike; the same on every grid.
///
/// Along a shift of both that leaves the effective attenuation √(μ/κ) as it is, D curves a thousand
/// times less than across it. Steps and gradient changes take long to learn that, and the means
/// of κ and μ creep meanwhile; two gradients tell it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shifts([[f64; 2]; 2]);

/// A point with everything that is known about it.
#[derive(Clone)]
pub(crate) struct Point<V> {
    pub u: V,
    pub misfit: Misfit,
    /// D(u) and R(u).
    pub data: f64,
    pub roughness: f64,
    by_data: V,
    by_roughness: V,
}

impl<V> Point<V> {
    /// D + λ R.
    pub fn value(&self, lambda: f64) -> f64 {
        self.data + lambda * self.roughness
    }
}

/// A step s, and the changes y_D and y_R of ∂D/∂u and ∂R/∂u along it.
struct Pair<V: Vector> {
    step: V::Kept,
    by_data: V::Kept,
    by_roughness: V::Kept,
    /// s·s.
    length2: f64,
    /// s·y_D and s·y_R.
    curvature: [f64; 2],
    /// y_D·y_D, 2 y_D·y_R and y_R·y_R.
    change2: [f64; 3],
}

impl<V: Vector> Pair<V> {
    /// s·y, y = y_D + λ y_R.
    fn curvature(&self, lambda: f64) -> f64 {
        let [data, roughness] = self.curvature;
        data + lambda * roughness
    }

    /// y·y.
    fn change2(&self, lambda: f64) -> f64 {
        let [data, cross, roughness] = self.change2;
        data + lambda * (cross + lambda * roughness)
    }

    /// y·q.
    fn along(&self, q: &V, lambda: f64) -> f64 {
        q.dot_kept(&self.by_data) + lambda * q.dot_kept(&self.by_roughness)
    }

    /// q += factor · y.
    fn add_change(&self, factor: f64, lambda: f64, q: &mut V) {
        q.add_kept(factor, &self.by_data);
        q.add_kept(factor * lambda, &self.by_roughness);
    }
}

/// The minimisation on one grid.
pub(crate) struct Minimiser<'a, O: Objective> {
    pub objective: &'a mut O,
    energy: f64,
    pairs: VecDeque<Pair<O::Vector>>,
    /// One in every cell of log κ, and of log μ.
    ones: [O::Vector; 2],
    /// Curvatures of D and R along these, if they are known.
    curvature: Option<[Shifts; 2]>,
}

impl<'a, O: Objective> Minimiser<'a, O> {
    /// `energy` is Σ w L_meas², the unit of D.
    pub fn new(objective: &'a mut O, energy: f64) -> Self {
        let cells = objective.cells();
        let ones = std::array::from_fn(|half| {
            let mut ones = vec![0.0; 2 * cells];
            ones[half * cells..][..cells].fill(1.0);
            objective.vector(ones)
        });
        Self { objective, energy, pairs: VecDeque::new(), ones, curvature: None }
    }

    /// Measures the curvature of D along the two shifts by differences of gradients, which are as
    /// exact as they can be.
    pub fn shifts(
        &mut self,
        here: &O::Vector,
        accuracy: &Accuracy,
    ) -> Result<Shifts, InverseError> {
        let tolerance = accuracy.exact();
        let mut by_data = |u: &O::Vector| {
            self.objective.forward(u, tolerance)?;
            self.objective.gradient(tolerance)
        };
        let before = by_data(here)?;
        let mut out = [[0.0; 2]; 2];
        for (row, out) in out.iter_mut().enumerate() {
            let mut u = here.clone();
            u.add_scaled(SHIFT, &self.ones[row]);
            let mut change = by_data(&u)?;
            change.add_scaled(-1.0, &before);
            *out = self.ones.each_ref().map(|ones| ones.dot(&change) / SHIFT);
        }
        Ok(Shifts(out))
    }

    /// Takes the curvature along the shifts into the first approximation of the inverse Hessian.
    pub fn know(&mut self, shifts: Option<&Shifts>) {
        self.curvature = shifts.map(|by_data| {
            // R changes along a shift by its pull alone, which is quadratic.
            let ones = &self.ones;
            let zero = self.objective.vector(vec![0.0; 2 * self.objective.cells()]);
            let (_, at_zero) = self.objective.smoothness(&zero);
            let by_roughness = std::array::from_fn(|row| {
                let (_, mut change) = self.objective.smoothness(&ones[row]);
                change.add_scaled(-1.0, &at_zero);
                ones.each_ref().map(|ones| ones.dot(&change))
            });
            [*by_data, Shifts(by_roughness)]
        });
    }

    /// A⁻¹ of the curvature A of D + λR along the shifts, which is made positive definite.
    fn inverse_along_shifts(&self, lambda: f64) -> Option<[[f64; 2]; 2]> {
        let [Shifts(d), Shifts(r)] = self.curvature?;
        let of =
            |i: usize, j: usize| 0.5 * (d[i][j] + d[j][i]) + lambda * 0.5 * (r[i][j] + r[j][i]);
        let (a, b, c) = (of(0, 0), of(0, 1), of(1, 1));
        // Eigenvalues m ± s; eigenvector (cos t, sin t) of the larger one.
        let (m, s) = (0.5 * (a + c), (0.25 * (a - c) * (a - c) + b * b).sqrt());
        let t = 0.5 * (2.0 * b).atan2(a - c);
        let (large, small) = (m + s, (m - s).max(LEAST_CURVATURE * (m + s)));
        (large > 0.0 && small.is_finite()).then(|| {
            let (x, y) = (t.cos(), t.sin());
            let off = x * y * (1.0 / large - 1.0 / small);
            [[x * x / large + y * y / small, off], [off, y * y / large + x * x / small]]
        })
    }

    /// The first approximation of the inverse Hessian: a multiple of the identity, but for shifts.
    fn first_inverse(&self, q: &mut O::Vector, scale: f64, lambda: f64) {
        let known = self.inverse_along_shifts(lambda).map(|inverse| {
            let along = self.ones.each_ref().map(|ones| ones.dot(q));
            let cells = self.objective.cells() as f64;
            inverse
                .map(|row| row[0] * along[0] + row[1] * along[1])
                .into_iter()
                .zip(along)
                .map(move |(step, along)| step - scale * along / cells)
                .collect::<Vec<f64>>()
        });
        q.scale(scale);
        for (factor, ones) in known.iter().flatten().zip(&self.ones) {
            q.add_scaled(*factor, ones);
        }
    }

    /// Evaluates both terms at `u`.
    pub fn point(
        &mut self,
        u: O::Vector,
        accuracy: &Accuracy,
    ) -> Result<Point<O::Vector>, InverseError> {
        let misfit = self.objective.forward(&u, accuracy.exact())?;
        let (roughness, by_roughness) = self.objective.smoothness(&u);
        let by_data = self.objective.gradient(accuracy.adjoint())?;
        let data = misfit.weighted / self.energy;
        Ok(Point { u, misfit, data, roughness, by_data, by_roughness })
    }

    /// One step down from `here`; `None` where no step along the direction goes down any more.
    pub fn step(
        &mut self,
        here: &Point<O::Vector>,
        lambda: f64,
        accuracy: &Accuracy,
    ) -> Result<Option<Point<O::Vector>>, InverseError> {
        let tolerance = accuracy.forward(here.data);
        let mut gradient = here.by_data.clone();
        gradient.add_scaled(lambda, &here.by_roughness);
        let mut direction = self.direction(&gradient, lambda);
        let mut slope = direction.dot(&gradient);
        if slope >= 0.0 {
            // Rounding, or pairs that contradict each other: begin again from steepest descent.
            self.pairs.clear();
            direction = self.direction(&gradient, lambda);
            slope = direction.dot(&gradient);
        }
        let longest = direction.largest();
        if !(slope < 0.0 && longest.is_finite()) {
            if slope.is_nan() || longest.is_nan() {
                // A vector's operations cannot say that their device is lost; a solve can.
                self.objective.forward(&here.u, tolerance)?;
            }
            return Ok(None);
        }
        let limit = if self.pairs.is_empty() { FIRST_STEP } else { LONGEST_STEP };
        let mut length = (limit / longest).min(1.0);
        let start = here.value(lambda);
        for _ in 0..MOST_TRIALS {
            let mut u = here.u.clone();
            u.add_scaled(length, &direction);
            let misfit = self.objective.forward(&u, tolerance)?;
            let (roughness, by_roughness) = self.objective.smoothness(&u);
            let data = misfit.weighted / self.energy;
            let change = data + lambda * roughness - start;
            if change <= SUFFICIENT * length * slope {
                let by_data = self.objective.gradient(accuracy.adjoint())?;
                let next = Point { u, misfit, data, roughness, by_data, by_roughness };
                self.remember(here, &next);
                return Ok(Some(next));
            }
            // The minimum of the parabola through both values and the slope, within reason.
            let parabola = -0.5 * slope * length / (change / length - slope);
            length *= (parabola / length).clamp(0.1, 0.5);
        }
        Ok(None)
    }

    fn remember(&mut self, here: &Point<O::Vector>, next: &Point<O::Vector>) {
        let difference = |a: &O::Vector, b: &O::Vector| {
            let mut out = a.clone();
            out.add_scaled(-1.0, b);
            out
        };
        if self.pairs.len() == MEMORY {
            self.pairs.pop_front();
        }
        let step = difference(&next.u, &here.u);
        let data = difference(&next.by_data, &here.by_data);
        let roughness = difference(&next.by_roughness, &here.by_roughness);
        self.pairs.push_back(Pair {
            step: step.keep(),
            by_data: data.keep(),
            by_roughness: roughness.keep(),
            length2: step.dot(&step),
            curvature: [step.dot(&data), step.dot(&roughness)],
            change2: [data.dot(&data), 2.0 * data.dot(&roughness), roughness.dot(&roughness)],
        });
    }

    /// −H ∂(D + λR)/∂u by the two-loop recursion.
    fn direction(&self, gradient: &O::Vector, lambda: f64) -> O::Vector {
        // Along a step of no or negative curvature BFGS has nothing to say.
        let curved: Vec<(&Pair<O::Vector>, f64)> = self
            .pairs
            .iter()
            .map(|pair| (pair, pair.curvature(lambda)))
            .filter(|(pair, sy)| *sy > 1e-8 * (pair.length2 * pair.change2(lambda)).sqrt())
            .collect();
        let mut q = gradient.clone();
        q.scale(-1.0);
        let mut alphas = Vec::with_capacity(curved.len());
        for (pair, sy) in curved.iter().rev() {
            let alpha = q.dot_kept(&pair.step) / sy;
            pair.add_change(-alpha, lambda, &mut q);
            alphas.push(alpha);
        }
        let scale = match curved.last() {
            Some((pair, sy)) => sy / pair.change2(lambda),
            None => {
                let largest = gradient.largest();
                if largest > 0.0 { FIRST_STEP / largest } else { 0.0 }
            }
        };
        self.first_inverse(&mut q, scale, lambda);
        for ((pair, sy), alpha) in curved.iter().zip(alphas.iter().rev()) {
            let beta = pair.along(&q, lambda) / sy;
            q.add_kept(alpha - beta, &pair.step);
        }
        q
    }
}
