//! Limited-memory BFGS on D(u) + λ R(u), for vectors that live on any device.
//!
//! Of its own rather than argmin's: λ changes while the minimisation runs, and the pairs of steps
//! and gradient changes are kept for both terms apart, so that what they say about D outlives the
//! change; a step that is rejected costs no adjoint; and a vector needs four operations instead
//! of argmin's fifteen (Nocedal & Wright, Numerical Optimization, 2006, algorithms 7.4 and 3.1).

use super::InverseError;
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

struct Pair<V> {
    step: V,
    /// Changes of ∂D/∂u and ∂R/∂u along the step.
    by_data: V,
    by_roughness: V,
}

/// The minimisation on one grid.
pub(crate) struct Minimiser<'a, O: Objective> {
    pub objective: &'a mut O,
    energy: f64,
    pairs: VecDeque<Pair<O::Vector>>,
}

impl<'a, O: Objective> Minimiser<'a, O> {
    /// `energy` is Σ w L_meas², the unit of D.
    pub fn new(objective: &'a mut O, energy: f64) -> Self {
        Self { objective, energy, pairs: VecDeque::new() }
    }

    /// Evaluates both terms at `u`.
    pub fn point(
        &mut self,
        u: O::Vector,
        tolerance: f64,
    ) -> Result<Point<O::Vector>, InverseError> {
        let misfit = self.objective.forward(&u, tolerance)?;
        let (roughness, by_roughness) = self.objective.smoothness(&u);
        let by_data = self.objective.gradient(tolerance)?;
        let data = misfit.weighted / self.energy;
        Ok(Point { u, misfit, data, roughness, by_data, by_roughness })
    }

    /// One step down from `here`; `None` where no step along the direction goes down any more.
    pub fn step(
        &mut self,
        here: &Point<O::Vector>,
        lambda: f64,
        tolerance: f64,
    ) -> Result<Option<Point<O::Vector>>, InverseError> {
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
                let by_data = self.objective.gradient(tolerance)?;
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
        self.pairs.push_back(Pair {
            step: difference(&next.u, &here.u),
            by_data: difference(&next.by_data, &here.by_data),
            by_roughness: difference(&next.by_roughness, &here.by_roughness),
        });
    }

    /// −H ∂(D + λR)/∂u by the two-loop recursion.
    fn direction(&self, gradient: &O::Vector, lambda: f64) -> O::Vector {
        let change = |pair: &Pair<O::Vector>| {
            let mut y = pair.by_data.clone();
            y.add_scaled(lambda, &pair.by_roughness);
            y
        };
        let curved: Vec<(&O::Vector, O::Vector, f64)> = self
            .pairs
            .iter()
            .map(|pair| {
                let y = change(pair);
                let curvature = pair.step.dot(&y);
                (&pair.step, y, curvature)
            })
            // Along a step of no or negative curvature BFGS has nothing to say.
            .filter(|(s, y, sy)| *sy > 1e-8 * (s.dot(s) * y.dot(y)).sqrt())
            .collect();
        let mut q = gradient.clone();
        q.scale(-1.0);
        let mut alphas = Vec::with_capacity(curved.len());
        for (s, y, sy) in curved.iter().rev() {
            let alpha = s.dot(&q) / sy;
            q.add_scaled(-alpha, y);
            alphas.push(alpha);
        }
        match curved.last() {
            Some((_, y, sy)) => q.scale(sy / y.dot(y)),
            None => {
                let largest = gradient.largest();
                q.scale(if largest > 0.0 { FIRST_STEP / largest } else { 0.0 });
            }
        }
        for ((s, y, sy), alpha) in curved.iter().zip(alphas.iter().rev()) {
            let beta = y.dot(&q) / sy;
            q.add_scaled(alpha - beta, s);
        }
        q
    }
}
