//! The default method: log κ and log μ of every cell, from coarse to fine, λ from the images.

use super::accuracy::Accuracy;
use super::homogeneous::{self, Start};
use super::lbfgs::{Minimiser, Point, Shifts};
use super::levels::levels;
use super::objective::{Device, Misfit, Objective, Problem, RANGE};
use super::{
    Inverse, InverseError, InverseSettings, Iterate, Lambda, Observer, Progress, Stage, Work,
};
use crate::resample::interpolate;
use material::Grid;

/// λ is tried from here down: at 0.1 nothing but a nearly homogeneous block pays, at 1e-9 the
/// smoothness of any volume that fits is worth less than single precision.
const LAMBDA_FIRST: f64 = 0.1;
const LAMBDA_LAST: f64 = 1e-9;
/// Above this one it falls without being judged: a block that is held nearly homogeneous explains little,
/// and one that is held a little less may not yet explain more.
const LAMBDA_JUDGED: f64 = 1e-3;
/// A smaller λ has to explain the kept-out pixels better by this share of their χ²/N, or of the second
/// number where that is larger: the mean of a few thousand squares scatters by as much; and far
/// below their noise, which the model error is part of, neighbouring pixels are off by the same, and
/// what explains those that are fitted explains those that are not, right or wrong.
const WORTHWHILE: f64 = 0.02;
const CREDIBLE: f64 = 0.2;
/// λ falls by the first factor; by the second as long as that share is above the third.
const FACTOR: f64 = 0.5;
const FAR_FACTOR: f64 = 0.25;
const FAR: f64 = 0.2;
/// The next finer grid begins with λ this much larger: a coarse grid's own error, which is the same in neighbouring
/// pixels, is explained by small λ, and cross-validation takes that for a gain.
const LIFT: f64 = 4.0;
/// A descent ends when the objective has fallen by less than this share in this many steps: far from the right
/// λ; where λ is judged (what an unconverged descent gains by going on would be
/// put down to the smaller λ); and at the chosen λ.
const FAR_OFF: (f64, usize) = (0.1, 1);
const SEARCHING: (f64, usize) = (0.02, 4);
const FINAL: (f64, usize) = (2e-3, 4);
/// With fewer gradients than this, two for the curvature along shifts are not well spent.
const LEAST_FOR_SHIFTS: usize = 8;

/// Finds κ and μ.
///
/// λ is cross-validated (Wahba, Spline models for observational data, 1990, section 4.2; with one pixel in ten
/// kept out, not every one in turn): it falls until the pixels that the fit does not see are not explained any
/// better. The residual of the pixels that are fitted would
/// not do: a volume has nearly as many unknowns as there are pixels, and explains half of their noise
/// where the material is best.
pub(super) fn run<D: Device>(
    device: &mut D,
    problem: &Problem,
    settings: &InverseSettings,
    from: Option<Iterate>,
    observer: Observer<'_>,
) -> Result<Inverse, InverseError> {
    let levels = levels(problem, settings.model_error);
    let coarsest = levels.len() - 1;
    let mut run = Run { settings, observer, finest: problem.grid, at: Iterate::default() };
    run.at = match from {
        Some(iterate) if iterate.fits(&levels) => iterate,
        _ => run.begin(device, &levels[coarsest], coarsest)?,
    };
    let mut shifts = None;
    loop {
        let problem = &levels[run.at.level];
        let found = run.descend_on(device, problem, &mut shifts)?;
        if let Some(found) = found {
            return Ok(found);
        }
        let (from, level) = (problem.grid, run.at.level - 1);
        let to = levels[level].grid;
        let halves = run.at.logs.chunks_exact(from.len());
        run.at.logs = halves.flat_map(|logs| interpolate(&from, &to, logs)).collect();
        run.at.level = level;
    }
}

/// A descent from coarse to fine, and who is told of it.
struct Run<'r, 'o> {
    settings: &'r InverseSettings,
    observer: Observer<'o>,
    finest: Grid,
    /// Where it stands; while an objective is at work, where it stood before.
    at: Iterate,
}

