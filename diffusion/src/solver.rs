//! The one trait that every backend implements.

use crate::{Batch, GpuError, Operator};

/// Solves A x = b for all fields of a batch. Implemented by the CPU and by GPU backends.
pub trait LinearSolver {
    /// Takes the operator over (builds the grid hierarchy, uploads coefficients).
    ///
    /// # Errors
    /// The backend cannot hold the operator.
    fn prepare(&mut self, operator: Operator) -> Result<(), SolveError>;

    /// Solves for every field of `b`, starting from what `x` holds.
    ///
    /// On success ‖b − A x‖ ≤ `tolerance` · ‖b‖ holds for each field, evaluated in double
    /// precision. A field with b = 0 gets x = 0.
    ///
    /// # Errors
    /// The tolerance is not reached, or a value is not finite.
    fn solve(
        &mut self,
        b: &Batch,
        x: &mut Batch,
        tolerance: f64,
    ) -> Result<SolveReport, SolveError>;

    /// The prepared operator.
    fn operator(&self) -> Option<&Operator>;
}

impl<S: LinearSolver + ?Sized> LinearSolver for Box<S> {
    fn prepare(&mut self, operator: Operator) -> Result<(), SolveError> {
        (**self).prepare(operator)
    }

    fn solve(
        &mut self,
        b: &Batch,
        x: &mut Batch,
        tolerance: f64,
    ) -> Result<SolveReport, SolveError> {
        (**self).solve(b, x, tolerance)
    }

    fn operator(&self) -> Option<&Operator> {
        (**self).operator()
    }
}

/// What a solve took.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SolveReport {
    /// Preconditioned iterations, the most that any block of fields took.
    pub iterations: usize,
    /// Largest true relative residual over the fields.
    pub relative_residual: f64,
    /// Fields solved.
    pub right_hand_sides: usize,
}

/// Why a solve has no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SolveError {
    /// `solve` was called before `prepare`.
    #[error("the solver has no operator yet")]
    NotPrepared,
    /// The batch does not belong to the prepared grid.
    #[error("the right-hand side has {found} cells, the operator has {expected}")]
    WrongSize {
        /// Unknowns of the operator.
        expected: usize,
        /// Cells of the batch.
        found: usize,
    },
    /// A right-hand side holds NaN or infinity.
    #[error("right-hand side {field} is not finite")]
    NotFinite {
        /// Number of the field.
        field: usize,
    },
    /// The GPU cannot, or no longer can.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The residual no longer falls.
    #[error(
        "the solve stalled at a relative residual of {reached:.2e} after {iterations} iterations, \
         {wanted:.1e} was asked for; history {}",
        render(history)
    )]
    Stalled {
        /// Tolerance asked for.
        wanted: f64,
        /// Largest true relative residual reached.
        reached: f64,
        /// Iterations spent.
        iterations: usize,
        /// Largest relative residual after every iteration.
        history: Vec<f64>,
    },
}

fn render(history: &[f64]) -> String {
    let numbers: Vec<String> = history.iter().map(|r| format!("{r:.1e}")).collect();
    numbers.join(" ")
}
