//! The default method: L-BFGS on log κ and log μ, λ from the noise.

use super::data_term::{DataTerm, Misfit};
use super::homogeneous::Start;
use super::smoothness::squared_gradient;
use super::{Inverse, InverseError, InverseSettings, Lambda, Observer, Progress, Stage};
use crate::{LinearSolver, Medium};
use argmin::core::{CostFunction, Error, Executor, Gradient};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use std::cell::RefCell;

/// Pairs of steps and gradients that L-BFGS remembers; scipy's and Nocedal's usual choice.
const MEMORY: usize = 10;
/// λ is tried from here down: at 0.1 nothing but a nearly homogeneous block pays, at 1e-9 the
/// smoothness of any volume that fits is worth less than single precision.
const LAMBDA_FIRST: f64 = 0.1;
const LAMBDA_LAST: f64 = 1e-9;
const LAMBDA_FACTOR: f64 = 0.25;
/// A stage ends when this many evaluations have lowered the objective by less than 1 %
/// (while λ is still being looked for) or 0.1 % (at the chosen λ).
const PATIENCE: usize = 6;
const SEARCHING: f64 = 1e-2;
const FINAL: f64 = 1e-3;
/// κ and μ stay within e^±6 (a factor of 400) of the homogeneous start: outside, a line search
/// has run away, and the exponential must not overflow.
const RANGE: f64 = 6.0;

pub(super) fn run<S: LinearSolver>(
    data: DataTerm<'_, S>,
    settings: &InverseSettings,
    start: Start,
    observer: Observer<'_>,
) -> Result<Inverse, InverseError> {
    let n = data.grid.len();
    let origin = [start.kappa_mm.ln(), start.mu_per_mm.ln()];
    let count = data.measurement.data().max(1) as f64;
    let energy = data.measurement.weighted_energy();
    let mut u = vec![origin[0]; 2 * n];
    u[n..].fill(origin[1]);
    let state = RefCell::new(State {
        data,
        origin,
        energy,
        count,
        lambda: 0.0,
        scale: 1.0,
        stop_gain: SEARCHING,
        budget: settings.max_evaluations,
        cached: None,
        best: None,
        recent: Vec::new(),
        history: Vec::new(),
        observer,
        failure: None,
    });

    let mut lambda = match settings.lambda {
        Lambda::Fixed(lambda) => lambda,
        Lambda::Discrepancy => LAMBDA_FIRST,
    };
    let search = settings.lambda == Lambda::Discrepancy;
    let mut previous_chi2 = f64::INFINITY;
    let mut chosen = !search;
    loop {
        let gain = if chosen { FINAL } else { SEARCHING };
        u = minimise(&state, u, lambda, gain)?;
        let best = state.borrow().best.clone().ok_or_else(nothing_evaluated)?;
        let chi2 = best.misfit.weighted / count;
        let spent = state.borrow().exhausted();
        if chosen || spent {
            return Ok(finish(state.into_inner(), best, lambda, start, n));
        }
        // The noise is reached; or a fourfold smaller λ no longer explains the images better,
        // so what is left is not in reach of κ and μ.
        let stuck = chi2 > 0.98 * previous_chi2 && lambda < 1e-3;
        if chi2 <= 1.0 || stuck || lambda * LAMBDA_FACTOR < LAMBDA_LAST {
            chosen = true;
        } else {
            previous_chi2 = chi2;
            lambda *= LAMBDA_FACTOR;
        }
    }
}

fn nothing_evaluated() -> InverseError {
    InverseError::Optimiser("nothing was evaluated".into())
}

/// One L-BFGS run at one λ; returns the best point.
fn minimise<S: LinearSolver>(
    state: &RefCell<State<'_, '_, S>>,
    u: Vec<f64>,
    lambda: f64,
    stop_gain: f64,
) -> Result<Vec<f64>, InverseError> {
    state.borrow_mut().begin(lambda, stop_gain);
    // The first step of a line search has length 1 along the gradient: scale the objective so
    // that it moves log κ or log μ by a third at most.
    let largest = {
        let mut s = state.borrow_mut();
        s.scale = 1.0;
        let (_, g) = s.evaluate(&u).map_err(|e| s.take_failure(e))?;
        let largest = g.iter().fold(0.0f64, |a, g| a.max(g.abs()));
        s.scale = if largest > 0.0 { 0.3 / largest } else { 1.0 };
        s.cached = None;
        s.recent.clear();
        s.best = None;
        largest
    };
    if largest > 0.0 {
        let solver = LBFGS::new(MoreThuenteLineSearch::new(), MEMORY);
        let run = Executor::new(Objective(state), solver)
            .configure(|s| s.param(u).max_iters(u64::MAX))
            .run();
        if let Err(error) = run {
            let mut s = state.borrow_mut();
            if let Some(failure) = s.failure.take() {
                return Err(failure);
            }
            // A line search that can find no lower point any more has converged to rounding:
            // the best point stands. Without one there is nothing to return.
            if s.best.is_none() {
                return Err(InverseError::Optimiser(error.to_string()));
            }
        }
    }
    let best = state.borrow().best.clone().ok_or_else(nothing_evaluated)?;
    Ok(best.u)
}

/// The best point of a stage.
#[derive(Clone)]
struct Best {
    objective: f64,
    u: Vec<f64>,
    misfit: Misfit,
}

struct State<'a, 'o, S> {
    data: DataTerm<'a, S>,
    origin: [f64; 2],
    energy: f64,
    count: f64,
    lambda: f64,
    scale: f64,
    stop_gain: f64,
    budget: usize,
    cached: Option<(Vec<f64>, f64, Vec<f64>)>,
    best: Option<Best>,
    recent: Vec<f64>,
    history: Vec<f64>,
    observer: Observer<'o>,
    failure: Option<InverseError>,
}

