//! How long an evaluation of the objective takes.

use super::objective::{Device, Objective, Problem, Vector};
use super::{InverseError, Measurement, WithSolver};
use crate::gpu::OnGpu;
use crate::{Gpu, LinearSolver, Medium};
use material::{Grid, Optics};
use std::time::Instant;

/// One evaluation from nothing: no fluence of a medium near by to begin with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluation {
    /// The misfit: coefficients, set-up, and one solve for each pattern, seconds.
    pub forward_s: f64,
    /// The gradient after it: one more solve for each pattern, and the contraction, seconds.
    pub gradient_s: f64,
    /// Preconditioned iterations of the forward solve.
    pub iterations: usize,
}

/// Evaluates misfit and gradient at `medium` with linear solves to `tolerance`, and gives the
/// shortest times out of `repeats`. (On a GPU memory is taken and kernels are compiled before.)
///
/// # Errors
/// A solve fails.
pub fn evaluate<S: LinearSolver>(
    grid: &Grid,
    optics: &Optics,
    measurement: &Measurement,
    medium: &Medium,
    tolerance: f64,
    repeats: usize,
    solver: &mut S,
) -> Result<Evaluation, InverseError> {
    let problem = problem(grid, optics, measurement);
    timed(&mut WithSolver(solver), &problem, medium, tolerance, repeats)
}

/// [`evaluate`] on a GPU.
///
/// # Errors
/// As [`evaluate`]; also if the GPU cannot hold the problem, or is lost.
pub fn evaluate_on_gpu(
    grid: &Grid,
    optics: &Optics,
    measurement: &Measurement,
    medium: &Medium,
    tolerance: f64,
    repeats: usize,
    gpu: &Gpu,
) -> Result<Evaluation, InverseError> {
    let problem = problem(grid, optics, measurement);
    timed(&mut OnGpu(gpu), &problem, medium, tolerance, repeats)
}

fn problem(grid: &Grid, optics: &Optics, measurement: &Measurement) -> Problem {
    let measurement = measurement.clone();
    Problem { grid: *grid, optics: *optics, measurement, free_gain: false, edge: None }
}

fn timed<D: Device>(
    device: &mut D,
    problem: &Problem,
    medium: &Medium,
    tolerance: f64,
    repeats: usize,
) -> Result<Evaluation, InverseError> {
    let logs = medium.kappa_mm().iter().chain(medium.mu_per_mm()).map(|v| v.ln()).collect();
    let mut objective = device.objective(problem)?;
    let u = objective.vector(logs);
    let mut best =
        Evaluation { forward_s: f64::INFINITY, gradient_s: f64::INFINITY, iterations: 0 };
    for _ in 0..repeats.max(1) {
        objective.forget();
        let before = objective.work().fine_iterations;
        let began = Instant::now();
        objective.forward(&u, tolerance)?;
        let forward_s = began.elapsed().as_secs_f64();
        let spent = objective.work().fine_iterations - before;
        let began = Instant::now();
        // A look at the result: on a GPU nothing has happened before somebody waits for it.
        std::hint::black_box(objective.gradient(tolerance)?.largest());
        let gradient_s = began.elapsed().as_secs_f64();
        if forward_s < best.forward_s {
            best.iterations = (spent / problem.measurement.light().count() as f64) as usize;
        }
        best.forward_s = best.forward_s.min(forward_s);
        best.gradient_s = best.gradient_s.min(gradient_s);
    }
    Ok(best)
}
