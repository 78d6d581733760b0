//! What an inverse solve costs, counted.

use crate::SolveReport;
use serde::{Deserialize, Serialize};

/// Solves and what they took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// Gradient evaluations.
    pub gradient_evaluations: usize,
    /// Fields solved for, forward and adjoint, on any grid, exactly or not.
    pub linear_solves: usize,
    /// The same in solves on the finest grid: a field on a grid of N cells counts N / N_finest.
    pub fine_solves: f64,
    /// Preconditioned iterations, summed over fields and weighted like `fine_solves`.
    pub fine_iterations: f64,
}

impl Work {
    /// `fields` fields solved on the finest grid.
    pub(crate) fn add_solve(&mut self, fields: usize, report: &SolveReport) {
        self.linear_solves += fields;
        self.fine_solves += fields as f64;
        self.fine_iterations += (fields * report.iterations) as f64;
    }

    /// Adds what was done on a grid whose cells are `share` times those of the finest in number.
    pub(crate) fn with(self, other: Self, share: f64) -> Self {
        Self {
            gradient_evaluations: self.gradient_evaluations + other.gradient_evaluations,
            linear_solves: self.linear_solves + other.linear_solves,
            fine_solves: self.fine_solves + share * other.fine_solves,
            fine_iterations: self.fine_iterations + share * other.fine_iterations,
        }
    }
}
