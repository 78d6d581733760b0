//! How far the images of a medium are from the measured ones, and the gradient of that, by any
//! linear solver.

use super::objective::{Device, Misfit, Objective, Problem, RANGE};
use super::smoothness::{OF_MU, roughness, squared_distance};
use super::{InverseError, Work};
use crate::{Batch, Forward, Gradient, LinearSolver, Medium, Operator, SolveError, SurfaceModel};
use material::{Face, Grid};

/// Evaluates the data term of one channel; keeps the last fluence and adjoint fluence as
/// starting values and counts what it does.
pub(crate) struct DataTerm<'a, S> {
    problem: &'a Problem,
    surface: SurfaceModel,
    solver: &'a mut S,
    fluence: Batch,
    adjoint: Batch,
    last: Option<Last>,
    pub work: Work,
}

/// The point that was solved for last.
struct Last {
    medium: Medium,
    images: Vec<Vec<f64>>,
    gain: f64,
}

impl<'a, S: LinearSolver> DataTerm<'a, S> {
    pub fn new(problem: &'a Problem, solver: &'a mut S) -> Self {
        let field = || Batch::zeros(problem.grid.len(), problem.measurement.light().count());
        let (fluence, adjoint) = (field(), field());
        let surface = SurfaceModel::new(&problem.optics);
        let work = Work::default();
        Self { problem, surface, solver, fluence, adjoint, last: None, work }
    }

    pub fn grid(&self) -> &'a Grid {
        &self.problem.grid
    }

    /// The images of a medium against the measured ones.
    pub fn forward(&mut self, medium: Medium, tolerance: f64) -> Result<Misfit, SolveError> {
        let Problem { optics, measurement, free_gain, .. } = self.problem;
        let light = measurement.light();
        self.solver.prepare(Operator::new(&medium, optics))?;
        let mut forward = Forward::prepared(medium, optics, self.surface, &mut *self.solver);
        let report = forward.solve(light, &mut self.fluence, tolerance)?;
        self.work.add_solve(light.count(), &report);
        let images = forward.exit_radiance(light, &self.fluence, Face::Front);
        let medium = forward.into_medium();

        let weights = measurement.weight();
        let measured = measurement.radiance();
        let all = || {
            images.iter().zip(measured).zip(weights).flat_map(|((image, meas), w)| {
                // A masked pixel may hold anything.
                image
                    .iter()
                    .zip(meas)
                    .zip(w)
                    .filter(|(_, w)| **w != 0.0)
                    .map(|((l, m), w)| (*l, *m, *w))
            })
        };
        let gain = if *free_gain {
            let (cross, own) = all()
                .filter(|(_, _, w)| *w > 0.0)
                .fold((0.0, 0.0), |(c, o), (l, m, w)| (c + w * l * m, o + w * l * l));
            if own > 0.0 { cross / own } else { 1.0 }
        } else {
            1.0
        };
        let (mut weighted, mut kept_out, mut plain) = (0.0, 0.0, 0.0);
        for (l, m, w) in all() {
            let r = gain * l - m;
            if w > 0.0 {
                weighted += w * r * r;
                plain += r * r;
            } else {
                kept_out -= w * r * r;
            }
        }
        self.last = Some(Last { medium, images, gain });
        Ok(Misfit { weighted, kept_out, fit: plain / measurement.energy(), gain })
    }

    /// ∂(weighted)/∂κ and ∂(weighted)/∂μ at the medium of the last [`forward`](Self::forward).
    pub fn gradient(&mut self, tolerance: f64) -> Result<Gradient, SolveError> {
        let Problem { optics, measurement, .. } = self.problem;
        let light = measurement.light();
        let Last { medium, images, gain } = self.last.take().ok_or(SolveError::NotPrepared)?;
        // With the best gain, ∂/∂γ of the data term is 0: the chain through γ drops out.
        let slope: Vec<Vec<f64>> = images
            .iter()
            .zip(measurement.radiance())
            .zip(measurement.weight())
            .map(|((image, meas), w)| {
                let pixel = |((l, m), w): ((&f64, &f64), &f64)| {
                    if *w > 0.0 { 2.0 * w * gain * (gain * l - m) } else { 0.0 }
                };
                image.iter().zip(meas).zip(w).map(pixel).collect()
            })
            .collect();
        let mut forward = Forward::prepared(medium, optics, self.surface, &mut *self.solver);
        let (gradient, report) =
            forward.gradient(light, &self.fluence, &slope, &mut self.adjoint, tolerance)?;
        let medium = forward.into_medium();
        self.last = Some(Last { medium, images, gain });
        self.work.add_solve(light.count(), &report);
        self.work.gradient_evaluations += 1;
        Ok(gradient)
    }
}

