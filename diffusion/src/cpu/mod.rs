//! The CPU backend: multigrid-preconditioned conjugate gradients, matrix-free, all fields of a
//! block in one pass, in single or double precision with a residual checked in double.

mod level;
mod multigrid;
mod pcg;
pub(crate) mod real;
pub(crate) mod sweep;

pub use real::Real;

use crate::{Batch, LinearSolver, Operator, SolveError, SolveReport};
use level::Hierarchy;
use pcg::{Krylov, Solution};
use rayon::prelude::*;
use sweep::{Row, RowKernel, rows};

/// Restarts after which a solve that is still short of its tolerance is called stalled.
const MAX_RESTARTS: usize = 12;
/// Iterations between restarts.
const MAX_ITERATIONS: usize = 200;

/// Solves on the CPU. `T` is the precision of the iteration and its preconditioner; the
/// solution and the residual that decides are double whatever `T`, by iterative refinement.
///
/// Work space is kept from one solve to the next: an inverse solve asks hundreds of times.
pub struct CpuSolver<T> {
    prepared: Option<(Operator, Hierarchy<T>)>,
    few: Option<Krylov<T, 4>>,
    many: Option<Krylov<T, 16>>,
}

impl<T: Real> CpuSolver<T> {
    /// A solver without an operator yet.
    pub fn new() -> Self {
        Self { prepared: None, few: None, many: None }
    }
}

impl<T: Real> Default for CpuSolver<T> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real> LinearSolver for CpuSolver<T> {
    fn prepare(&mut self, operator: Operator) -> Result<(), SolveError> {
        let hierarchy = rayon::scope(|_| Hierarchy::new(&operator));
        self.few.take_if(|space| !space.fits(&hierarchy));
        self.many.take_if(|space| !space.fits(&hierarchy));
        self.prepared = Some((operator, hierarchy));
        Ok(())
    }

    fn solve(
        &mut self,
        b: &Batch,
        x: &mut Batch,
        tolerance: f64,
    ) -> Result<SolveReport, SolveError> {
        let (operator, hierarchy) = self.prepared.as_ref().ok_or(SolveError::NotPrepared)?;
        for found in [b.cells(), x.cells()] {
            if found != operator.len() {
                return Err(SolveError::WrongSize { expected: operator.len(), found });
            }
        }
        // The whole solve runs on a thread of the pool: from outside of it every one of its
        // passes would put this thread to sleep and wake another.
        if b.lanes() == 16 {
            let krylov = self.many.get_or_insert_with(|| Krylov::new(hierarchy));
            rayon::scope(|_| solve_batch(operator, hierarchy, krylov, b, x, tolerance))
        } else {
            let krylov = self.few.get_or_insert_with(|| Krylov::new(hierarchy));
            rayon::scope(|_| solve_batch(operator, hierarchy, krylov, b, x, tolerance))
        }
    }

    fn operator(&self) -> Option<&Operator> {
        self.prepared.as_ref().map(|(operator, _)| operator)
    }
}

fn solve_batch<T: Real, const L: usize>(
    operator: &Operator,
    hierarchy: &Hierarchy<T>,
    krylov: &mut Krylov<T, L>,
    b: &Batch,
    x: &mut Batch,
    tolerance: f64,
) -> Result<SolveReport, SolveError> {
    let mut report = SolveReport { right_hand_sides: b.count(), ..SolveReport::default() };
    let blank = x.is_blank();
    for block in 0..b.blocks() {
        let first_field = block * L;
        let b = b.block(block).as_chunks().0;
        let solution = Solution { x: x.block_mut(block).as_chunks_mut().0, blank };
        let (iterations, residual) =
            solve_block(operator, hierarchy, krylov, b, solution, tolerance).map_err(|error| {
                match error {
                    SolveError::NotFinite { field } => {
                        SolveError::NotFinite { field: first_field + field }
                    }
                    other => other,
                }
            })?;
        report.iterations = report.iterations.max(iterations);
        report.relative_residual = report.relative_residual.max(residual);
    }
    Ok(report)
}

