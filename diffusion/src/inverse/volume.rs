//! The default method: log κ and log μ of every cell, λ from the noise.

use super::homogeneous::{self, Start};
use super::lbfgs::{Minimiser, Point};
use super::objective::{Device, Objective, Problem, RANGE};
use super::{Inverse, InverseError, InverseSettings, Lambda, Observer, Progress, Stage};

/// λ is tried from here down: at 0.1 nothing but a nearly homogeneous block pays, at 1e-9 the
/// smoothness of any volume that fits is worth less than single precision.
const LAMBDA_FIRST: f64 = 0.1;
const LAMBDA_LAST: f64 = 1e-9;
const LAMBDA_FACTOR: f64 = 0.25;
/// A stage ends when this many steps have lowered the objective by less than 1 % (while λ is still
/// being looked for) or 0.1 % (at the chosen λ).
const PATIENCE: usize = 6;
const SEARCHING: f64 = 1e-2;
const FINAL: f64 = 1e-3;

pub(super) fn run<D: Device>(
    device: &mut D,
    problem: &Problem,
    settings: &InverseSettings,
    observer: Observer<'_>,
) -> Result<Inverse, InverseError> {
    let mut objective = device.objective(problem)?;
    let n = problem.grid.len();
    let count = problem.measurement.data().max(1) as f64;
    let start = homogeneous_start(&mut objective, problem, settings, observer)?;
    let centre = [start.kappa_mm.ln(), start.mu_per_mm.ln()];
    objective.centre(centre);
    let mut u = vec![centre[0]; 2 * n];
    u[n..].fill(centre[1]);
    let u = objective.vector(u);

    let mut lambda = match settings.lambda {
        Lambda::Fixed(lambda) => lambda,
        Lambda::Discrepancy => LAMBDA_FIRST,
    };
    let mut chosen = settings.lambda != Lambda::Discrepancy;
    let noise_share = problem.measurement.noise_share();
    let mut previous_chi2 = f64::INFINITY;
    let mut history = Vec::new();
    let mut minimiser = Minimiser::new(&mut objective, problem.measurement.weighted_energy());
    let mut here = minimiser.point(u, settings.tolerance)?;
    tell(minimiser.objective, &here, lambda, count, observer, &mut history)?;
    loop {
        let mut recent = vec![here.value(lambda)];
        let stop_gain = if chosen { FINAL } else { SEARCHING };
        let spent = loop {
            if minimiser.objective.work().gradient_evaluations >= settings.max_evaluations {
                break true;
            }
            let k = recent.len();
            if k > PATIENCE && recent[k - 1] > (1.0 - stop_gain) * recent[k - 1 - PATIENCE] {
                break false;
            }
            match minimiser.step(&here, lambda, settings.tolerance)? {
                Some(next) => here = next,
                // Converged to rounding.
                None => break false,
            }
            tell(minimiser.objective, &here, lambda, count, observer, &mut history)?;
            recent.push(here.value(lambda));
        };
        if chosen || spent {
            break;
        }
        let chi2 = here.misfit.weighted / count;
        // The noise is reached, in the many dark pixels, which make up χ², and in the bright ones,
        // which make up the fit; or a fourfold smaller λ no longer explains the images better, so
        // what is left is not in reach of κ and μ.
        let reached = chi2 <= 1.0 && here.misfit.fit <= noise_share;
        let stuck = chi2 > 0.98 * previous_chi2 && lambda < 1e-3;
        if reached || stuck || lambda * LAMBDA_FACTOR < LAMBDA_LAST {
            chosen = true;
        } else {
            previous_chi2 = chi2;
            lambda *= LAMBDA_FACTOR;
        }
    }
    let u = objective.host(&here.u);
    let value = |i: usize| {
        let c = centre[i / n];
        u[i].clamp(c - RANGE, c + RANGE).exp()
    };
    let work = objective.work();
    Ok(Inverse {
        kappa_mm: (0..n).map(value).collect(),
        mu_per_mm: (n..2 * n).map(value).collect(),
        homogeneous: (start.kappa_mm, start.mu_per_mm),
        gain: here.misfit.gain,
        fit: here.misfit.fit,
        chi2: here.misfit.weighted / count,
        lambda,
        work,
        history,
    })
}

fn homogeneous_start<O: Objective>(
    objective: &mut O,
    problem: &Problem,
    settings: &InverseSettings,
    observer: Observer<'_>,
) -> Result<Start, InverseError> {
    let n = problem.grid.len();
    let count = problem.measurement.data().max(1) as f64;
    homogeneous::fit(&problem.grid, |kappa, mu| {
        let mut u = vec![kappa.ln(); 2 * n];
        u[n..].fill(mu.ln());
        let misfit = objective.forward(&objective.vector(u), settings.tolerance)?;
        let progress = Progress {
            stage: Stage::Homogeneous,
            work: objective.work(),
            fit: misfit.fit,
            chi2: misfit.weighted / count,
            lambda: 0.0,
        };
        if observer(&progress) { Ok(misfit) } else { Err(InverseError::Interrupted) }
    })
}

fn tell<O: Objective>(
    objective: &O,
    here: &Point<O::Vector>,
    lambda: f64,
    count: f64,
    observer: Observer<'_>,
    history: &mut Vec<f64>,
) -> Result<(), InverseError> {
    history.push(here.misfit.fit);
    let progress = Progress {
        stage: Stage::Volume,
        work: objective.work(),
        fit: here.misfit.fit,
        chi2: here.misfit.weighted / count,
        lambda,
    };
    if observer(&progress) { Ok(()) } else { Err(InverseError::Interrupted) }
}
