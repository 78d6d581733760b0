//! How well the views determine what was solved.

use super::solve::scaled_cholesky;
use super::terms::{self, Normal};
use super::{KINDS, Problem, State};
use crate::error::{CalibrationError, Result};
use nalgebra::{Cholesky, DMatrix, Matrix6};
use rayon::prelude::*;

/// Covariance of the unknowns and the noise that it follows from.
pub(crate) struct Uncertainty {
    /// Of the globals, in their order.
    pub globals: DMatrix<f64>,
    /// Of each view's pose: turn (radians, in the camera's frame) and shift (mm).
    pub poses: Vec<Matrix6<f64>>,
    /// 1-sigma of one coordinate of each kind of residual, pixels; as given where there is none.
    pub sigma: [f64; KINDS],
}

/// Covariance at a solution, from the residuals' own scatter.
///
/// The noise of each kind is its sum of squares over its redundancy, the number of its residuals
/// less its share of the unknowns, tr(C JᵀWJ) (Förstner 1979, Koch 1999): two rounds settle it to
/// a thousandth.
///
/// # Errors
/// Unknowns that the views leave undetermined.
pub(crate) fn uncertainty(
    what: &'static str,
    problem: &Problem<'_>,
    state: &State,
) -> Result<Uncertainty> {
    let undetermined = || CalibrationError::NotConverged {
        what,
        reason: "the views leave some of its parameters undetermined".into(),
    };
    let mut problem = *problem;
    let mut out = None;
    for _ in 0..3 {
        let parts: Vec<[Normal; KINDS]> = (0..problem.views.len())
            .into_par_iter()
            .map(|view| terms::normal(&problem, state, view, true))
            .collect();
        let inverse = invert(&parts, problem.free.len()).ok_or_else(undetermined)?;
        let mut squares = [0.0; KINDS];
        let mut counts = [0.0; KINDS];
        for view in 0..problem.views.len() {
            for r in terms::residuals(&problem, state, view).ok_or_else(undetermined)? {
                squares[r.sight as usize] += r.px[0].powi(2) + r.px[1].powi(2);
                counts[r.sight as usize] += 2.0;
            }
        }
        for kind in 0..KINDS {
            let used = inverse.share(&parts, kind);
            let redundancy = counts[kind] - used;
            // Too few residuals of a kind say nothing about their noise.
            if redundancy > 0.5 {
                problem.sigma[kind] = (squares[kind] / redundancy).sqrt().max(1e-12);
            }
        }
        let Inverse { globals, poses, .. } = inverse;
        out = Some((globals, poses));
    }
    let (globals, poses) = out.ok_or_else(undetermined)?;
    Ok(Uncertainty { globals, poses, sigma: problem.sigma })
}

/// Blocks of the inverse of the normal matrix.
struct Inverse {
    globals: DMatrix<f64>,
    /// Pose by globals.
    mixed: Vec<DMatrix<f64>>,
    poses: Vec<Matrix6<f64>>,
}

fn invert(parts: &[[Normal; KINDS]], n: usize) -> Option<Inverse> {
    let mut system = DMatrix::zeros(n, n);
    let mut kept = Vec::with_capacity(parts.len());
    for kinds in parts {
        let pose = Cholesky::new(kinds.iter().map(|k| k.pose).sum::<Matrix6<f64>>())?;
        let mut mixed = DMatrix::zeros(6, n);
        for kind in kinds {
            system += &kind.globals;
            mixed += &kind.mixed;
        }
        let carried = pose.solve(&mixed);
        system.gemm_tr(-1.0, &mixed, &carried, 1.0);
        kept.push((pose.inverse(), carried));
    }
    for i in 0..n {
        for j in 0..i {
            system[(j, i)] = system[(i, j)];
        }
    }
    let globals = scaled_cholesky(system)?.inverse();
    let mixed: Vec<_> = kept.iter().map(|(_, carried)| -(carried * &globals)).collect();
    let poses = kept.iter().zip(&mixed).map(|((alone, carried), m)| {
        let through = m * carried.transpose();
        alone - Matrix6::from_fn(|i, j| through[(i, j)])
    });
    let poses = poses.collect();
    Some(Inverse { globals, mixed, poses })
}

impl Inverse {
    /// tr(C JᵀWJ) over the residuals of one kind: how many unknowns they pay for.
    fn share(&self, parts: &[[Normal; KINDS]], kind: usize) -> f64 {
        let n = self.globals.nrows();
        let mut sum = 0.0;
        for ((kinds, mixed), pose) in parts.iter().zip(&self.mixed).zip(&self.poses) {
            let part = &kinds[kind];
            sum += pose.component_mul(&part.pose).sum() + 2.0 * mixed.dot(&part.mixed);
            for i in 0..n {
                sum += self.globals[(i, i)] * part.globals[(i, i)];
                for j in i + 1..n {
                    sum += 2.0 * self.globals[(j, i)] * part.globals[(j, i)];
                }
            }
        }
        sum
    }
}