impl Run<'_, '_> {
    /// The homogeneous start.
    fn begin<D: Device>(
        &mut self,
        device: &mut D,
        problem: &Problem,
        level: usize,
    ) -> Result<Iterate, InverseError> {
        let mut objective = device.objective(problem)?;
        let (n, tolerance) = (problem.grid.len(), self.settings.tolerance);
        let share = n as f64 / self.finest.len() as f64;
        let Start { kappa_mm, mu_per_mm } = homogeneous::fit(&problem.grid, |kappa, mu| {
            let misfit =
                objective.forward(&objective.vector(homogeneous::logs(n, kappa, mu)), tolerance)?;
            let work = Work::default().with(objective.work(), share);
            let progress = Progress::homogeneous(problem, work, &misfit);
            if (self.observer)(&progress) { Ok(misfit) } else { Err(InverseError::Interrupted) }
        })?;
        let (lambda, chosen) = match self.settings.lambda {
            Lambda::Fixed(lambda) => (lambda, true),
            Lambda::CrossValidation => (LAMBDA_FIRST, false),
        };
        Ok(Iterate {
            level,
            logs: homogeneous::logs(n, kappa_mm, mu_per_mm),
            lambda,
            chosen,
            homogeneous: (kappa_mm, mu_per_mm),
            work: Work::default().with(objective.work(), share),
            history: Vec::new(),
        })
    }

    /// Goes on on one grid: while λ is looked for without the pixels that it is tried on, then with all of
    /// them. The answer, if this is the finest grid.
    fn descend_on<D: Device>(
        &mut self,
        device: &mut D,
        problem: &Problem,
        shifts: &mut Option<Shifts>,
    ) -> Result<Option<Inverse>, InverseError> {
        let finest = self.at.level == 0;
        let mut left = self.settings.max_evaluations;
        // The last descent needs one evaluation at least.
        if !self.at.chosen && left > 1 {
            let measurement = problem.measurement.with_pixels_kept_out(&problem.grid);
            let tried = Problem { measurement, ..problem.clone() };
            let before = self.at.work.gradient_evaluations;
            self.descend(device, &tried, shifts, left - 1)?;
            let spent = self.at.work.gradient_evaluations - before;
            left = left.saturating_sub(spent).max(1);
            if !finest {
                return Ok(None);
            }
        }
        self.at.chosen = true;
        let (misfit, converged) = self.descend(device, problem, shifts, left)?;
        if !finest {
            return Ok(None);
        }
        let n = problem.grid.len();
        let centre = self.centre();
        let value = |i: usize| {
            let c = centre[i / n];
            self.at.logs[i].clamp(c - RANGE, c + RANGE).exp()
        };
        Ok(Some(Inverse {
            kappa_mm: (0..n).map(value).collect(),
            mu_per_mm: (n..2 * n).map(value).collect(),
            homogeneous: self.at.homogeneous,
            gain: misfit.gain,
            fit: misfit.fit,
            chi2: problem.chi2(&misfit),
            lambda: self.at.lambda,
            converged,
            work: self.at.work,
            history: self.at.history.clone(),
        }))
    }

    /// Descends on one grid with at most `limit` gradients, and looks for λ meanwhile if that is not chosen
    /// yet. Gives the misfit, and whether it converged.
    fn descend<D: Device>(
        &mut self,
        device: &mut D,
        problem: &Problem,
        shifts: &mut Option<Shifts>,
        limit: usize,
    ) -> Result<(Misfit, bool), InverseError> {
        let mut objective = device.objective(problem)?;
        objective.centre(self.centre());
        let u = objective.vector(self.at.logs.clone());
        let accuracy = Accuracy::new(self.settings.tolerance);
        let mut minimiser = Minimiser::new(&mut objective, problem.measurement.weighted_energy());
        let here = minimiser.point(u, &accuracy)?;
        self.tell(&minimiser, &here, problem)?;
        if shifts.is_none() && limit >= LEAST_FOR_SHIFTS {
            *shifts = Some(minimiser.shifts(&here.u, &accuracy)?);
        }
        minimiser.know(shifts.as_ref());
        let (u, found, converged) = if self.at.chosen {
            let (here, converged) = self.down(&mut minimiser, problem, here, limit, FINAL)?;
            (here.u, here.misfit, converged)
        } else {
            self.search(&mut minimiser, problem, here, limit)?
        };
        if self.at.level > 0 && limit >= LEAST_FOR_SHIFTS {
            *shifts = Some(minimiser.shifts(&u, &accuracy)?);
        }
        if !self.at.chosen && self.at.level > 0 {
            self.at.lambda *= LIFT;
        }
        let misfit = if self.at.chosen {
            // This one is told.
            minimiser.objective.forward(&u, accuracy.exact())?
        } else {
            found
        };
        self.at.logs = minimiser.objective.host(&u)?;
        self.at.work = self.work(&minimiser, problem);
        Ok((misfit, converged))
    }

