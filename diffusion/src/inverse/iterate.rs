//! Where an inverse solve stands.

use super::Work;
use super::objective::Problem;
use serde::{Deserialize, Serialize};

/// A point on the way from the homogeneous start to the answer, enough to go on from there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Iterate {
    /// The grid: 0 the one that is solved, every further one half as many cells along each axis.
    pub level: usize,
    /// log κ (κ in mm) of every cell of that grid, then log μ (μ in 1/mm).
    pub logs: Vec<f64>,
    /// λ at work.
    pub lambda: f64,
    /// Whether λ is chosen, and no longer looked for.
    pub chosen: bool,
    /// The homogeneous start (κ in mm, μ in 1/mm).
    pub homogeneous: (f64, f64),
    /// What has been done so far.
    pub work: Work,
    /// Fit after every step.
    pub history: Vec<f64>,
}

impl Iterate {
    /// Whether it is one of a problem that is solved on these grids, the finest first.
    pub(super) fn fits(&self, levels: &[Problem]) -> bool {
        let (kappa, mu) = self.homogeneous;
        levels.get(self.level).is_some_and(|p| self.logs.len() == 2 * p.grid.len())
            && self.logs.iter().chain([&kappa, &mu, &self.lambda]).all(|v| v.is_finite())
            && kappa > 0.0
            && mu > 0.0
            && self.lambda >= 0.0
    }
}
