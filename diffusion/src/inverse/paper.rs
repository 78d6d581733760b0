//! The method of W08, Table I, to the letter, so that the paper can be reproduced.
//!
//! Unknowns κ and μ themselves; f_M = Σ (L − L_meas)² + λ ‖∇κ‖²; Polak–Ribière conjugate gradients
//! (Table I prints p_T where p_t is meant); golden-section line search; stop when the
//! data term is below ε = 1e-4 Σ L_meas². The paper's λ = 1e-5 has no units: here λ is
//! relative, λ ‖∇κ‖² / κ₀² against Σ L_meas², with κ₀ the homogeneous start.

use super::homogeneous::{self, Start};
use super::objective::{self, Device, Objective};
use super::smoothness::squared_gradient;
use super::{Inverse, InverseError, InverseSettings, Lambda, Observer, Progress, Stage};
use argmin::core::{
    CostFunction, Error, Executor, Gradient, IterState, KV, LineSearch, Problem, Solver, State,
    TerminationReason,
};
use argmin::solver::conjugategradient::NonlinearConjugateGradient;
use argmin::solver::conjugategradient::beta::PolakRibierePlus;
use std::cell::RefCell;

/// ε of W08 section 4.
const EPSILON: f64 = 1e-4;
/// The line search ends when the bracket is this share of its far end.
const BRACKET: f64 = 0.05;
const GOLDEN: f64 = 0.618_033_988_749_894_8;
/// Coefficients stay above this share of the homogeneous start. Table I does not say what keeps
/// κ and μ positive; without a floor the first long step leaves the physical range.
const FLOOR: f64 = 1e-3;

/// Solves, misfit and gradient are the device's; the conjugate gradients are argmin's, on the host: two
/// numbers a cell go there and back for every gradient, which is a thousandth of what a solve moves.
pub(super) fn run<D: Device>(
    device: &mut D,
    problem: &objective::Problem,
    settings: &InverseSettings,
    observer: Observer<'_>,
) -> Result<Inverse, InverseError> {
    let n = problem.grid.len();
    let mut data = device.objective(problem)?;
    let start = homogeneous::fit(&problem.grid, |kappa, mu| {
        let u = data.vector(homogeneous::logs(n, kappa, mu));
        let misfit = data.forward(&u, settings.tolerance)?;
        let progress = Progress::homogeneous(problem, data.work(), &misfit);
        if observer(&progress) { Ok(misfit) } else { Err(InverseError::Interrupted) }
    })?;
    let lambda = match settings.lambda {
        Lambda::Fixed(lambda) => lambda,
        Lambda::CrossValidation => 1e-5,
    };
    let mut x = vec![start.kappa_mm; 2 * n];
    x[n..].fill(start.mu_per_mm);
    let state = RefCell::new(Descent {
        data,
        problem,
        start,
        lambda,
        budget: settings.max_evaluations,
        tolerance: settings.tolerance,
        best: None,
        history: Vec::new(),
        observer,
        failure: None,
    });
    let solver = NonlinearConjugateGradient::new(GoldenSection::default(), PolakRibierePlus::new());
    let run = Executor::new(Descending(&state), solver)
        .configure(|s| s.param(x).max_iters(u64::MAX))
        .run()
        .err()
        .map(|error| error.to_string());
    let state = state.into_inner();
    if let Some(failure) = state.failure {
        return Err(failure);
    }
    let best = match (state.best, run) {
        (Some(best), _) => best,
        (None, error) => {
            let why = error.unwrap_or_else(|| "nothing was evaluated".into());
            return Err(InverseError::Optimiser(why));
        }
    };
    let positive = positive(&best.x, start);
    Ok(Inverse {
        kappa_mm: positive[..n].to_vec(),
        mu_per_mm: positive[n..].to_vec(),
        homogeneous: (start.kappa_mm, start.mu_per_mm),
        gain: best.gain,
        fit: best.fit,
        chi2: best.chi2,
        lambda,
        converged: best.fit <= EPSILON,
        work: state.data.work(),
        history: state.history,
    })
}

struct Best {
    x: Vec<f64>,
    objective: f64,
    fit: f64,
    chi2: f64,
    gain: f64,
}

struct Descent<'p, 'o, O> {
    data: O,
    problem: &'p objective::Problem,
    start: Start,
    lambda: f64,
    budget: usize,
    tolerance: f64,
    best: Option<Best>,
    history: Vec<f64>,
    observer: Observer<'o>,
    failure: Option<InverseError>,
}

#[derive(Debug, thiserror::Error)]
#[error("ε is reached, or the evaluations are spent")]
struct Finished;

fn positive(x: &[f64], start: Start) -> Vec<f64> {
    let n = x.len() / 2;
    let floor = [start.kappa_mm * FLOOR, start.mu_per_mm * FLOOR];
    x.iter().enumerate().map(|(i, v)| v.max(floor[i / n])).collect()
}

impl<O: Objective> Descent<'_, '_, O> {
    fn evaluate(&mut self, x: &[f64], gradient: bool) -> Result<(f64, Vec<f64>), Error> {
        let reached = self.best.as_ref().is_some_and(|b| b.fit <= EPSILON);
        if reached || self.data.work().gradient_evaluations >= self.budget {
            return Err(Finished.into());
        }
        self.compute(x, gradient).map_err(|error| {
            let text = error.to_string();
            self.failure = Some(error);
            Error::msg(text)
        })
    }

