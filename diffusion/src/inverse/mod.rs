//! From images to coefficients: κ and μ of every cell of one channel.

mod accuracy;
mod data_term;
mod evaluate;
mod homogeneous;
mod iterate;
mod lbfgs;
mod levels;
mod measurement;
mod objective;
mod paper;
mod posterior;
mod smoothness;
mod volume;
mod work;

pub(crate) use data_term::WithSolver;
pub use evaluate::{Evaluation, evaluate, evaluate_on_gpu};
pub use iterate::Iterate;
pub use measurement::{Measurement, MeasurementError};
pub(crate) use objective::{Device, Misfit, Objective, Problem, RANGE, Vector};
pub use posterior::{Determination, PROBING_TOLERANCE, Solved, widest_patch_mm};
pub(crate) use smoothness::{OF_MU, pull, step_weights};
pub use work::Work;

use crate::gpu::OnGpu;
use crate::{Gpu, LinearSolver, SolveError};
use material::{Grid, Optics};
use serde::{Deserialize, Serialize};

/// How the coefficients are looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// log κ and log μ, smoothness on both, L-BFGS, weights from the variances.
    #[default]
    Lbfgs,
    /// W08 Table I: κ and μ themselves, Polak–Ribière conjugate gradients with golden-section
    /// line search, smoothness on κ alone, no weights, stop at ε = 1e-4 Σ L².
    Paper,
}

/// How strong the smoothness term is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Lambda {
    /// The one under which pixels that the fit does not see are explained best (cross-validation).
    #[default]
    CrossValidation,
    /// A given λ, relative to the (weighted) energy of the images.
    Fixed(f64),
}

/// Settings of an inverse solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InverseSettings {
    /// The method.
    pub method: Method,
    /// Strength of the smoothness term.
    pub lambda: Lambda,
    /// Fit one gain beside κ and μ. It is reported; near 1 means that the radiometry is right.
    pub free_gain: bool,
    /// What the model itself cannot get right, relative to the brightest pixel of each image:
    /// added to the standard deviation of every pixel. The solved grid's own discretisation is
    /// the largest part of it; without it, dark pixels far from the light, which a coarse grid
    /// gets wrong by percents, would outweigh everything.
    pub model_error: f64,
    /// Keep edges: a step of log κ or log μ between neighbouring cells costs its square up to about this
    /// size, and in proportion to itself beyond, so that one large step is no dearer than many small
    /// ones. None: its square always. (Of [`Method::Lbfgs`].)
    pub edge: Option<f64>,
    /// Most gradient evaluations on each grid.
    pub max_evaluations: usize,
    /// Relative residual of the linear solves.
    pub tolerance: f64,
}

impl Default for InverseSettings {
    fn default() -> Self {
        Self {
            method: Method::Lbfgs,
            lambda: Lambda::CrossValidation,
            free_gain: false,
            model_error: 2e-3,
            edge: None,
            max_evaluations: 400,
            tolerance: 1e-6,
        }
    }
}

/// Where an inverse solve is.
#[derive(Clone, Copy)]
pub struct Progress<'a> {
    /// What is being done.
    pub stage: Stage,
    /// What has been done so far.
    pub work: Work,
    /// J: what is minimised, on the grid at work.
    pub objective: f64,
    /// Fit f (design section 9) on the grid at work.
    pub fit: f64,
    /// Mean squared residual in units of the noise, χ²/N.
    pub chi2: f64,
    /// λ at work.
    pub lambda: f64,
    /// Cells of the grid at work.
    pub cells: [usize; 3],
    iterate: Option<&'a dyn Fn() -> Option<Iterate>>,
}

impl Progress<'_> {
    /// On the way to the homogeneous start.
    fn homogeneous(problem: &Problem, work: Work, misfit: &Misfit) -> Self {
        Self {
            stage: Stage::Homogeneous,
            work,
            objective: misfit.fit,
            fit: misfit.fit,
            chi2: problem.chi2(misfit),
            lambda: 0.0,
            cells: problem.grid.cells(),
            iterate: None,
        }
    }

    /// What [`invert`] can go on from, brought from the device; none before there is a volume,
    /// where the device is lost, and with the paper's method.
    pub fn iterate(&self) -> Option<Iterate> {
        self.iterate.and_then(|iterate| iterate())
    }
}

