//! How far the images of a medium are from the measured ones, and the gradient of that.

use super::measurement::Measurement;
use crate::{Batch, Forward, LinearSolver, Medium, SolveError};
use material::{Face, Grid, Optics};

/// Evaluates the data term of one channel; keeps the last fluence and adjoint fluence as
/// starting values and counts what it does.
pub(crate) struct DataTerm<'a, S> {
    pub grid: Grid,
    pub measurement: &'a Measurement,
    optics: Optics,
    solver: &'a mut S,
    free_gain: bool,
    tolerance: f64,
    fluence: Batch,
    adjoint: Batch,
    pub linear_solves: usize,
    pub gradient_evaluations: usize,
}

/// The data term at one point.
#[derive(Clone, Debug)]
pub(crate) struct Misfit {
    /// Σ w (γ L − L_meas)².
    pub weighted: f64,
    /// Σ (γ L − L_meas)² / Σ L_meas² over pixels that are not masked (design: fit f).
    pub fit: f64,
    /// γ: 1, or the gain that minimises the data term.
    pub gain: f64,
    /// ∂(weighted)/∂κ and ∂(weighted)/∂μ; empty when no gradient was asked for.
    pub by_kappa: Vec<f64>,
    pub by_mu: Vec<f64>,
}

impl<'a, S: LinearSolver> DataTerm<'a, S> {
    pub fn new(
        grid: Grid,
        optics: Optics,
        measurement: &'a Measurement,
        free_gain: bool,
        tolerance: f64,
        solver: &'a mut S,
    ) -> Self {
        let field = || Batch::zeros(grid.len(), measurement.light().count());
        let (fluence, adjoint) = (field(), field());
        Self {
            grid,
            measurement,
            optics,
            solver,
            free_gain,
            tolerance,
            fluence,
            adjoint,
            linear_solves: 0,
            gradient_evaluations: 0,
        }
    }

    pub fn evaluate(&mut self, medium: Medium, gradient: bool) -> Result<Misfit, SolveError> {
        let light = self.measurement.light();
        let mut forward = Forward::new(medium, &self.optics, &mut *self.solver)?;
        forward.solve(light, &mut self.fluence, self.tolerance)?;
        self.linear_solves += light.count();
        let images = forward.exit_radiance(light, &self.fluence, Face::Front);

        let weights = self.measurement.weight();
        let measured = self.measurement.radiance();
        let pixels = || {
            images.iter().zip(measured).zip(weights).flat_map(|((image, meas), w)| {
                image
                    .iter()
                    .zip(meas)
                    .zip(w)
                    .filter(|(_, w)| **w > 0.0)
                    .map(|((l, m), w)| (*l, *m, *w))
            })
        };
        let gain = if self.free_gain {
            let (cross, own) =
                pixels().fold((0.0, 0.0), |(c, o), (l, m, w)| (c + w * l * m, o + w * l * l));
            if own > 0.0 { cross / own } else { 1.0 }
        } else {
            1.0
        };
        let (weighted, plain) = pixels().fold((0.0, 0.0), |(a, b), (l, m, w)| {
            let r = gain * l - m;
            (a + w * r * r, b + r * r)
        });
        let fit = plain / self.measurement.energy();
        let mut out = Misfit { weighted, fit, gain, by_kappa: Vec::new(), by_mu: Vec::new() };
        if gradient {
            // With the best gain, ∂/∂γ of the data term is 0: the chain through γ drops out.
            let slope: Vec<Vec<f64>> = images
                .iter()
                .zip(measured)
                .zip(weights)
                .map(|((image, meas), w)| {
                    let pixel = |((l, m), w): ((&f64, &f64), &f64)| {
                        if *w > 0.0 { 2.0 * w * gain * (gain * l - m) } else { 0.0 }
                    };
                    image.iter().zip(meas).zip(w).map(pixel).collect()
                })
                .collect();
            let (g, _) = forward.gradient(
                light,
                &self.fluence,
                &slope,
                &mut self.adjoint,
                self.tolerance,
            )?;
            self.linear_solves += light.count();
            self.gradient_evaluations += 1;
            (out.by_kappa, out.by_mu) = (g.by_kappa, g.by_mu);
        }
        Ok(out)
    }
}