/// Ends a stage from inside the optimiser; no failure.
#[derive(Debug, thiserror::Error)]
#[error("stage finished")]
struct StageFinished;

impl<S: LinearSolver> State<'_, '_, S> {
    fn begin(&mut self, lambda: f64, stop_gain: f64) {
        self.lambda = lambda;
        self.stop_gain = stop_gain;
        self.cached = None;
        self.best = None;
        self.recent.clear();
    }

    fn exhausted(&self) -> bool {
        self.data.gradient_evaluations >= self.budget
    }

    fn take_failure(&mut self, error: Error) -> InverseError {
        self.failure.take().unwrap_or_else(|| InverseError::Optimiser(error.to_string()))
    }

    /// Objective and gradient by u = (log κ, log μ), from the cache where possible.
    fn evaluate(&mut self, u: &[f64]) -> Result<(f64, Vec<f64>), Error> {
        if let Some((at, value, gradient)) = &self.cached
            && at == u
        {
            return Ok((*value, gradient.clone()));
        }
        if self.best.is_some() && (self.exhausted() || self.settled()) {
            return Err(StageFinished.into());
        }
        let (value, gradient, misfit) = match self.compute(u) {
            Ok(all) => all,
            Err(error) => {
                let text = error.to_string();
                self.failure = Some(error);
                return Err(Error::msg(text));
            }
        };
        self.history.push(misfit.fit);
        let improved = self.best.as_ref().is_none_or(|b| value < b.objective);
        if improved {
            self.best = Some(Best { objective: value, u: u.to_vec(), misfit });
        }
        self.recent.push(self.best.as_ref().map_or(value, |b| b.objective));
        let scaled: Vec<f64> = gradient.iter().map(|g| g * self.scale).collect();
        self.cached = Some((u.to_vec(), value * self.scale, scaled.clone()));
        Ok((value * self.scale, scaled))
    }

    fn settled(&self) -> bool {
        let n = self.recent.len();
        n > PATIENCE && self.recent[n - 1] > (1.0 - self.stop_gain) * self.recent[n - 1 - PATIENCE]
    }

    fn compute(&mut self, u: &[f64]) -> Result<(f64, Vec<f64>, Misfit), InverseError> {
        let n = u.len() / 2;
        let inside = |i: usize| (u[i] - self.origin[i / n]).abs() <= RANGE;
        let value_of = |i: usize| {
            let o = self.origin[i / n];
            u[i].clamp(o - RANGE, o + RANGE).exp()
        };
        let values: Vec<f64> = (0..2 * n).map(value_of).collect();
        let keep: Vec<bool> = (0..2 * n).map(inside).collect();
        let medium = Medium::new(self.data.grid, values[..n].to_vec(), values[n..].to_vec())
            .map_err(|e| InverseError::Optimiser(e.to_string()))?;
        let mut misfit = self.data.evaluate(medium, true)?;
        let mut gradient: Vec<f64> = misfit
            .by_kappa
            .iter()
            .chain(&misfit.by_mu)
            .zip(values.iter().zip(&keep))
            .map(|(g, (v, keep))| if *keep { g * v / self.energy } else { 0.0 })
            .collect();
        (misfit.by_kappa, misfit.by_mu) = (Vec::new(), Vec::new());
        let mut objective = misfit.weighted / self.energy;
        let (of_kappa, of_mu) = gradient.split_at_mut(n);
        for (u, g) in [(&u[..n], of_kappa), (&u[n..], of_mu)] {
            objective += self.lambda * squared_gradient(&self.data.grid, u, self.lambda, g);
        }
        let progress = Progress {
            stage: Stage::Volume,
            gradient_evaluations: self.data.gradient_evaluations,
            linear_solves: self.data.linear_solves,
            fit: misfit.fit,
            chi2: misfit.weighted / self.count,
            lambda: self.lambda,
        };
        if !(self.observer)(&progress) {
            return Err(InverseError::Interrupted);
        }
        Ok((objective, gradient, misfit))
    }
}

/// argmin asks for the value and the gradient of the same point one after the other.
struct Objective<'s, 'a, 'o, S>(&'s RefCell<State<'a, 'o, S>>);

impl<S: LinearSolver> CostFunction for Objective<'_, '_, '_, S> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, u: &Vec<f64>) -> Result<f64, Error> {
        Ok(self.0.borrow_mut().evaluate(u)?.0)
    }
}

impl<S: LinearSolver> Gradient for Objective<'_, '_, '_, S> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, u: &Vec<f64>) -> Result<Vec<f64>, Error> {
        Ok(self.0.borrow_mut().evaluate(u)?.1)
    }
}

fn finish<S: LinearSolver>(
    state: State<'_, '_, S>,
    best: Best,
    lambda: f64,
    start: Start,
    n: usize,
) -> Inverse {
    let value = |i: usize| {
        let o = state.origin[i / n];
        best.u[i].clamp(o - RANGE, o + RANGE).exp()
    };
    Inverse {
        kappa_mm: (0..n).map(value).collect(),
        mu_per_mm: (n..2 * n).map(value).collect(),
        homogeneous: (start.kappa_mm, start.mu_per_mm),
        gain: best.misfit.gain,
        fit: best.misfit.fit,
        chi2: best.misfit.weighted / state.count,
        lambda,
        gradient_evaluations: state.data.gradient_evaluations,
        linear_solves: state.data.linear_solves,
        history: state.history,
    }
}