/// The data term as a function of the logarithms, and the smoothness beside it.
pub(crate) struct LogObjective<'a, S> {
    data: DataTerm<'a, S>,
    centre: Option<[f64; 2]>,
    /// κ and μ of the last point, and 0 where it lies outside the range.
    last: Vec<f64>,
    energy: f64,
}

impl<S: LinearSolver> Objective for LogObjective<'_, S> {
    type Vector = Vec<f64>;

    fn cells(&self) -> usize {
        self.data.grid().len()
    }

    fn vector(&self, host: Vec<f64>) -> Vec<f64> {
        host
    }

    fn host(&self, u: &Vec<f64>) -> Result<Vec<f64>, InverseError> {
        Ok(u.clone())
    }

    fn centre(&mut self, centre: [f64; 2]) {
        self.centre = Some(centre);
    }

    fn forward(&mut self, u: &Vec<f64>, tolerance: f64) -> Result<Misfit, InverseError> {
        let n = u.len() / 2;
        let limits = |i: usize| {
            self.centre.map_or([f64::MIN, f64::MAX], |c| [c[i / n] - RANGE, c[i / n] + RANGE])
        };
        let values: Vec<f64> = (0..2 * n)
            .map(|i| {
                let [low, high] = limits(i);
                u[i].clamp(low, high).exp()
            })
            .collect();
        let medium = Medium::new(*self.data.grid(), values[..n].to_vec(), values[n..].to_vec())
            .map_err(|e| InverseError::Optimiser(e.to_string()))?;
        self.last = values;
        for i in 0..2 * n {
            let [low, high] = limits(i);
            if u[i] < low || u[i] > high {
                self.last[i] = 0.0;
            }
        }
        Ok(self.data.forward(medium, tolerance)?)
    }

    fn gradient(&mut self, tolerance: f64) -> Result<Vec<f64>, InverseError> {
        let Gradient { by_kappa, by_mu } = self.data.gradient(tolerance)?;
        let by_value = by_kappa.iter().chain(&by_mu);
        Ok(by_value.zip(&self.last).map(|(g, v)| g * v / self.energy).collect())
    }

    fn smoothness(&mut self, u: &Vec<f64>) -> (f64, Vec<f64>) {
        let n = u.len() / 2;
        let mut gradient = vec![0.0; 2 * n];
        let mut value = 0.0;
        for (half, (u, g)) in u.chunks_exact(n).zip(gradient.chunks_exact_mut(n)).enumerate() {
            let counts = [1.0, OF_MU][half];
            value += counts * roughness(self.data.grid(), u, self.data.problem.edge, counts, g);
            if let Some(centre) = self.centre {
                value += counts * squared_distance(self.data.grid(), u, centre[half], counts, g);
            }
        }
        (value, gradient)
    }

    fn forget(&mut self) {
        self.data.fluence.clear();
        self.data.adjoint.clear();
    }

    fn work(&self) -> Work {
        self.data.work
    }
}

/// Any linear solver evaluates the objective, with the rest on the CPU.
pub(crate) struct WithSolver<'s, S>(pub &'s mut S);

impl<S: LinearSolver> Device for WithSolver<'_, S> {
    type Objective<'a>
        = LogObjective<'a, S>
    where
        Self: 'a;

    fn objective<'a>(
        &'a mut self,
        problem: &'a Problem,
    ) -> Result<LogObjective<'a, S>, InverseError> {
        let energy = problem.measurement.weighted_energy();
        let data = DataTerm::new(problem, &mut *self.0);
        Ok(LogObjective { data, centre: None, last: Vec::new(), energy })
    }
}