/// Iterative refinement: residual in double, correction in `T`, until the residual is there.
fn solve_block<T: Real, const L: usize>(
    operator: &Operator,
    hierarchy: &Hierarchy<T>,
    krylov: &mut Krylov<T, L>,
    b: &[[f64; L]],
    mut solution: Solution<'_, L>,
    tolerance: f64,
) -> Result<(usize, f64), SolveError> {
    // From x = 0 the residual is b, and the pass that rounds it measures it too.
    let b_norm = if solution.blank {
        rows(operator.cells(), &mut krylov.r, &Round { cells: operator.cells(), b }).map(f64::sqrt)
    } else {
        norms(b)
    };
    if let Some(field) = b_norm.iter().position(|n| !n.is_finite()) {
        return Err(SolveError::NotFinite { field });
    }
    let mut r_norm = b_norm;
    if !solution.blank {
        let x_norm = norms(solution.x);
        for lane in 0..L {
            if x_norm[lane] != 0.0 && (b_norm[lane] == 0.0 || !x_norm[lane].is_finite()) {
                solution.x.iter_mut().for_each(|v| v[lane] = 0.0);
            }
        }
        r_norm = operator.residual_into(b, solution.x, &mut krylov.r);
    }
    let mut history = Vec::new();
    let mut iterations = 0;
    let mut previous = f64::INFINITY;
    for _ in 0..MAX_RESTARTS {
        let relative =
            (0..L).filter(|&l| b_norm[l] > 0.0).map(|l| r_norm[l] / b_norm[l]).fold(0.0, f64::max);
        if relative <= tolerance {
            return Ok((iterations, relative));
        }
        if !relative.is_finite() || relative > 0.5 * previous {
            break;
        }
        previous = relative;
        // A lane that is there already keeps its solution; the others aim a little below the
        // tolerance, so that rounding in the update does not cost another restart.
        let scale: [f64; L] =
            std::array::from_fn(
                |l| {
                    if r_norm[l] > tolerance * b_norm[l] { b_norm[l] } else { 0.0 }
                },
            );
        let target: [f64; L] = std::array::from_fn(|l| {
            (0.7 * tolerance * b_norm[l]).max(T::RESIDUAL_FLOOR * r_norm[l])
        });
        iterations +=
            krylov.run(hierarchy, &scale, &target, MAX_ITERATIONS, &mut solution, &mut history);
        r_norm = operator.residual_into(b, solution.x, &mut krylov.r);
    }
    Err(SolveError::Stalled { wanted: tolerance, reached: previous, iterations, history })
}

/// out = b, rounded; the dot is b · b.
struct Round<'a, const L: usize> {
    cells: [usize; 3],
    b: &'a [[f64; L]],
}

impl<T: Real, const L: usize> RowKernel<T, L> for Round<'_, L> {
    type Sum = f64;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [[T; L]], dot: &mut [f64; L]) {
        for (out, b) in out.iter_mut().zip(Row::new(self.cells, y, z).of(self.b)) {
            for l in 0..L {
                out[l] = T::from_f64(b[l]);
                dot[l] += b[l] * b[l];
            }
        }
    }
}

fn norms<const L: usize>(values: &[[f64; L]]) -> [f64; L] {
    let squares = |piece: &[[f64; L]]| {
        let mut sum = [0.0; L];
        for v in piece {
            for l in 0..L {
                sum[l] += v[l] * v[l];
            }
        }
        sum
    };
    // Pieces of fixed size, added up in order: the same bits whatever the number of threads.
    let parts: Vec<[f64; L]> = values.par_chunks(1 << 12).map(squares).collect();
    let mut total = [0.0; L];
    for part in parts {
        for l in 0..L {
            total[l] += part[l];
        }
    }
    total.map(f64::sqrt)
}

/// One V-cycle on a block of 16 fields, for whoever has another to compare with it.
#[cfg(test)]
pub(crate) fn v_cycle(operator: &Operator, r: &[[f32; 16]]) -> Vec<[f32; 16]> {
    let hierarchy = Hierarchy::new(operator);
    let mut cycle = multigrid::VCycle::new(&hierarchy);
    cycle.apply(&hierarchy, r);
    cycle.answer().to_vec()
}