/// The part of an inverse solve that is running.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Two numbers for the whole block.
    Homogeneous,
    /// Every cell.
    Volume,
}

/// What an inverse solve found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Inverse {
    /// κ of every cell, mm.
    pub kappa_mm: Vec<f64>,
    /// μ of every cell, 1/mm.
    pub mu_per_mm: Vec<f64>,
    /// The homogeneous start (κ in mm, μ in 1/mm).
    pub homogeneous: (f64, f64),
    /// Fitted gain, 1 when it was not free.
    pub gain: f64,
    /// Fit f.
    pub fit: f64,
    /// χ²/N.
    pub chi2: f64,
    /// λ used, relative to the (weighted) energy of the images.
    pub lambda: f64,
    /// Whether it ended by itself, not by [`InverseSettings::max_evaluations`].
    pub converged: bool,
    /// What it took, the homogeneous start included.
    pub work: Work,
    /// Fit after every step, on the grid that it was made on.
    pub history: Vec<f64>,
}

/// Why an inverse solve has no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InverseError {
    /// A linear solve failed.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// The optimiser gave up.
    #[error("the optimiser stopped: {0}")]
    Optimiser(String),
    /// The observer asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Tells the caller how far it is; returns false to stop.
pub type Observer<'a> = &'a mut dyn FnMut(&Progress<'_>) -> bool;

/// Finds κ and μ of every cell of `grid` so that the diffusion equation reproduces the images.
///
/// Minimises Σ w (γL − L_meas)² / Σ w L_meas² + λ (R(log κ) + R(log μ)), w = 1/variance (design
/// section 5), from a homogeneous start and from coarse to fine.
///
/// # Errors
/// A linear solve fails, the optimiser gives up, or `observer` returns false.
pub fn invert<S: LinearSolver>(
    grid: &Grid,
    optics: &Optics,
    measurement: &Measurement,
    settings: &InverseSettings,
    solver: &mut S,
    observer: Observer<'_>,
) -> Result<Inverse, InverseError> {
    invert_from(None, grid, optics, measurement, settings, solver, observer)
}

/// [`invert`] from where another solve of the same problem stood. (The paper's method begins anew.)
///
/// # Errors
/// As [`invert`].
pub fn invert_from<S: LinearSolver>(
    iterate: Option<Iterate>,
    grid: &Grid,
    optics: &Optics,
    measurement: &Measurement,
    settings: &InverseSettings,
    solver: &mut S,
    observer: Observer<'_>,
) -> Result<Inverse, InverseError> {
    let problem = problem(grid, optics, measurement, settings);
    match settings.method {
        Method::Lbfgs => {
            volume::run(&mut WithSolver(solver), &problem, settings, iterate, observer)
        }
        Method::Paper => paper::run(&mut WithSolver(solver), &problem, settings, observer),
    }
}

/// [`invert_from`] with everything on a GPU: forward and adjoint solves, gradient, smoothness and the
/// optimiser's vectors. (Those of `Method::Paper` are argmin's, on the host.)
///
/// # Errors
/// As [`invert`]; also if the GPU cannot hold the problem, or is lost.
pub fn invert_on_gpu(
    iterate: Option<Iterate>,
    grid: &Grid,
    optics: &Optics,
    measurement: &Measurement,
    settings: &InverseSettings,
    gpu: &Gpu,
    observer: Observer<'_>,
) -> Result<Inverse, InverseError> {
    let problem = problem(grid, optics, measurement, settings);
    match settings.method {
        Method::Lbfgs => volume::run(&mut OnGpu(gpu), &problem, settings, iterate, observer),
        Method::Paper => paper::run(&mut OnGpu(gpu), &problem, settings, observer),
    }
}

fn problem(
    grid: &Grid,
    optics: &Optics,
    measurement: &Measurement,
    settings: &InverseSettings,
) -> Problem {
    let measurement = match settings.method {
        Method::Lbfgs => measurement.clone(),
        Method::Paper => measurement.unweighted(),
    };
    let (free_gain, edge) = (settings.free_gain, settings.edge);
    Problem { grid: *grid, optics: *optics, measurement, free_gain, edge }
}
