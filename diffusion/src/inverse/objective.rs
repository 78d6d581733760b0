//! What the outer loop asks of the device that evaluates the objective.

use super::measurement::Measurement;
use super::{InverseError, Work};
use material::{Grid, Optics};

/// How far the images of a medium are from the measured ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Misfit {
    /// Σ w (γ L − L_meas)².
    pub weighted: f64,
    /// The same over the pixels that are kept out of the fit.
    pub kept_out: f64,
    /// Σ (γ L − L_meas)² / Σ L_meas² over pixels that are not masked (design: fit f).
    pub fit: f64,
    /// γ: 1, or the gain that minimises the data term.
    pub gain: f64,
}

/// u = (log κ, log μ) or a gradient by it: 2 · cells numbers, wherever they are kept.
pub(crate) trait Vector: Clone {
    /// The same in single precision, for what is only remembered: many of them are, at 256 × 256 × 20 cells
    /// ten megabytes each.
    type Kept;
    /// In single precision.
    fn keep(&self) -> Self::Kept;
    /// self · kept.
    fn dot_kept(&self, kept: &Self::Kept) -> f64;
    /// self += factor · kept.
    fn add_kept(&mut self, factor: f64, kept: &Self::Kept);
    /// self · other.
    fn dot(&self, other: &Self) -> f64;
    /// self += factor · other.
    fn add_scaled(&mut self, factor: f64, other: &Self);
    /// self *= factor.
    fn scale(&mut self, factor: f64);
    /// Largest absolute value.
    fn largest(&self) -> f64;
}

impl Vector for Vec<f64> {
    type Kept = Vec<f32>;

    fn keep(&self) -> Vec<f32> {
        self.iter().map(|v| *v as f32).collect()
    }

    fn dot_kept(&self, kept: &Vec<f32>) -> f64 {
        self.iter().zip(kept).map(|(a, b)| a * f64::from(*b)).sum()
    }

    fn add_kept(&mut self, factor: f64, kept: &Vec<f32>) {
        for (a, b) in self.iter_mut().zip(kept) {
            *a += factor * f64::from(*b);
        }
    }

    fn dot(&self, other: &Self) -> f64 {
        self.iter().zip(other).map(|(a, b)| a * b).sum()
    }

    fn add_scaled(&mut self, factor: f64, other: &Self) {
        for (a, b) in self.iter_mut().zip(other) {
            *a += factor * b;
        }
    }

    fn scale(&mut self, factor: f64) {
        for a in self {
            *a *= factor;
        }
    }

    fn largest(&self) -> f64 {
        self.iter().fold(0.0, |largest, a| a.abs().max(largest))
    }
}

/// κ and μ stay within e^±6 (a factor of 400) of the homogeneous start: outside, a line search
/// has run away, and the exponential must not overflow.
pub(crate) const RANGE: f64 = 6.0;

/// The two terms of the objective as functions of u = (log κ, log μ):
/// D(u) = Σ w (γL − L_meas)² / Σ w L_meas² and R(u) = R(log κ) + ω R(log μ), see `smoothness.rs`.
///
/// They are kept apart so that the outer loop can change λ without a solve. Value and gradient of
/// D are two steps, since a step that a line search rejects needs no adjoint.
pub(crate) trait Objective {
    /// Where u lives.
    type Vector: Vector;

    /// Cells of the grid.
    fn cells(&self) -> usize;

    /// Brings 2 · cells numbers to the device.
    fn vector(&self, host: Vec<f64>) -> Self::Vector;

    /// Brings them back.
    fn host(&self, u: &Self::Vector) -> Result<Vec<f64>, InverseError>;

    /// From here on u counts only within [`RANGE`] of (log κ, log μ) = `centre`; outside, D is that
    /// of the nearest point inside and its derivative 0. R pulls towards it. Before the first call
    /// there is neither limit nor pull.
    fn centre(&mut self, centre: [f64; 2]);

    /// Solves the forward problem of every pattern at `u`, starting from the last fluence.
    fn forward(&mut self, u: &Self::Vector, tolerance: f64) -> Result<Misfit, InverseError>;

    /// ∂D/∂u at the `u` of the last [`forward`](Self::forward), starting from the last adjoint
    /// fluence.
    fn gradient(&mut self, tolerance: f64) -> Result<Self::Vector, InverseError>;

    /// R(u) and ∂R/∂u. No solves.
    fn smoothness(&mut self, u: &Self::Vector) -> (f64, Self::Vector);

    /// Forgets the last fluences: the next solves begin from nothing.
    fn forget(&mut self);

    /// What has been done since this objective was made, in its own cells.
    fn work(&self) -> Work;
}

/// Everything that the objective is made of, on one grid.
#[derive(Clone, Debug)]
pub(crate) struct Problem {
    pub grid: Grid,
    pub optics: Optics,
    /// With its final weights.
    pub measurement: Measurement,
    pub free_gain: bool,
    /// Of [`InverseSettings`](super::InverseSettings).
    pub edge: Option<f64>,
}

impl Problem {
    /// χ²/N of a misfit.
    pub fn chi2(&self, misfit: &Misfit) -> f64 {
        misfit.weighted / self.measurement.data().max(1) as f64
    }
}

/// Makes objectives: the outer loop asks for one on every grid, from coarse to fine, one at a time.
pub(crate) trait Device {
    /// The objective on this device.
    type Objective<'a>: Objective
    where
        Self: 'a;

    /// The objective of a problem.
    fn objective<'a>(
        &'a mut self,
        problem: &'a Problem,
    ) -> Result<Self::Objective<'a>, InverseError>;
}