    /// Lowers λ as long as that pays. Gives u and its misfit at the best one, and whether it converged.
    fn search<O: Objective>(
        &mut self,
        minimiser: &mut Minimiser<'_, O>,
        problem: &Problem,
        mut here: Point<O::Vector>,
        limit: usize,
    ) -> Result<(O::Vector, Misfit, bool), InverseError> {
        let count = problem.measurement.kept_out().max(1) as f64;
        // u, misfit and λ before it fell.
        let mut before: Option<(O::Vector, Misfit, f64)> = None;
        // Whether the kept-out pixels are explained better by a share than then.
        let better = |here: &Point<O::Vector>, before: &Misfit, share: f64| {
            let [was, is] = [before, &here.misfit].map(|misfit| misfit.kept_out / count);
            was - is > share * was.max(CREDIBLE)
        };
        loop {
            let mut converged;
            (here, converged) = self.down(minimiser, problem, here, limit, FAR_OFF)?;
            let far = |here: &Point<O::Vector>, before: &Option<(O::Vector, Misfit, f64)>| {
                before.as_ref().is_some_and(|(_, misfit, _)| better(here, misfit, FAR))
            };
            if self.at.lambda < LAMBDA_JUDGED && !far(&here, &before) {
                (here, converged) = self.down(minimiser, problem, here, limit, SEARCHING)?;
                let stop = before.take_if(|(_, misfit, _)| !better(&here, misfit, WORTHWHILE));
                if let Some((u, misfit, lambda)) = stop {
                    self.at.lambda = lambda;
                    return Ok((u, misfit, converged));
                }
            }
            let judged = self.at.lambda < LAMBDA_JUDGED;
            let factor = if judged && !far(&here, &before) { FACTOR } else { FAR_FACTOR };
            if !converged || self.at.lambda * factor < LAMBDA_LAST {
                return Ok((here.u, here.misfit, converged));
            }
            before = Some((here.u.clone(), here.misfit, self.at.lambda));
            self.at.lambda *= factor;
        }
    }

    /// Descends at one λ until little is gained, or `limit` gradients are evaluated.
    fn down<O: Objective>(
        &mut self,
        minimiser: &mut Minimiser<'_, O>,
        problem: &Problem,
        mut here: Point<O::Vector>,
        limit: usize,
        (least, steps): (f64, usize),
    ) -> Result<(Point<O::Vector>, bool), InverseError> {
        let lambda = self.at.lambda * self.roughness_scale(problem);
        let accuracy = Accuracy::new(self.settings.tolerance);
        let mut recent = vec![here.value(lambda)];
        loop {
            let k = recent.len();
            if k > steps && recent[k - 1] > (1.0 - least) * recent[k - 1 - steps] {
                return Ok((here, true));
            }
            if minimiser.objective.work().gradient_evaluations >= limit {
                return Ok((here, false));
            }
            match minimiser.step(&here, lambda, &accuracy)? {
                Some(next) => here = next,
                // Converged to rounding.
                None => return Ok((here, true)),
            }
            self.tell(minimiser, &here, problem)?;
            recent.push(here.value(lambda));
        }
    }

    /// What the roughness of a volume on the finest grid comes to there over what it comes to here.
    fn roughness_scale(&self, problem: &Problem) -> f64 {
        (problem.grid.cell_volume_mm3() / self.finest.cell_volume_mm3()).cbrt()
    }

    /// Logarithms of the homogeneous start.
    fn centre(&self) -> [f64; 2] {
        let (kappa, mu) = self.at.homogeneous;
        [kappa.ln(), mu.ln()]
    }

    /// All that has been done.
    fn work<O: Objective>(&self, minimiser: &Minimiser<'_, O>, problem: &Problem) -> Work {
        let share = problem.grid.len() as f64 / self.finest.len() as f64;
        self.at.work.with(minimiser.objective.work(), share)
    }

    fn tell<O: Objective>(
        &mut self,
        minimiser: &Minimiser<'_, O>,
        here: &Point<O::Vector>,
        problem: &Problem,
    ) -> Result<(), InverseError> {
        self.at.history.push(here.misfit.fit);
        let work = self.work(minimiser, problem);
        let iterate = || {
            let logs = minimiser.objective.host(&here.u).ok()?;
            Some(Iterate { logs, work, history: self.at.history.clone(), ..self.at })
        };
        let progress = Progress {
            stage: Stage::Volume,
            work,
            objective: here.value(self.at.lambda * self.roughness_scale(problem)),
            fit: here.misfit.fit,
            chi2: problem.chi2(&here.misfit),
            lambda: self.at.lambda,
            cells: problem.grid.cells(),
            iterate: Some(&iterate),
        };
        if (self.observer)(&progress) { Ok(()) } else { Err(InverseError::Interrupted) }
    }
}