    fn compute(&mut self, x: &[f64], gradient: bool) -> Result<(f64, Vec<f64>), InverseError> {
        let n = x.len() / 2;
        let values = positive(x, self.start);
        let logs = self.data.vector(values.iter().map(|v| v.ln()).collect());
        let misfit = self.data.forward(&logs, self.tolerance)?;
        let mut slope = vec![0.0; 2 * n];
        if gradient {
            let by_logs = self.data.gradient(self.tolerance)?;
            slope = self.data.host(&by_logs)?;
            slope.iter_mut().zip(&values).for_each(|(slope, value)| *slope /= value);
        }
        let grid = &self.problem.grid;
        let scale = self.lambda / self.start.kappa_mm.powi(2);
        let roughness = squared_gradient(grid, &values[..n], scale, &mut slope[..n]);
        for i in 0..2 * n {
            if values[i] != x[i] {
                slope[i] = 0.0;
            }
        }
        let objective = misfit.weighted / self.problem.measurement.energy() + scale * roughness;
        if gradient {
            self.history.push(misfit.fit);
        }
        let chi2 = self.problem.chi2(&misfit);
        if self.best.as_ref().is_none_or(|b| objective < b.objective) {
            let (fit, gain) = (misfit.fit, misfit.gain);
            self.best = Some(Best { x: x.to_vec(), objective, fit, chi2, gain });
        }
        let progress = Progress {
            stage: Stage::Volume,
            work: self.data.work(),
            objective,
            fit: misfit.fit,
            chi2,
            lambda: self.lambda,
            cells: grid.cells(),
            iterate: None,
        };
        if (self.observer)(&progress) {
            Ok((objective, slope))
        } else {
            Err(InverseError::Interrupted)
        }
    }
}

struct Descending<'s, 'p, 'o, O>(&'s RefCell<Descent<'p, 'o, O>>);

impl<O: Objective> CostFunction for Descending<'_, '_, '_, O> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Error> {
        Ok(self.0.borrow_mut().evaluate(x, false)?.0)
    }
}

impl<O: Objective> Gradient for Descending<'_, '_, '_, O> {
    type Param = Vec<f64>;
    type Gradient = Vec<f64>;
    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Error> {
        Ok(self.0.borrow_mut().evaluate(x, true)?.1)
    }
}

/// Golden-section search along a direction: the bracket grows until the value rises, then
/// shrinks by the golden ratio. argmin has the search for one variable but not as a line search.
#[derive(Clone, Default)]
struct GoldenSection {
    direction: Vec<f64>,
    last_step: Option<f64>,
}

impl LineSearch<Vec<f64>, f64> for GoldenSection {
    fn search_direction(&mut self, direction: Vec<f64>) {
        self.direction = direction;
    }
    fn initial_step_length(&mut self, _: f64) -> Result<(), Error> {
        Ok(())
    }
}

type Line = IterState<Vec<f64>, Vec<f64>, (), (), (), f64>;

impl<O: CostFunction<Param = Vec<f64>, Output = f64>> Solver<O, Line> for GoldenSection {
    fn name(&self) -> &str {
        "golden section"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<O>,
        mut state: Line,
    ) -> Result<(Line, Option<KV>), Error> {
        let x = state.take_param().ok_or_else(|| Error::msg("no starting point"))?;
        let moved = |s: f64| -> Vec<f64> {
            x.iter().zip(&self.direction).map(|(x, d)| x + s * d).collect()
        };
        let mut value = |s: f64| problem.cost(&moved(s));
        let here = value(0.0)?;
        // First step: move the coefficient that moves most by a tenth of its own size.
        let largest = self.direction.iter().zip(&x).map(|(d, x)| (d / x).abs()).fold(0.0, f64::max);
        if largest == 0.0 {
            let state = state.param(x).cost(here);
            return Ok((state.terminate_with(TerminationReason::SolverConverged), None));
        }
        let mut far = self.last_step.unwrap_or(0.1 / largest);
        let mut near = 0.0;
        let mut far_value = value(far)?;
        while far_value > here && far * largest > 1e-9 {
            far *= GOLDEN * GOLDEN;
            far_value = value(far)?;
        }
        loop {
            let next = far / GOLDEN;
            let next_value = value(next)?;
            if next_value >= far_value {
                far = next;
                break;
            }
            (near, far, far_value) = (far, next, next_value);
        }
        let (mut a, mut b) = (far - GOLDEN * (far - near), near + GOLDEN * (far - near));
        let (mut at_a, mut at_b) = (value(a)?, value(b)?);
        while far - near > BRACKET * far {
            if at_a < at_b {
                (far, b, at_b) = (b, a, at_a);
                a = far - GOLDEN * (far - near);
                at_a = value(a)?;
            } else {
                (near, a, at_a) = (a, b, at_b);
                b = near + GOLDEN * (far - near);
                at_b = value(b)?;
            }
        }
        let (step, cost) = if at_a < at_b { (a, at_a) } else { (b, at_b) };
        self.last_step = Some(step);
        let state = state.param(moved(step)).cost(cost);
        Ok((state.terminate_with(TerminationReason::SolverConverged), None))
    }
}
