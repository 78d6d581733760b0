//! Levenberg–Marquardt on the reduced system.

use super::terms::{self, Normal};
use super::{Problem, State};
use crate::error::{CalibrationError, Result};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector6};
use rayon::prelude::*;

/// Rounds after which a solve is given up; real ones take 5 to 30.
const MOST_ROUNDS: usize = 300;

/// Minimises the cost from `start` until a step changes it by less than rounding does.
///
/// # Errors
/// A start with a point behind a device, a system that the views leave undetermined, or no
/// arrival in 300 rounds.
pub(crate) fn solve(what: &'static str, problem: &Problem<'_>, start: State) -> Result<State> {
    let failed = |reason: &str| CalibrationError::NotConverged { what, reason: reason.into() };
    let mut state = start;
    let mut cost = total_cost(problem, &state);
    if !cost.is_finite() {
        return Err(failed("a point lies behind the device at the starting values"));
    }
    let (mut damping, mut growth) = (1e-3, 2.0);
    for _ in 0..MOST_ROUNDS {
        let parts = normals(problem, &state);
        loop {
            let step = reduced_step(&parts, problem.free.len(), damping);
            let trial = step.map(|(globals, poses)| {
                let moved = state.moved(problem.free, globals.as_slice(), &poses);
                let lower = total_cost(problem, &moved);
                let promised = promise(&parts, &globals, &poses, damping);
                (moved, lower, promised)
            });
            match trial {
                Some((moved, lower, promised)) if lower <= cost => {
                    let gain = cost - lower;
                    // Nielsen's rule (1999): the better the promise was kept, the bolder.
                    let kept = gain / promised.max(f64::MIN_POSITIVE);
                    let done = promised <= 1e-16 * cost || gain == 0.0;
                    damping *= (1.0 - (2.0 * kept - 1.0).powi(3)).max(1.0 / 3.0);
                    damping = damping.max(1e-15);
                    growth = 2.0;
                    (state, cost) = (moved, lower);
                    if done {
                        return Ok(state);
                    }
                    break;
                }
                // What is left to gain has drowned in rounding.
                Some((_, _, promised)) if promised <= 1e-13 * cost => return Ok(state),
                _ => {
                    damping *= growth;
                    growth *= 2.0;
                    if damping > 1e15 {
                        return Err(failed("the views do not determine it"));
                    }
                }
            }
        }
    }
    Err(failed("still moving after 300 rounds"))
}

pub(super) fn total_cost(problem: &Problem<'_>, state: &State) -> f64 {
    let each: Vec<f64> = (0..problem.views.len())
        .into_par_iter()
        .map(|view| terms::cost(problem, state, view))
        .collect();
    each.iter().sum()
}

fn normals(problem: &Problem<'_>, state: &State) -> Vec<Normal> {
    (0..problem.views.len())
        .into_par_iter()
        .map(|view| {
            let [all, ..] = terms::normal(problem, state, view, false);
            all
        })
        .collect()
}

/// Σ over views, and the Schur complement of the damped pose blocks: S δ = −g.
fn reduced_step(parts: &[Normal], n: usize, damping: f64) -> Option<(DVector<f64>, Vec<[f64; 6]>)> {
    let mut system = DMatrix::zeros(n, n);
    let mut right = DVector::zeros(n);
    let mut kept = Vec::with_capacity(parts.len());
    for part in parts {
        let mut pose = part.pose;
        for i in 0..6 {
            pose[(i, i)] += damping * part.pose[(i, i)];
        }
        let pose = Cholesky::new(pose)?;
        let carried = pose.solve(&part.mixed);
        let alone = pose.solve(&part.pose_right);
        system += &part.globals;
        system.gemm_tr(-1.0, &part.mixed, &carried, 1.0);
        right += &part.globals_right;
        right.gemv_tr(-1.0, &part.mixed, &alone, 1.0);
        kept.push((carried, alone));
    }
    // The parts hold lower triangles of the global blocks; the products are whole.
    let diagonal: Vec<f64> =
        (0..n).map(|i| parts.iter().map(|p| p.globals[(i, i)]).sum()).collect();
    for i in 0..n {
        system[(i, i)] += damping * diagonal[i];
        for j in 0..i {
            system[(j, i)] = system[(i, j)];
        }
    }
    let globals = if n == 0 { right } else { -scaled_cholesky(system)?.solve(&right) };
    let poses = kept
        .iter()
        .map(|(carried, alone)| {
            let step: Vector6<f64> = -(alone + carried * &globals);
            step.into()
        })
        .collect();
    Some((globals, poses))
}

/// What the damped quadratic model says the step gains.
fn promise(parts: &[Normal], globals: &DVector<f64>, poses: &[[f64; 6]], damping: f64) -> f64 {
    // For the damped system H δ = −g with H = JᵀJ + λD: gain = −gᵀδ + λ δᵀDδ, cost being Σ r².
    let mut gain = 0.0;
    for (part, step) in parts.iter().zip(poses) {
        let step = Vector6::from(*step);
        gain -= part.pose_right.dot(&step) + part.globals_right.dot(globals);
        for i in 0..6 {
            gain += damping * part.pose[(i, i)] * step[i] * step[i];
        }
        for i in 0..globals.len() {
            gain += damping * part.globals[(i, i)] * globals[i] * globals[i];
        }
    }
    gain
}

/// A factorisation behind a diagonal scaling: focal lengths and distortions differ by 10⁴.
pub(super) struct ScaledCholesky {
    scale: DVector<f64>,
    factors: Cholesky<f64, Dyn>,
}

pub(super) fn scaled_cholesky(mut system: DMatrix<f64>) -> Option<ScaledCholesky> {
    let n = system.nrows();
    let scale = DVector::from_fn(n, |i, _| system[(i, i)].max(f64::MIN_POSITIVE).sqrt().recip());
    for i in 0..n {
        for j in 0..n {
            system[(i, j)] *= scale[i] * scale[j];
        }
    }
    Some(ScaledCholesky { scale, factors: Cholesky::new(system)? })
}

impl ScaledCholesky {
    fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        self.factors.solve(&right.component_mul(&self.scale)).component_mul(&self.scale)
    }

    pub fn inverse(&self) -> DMatrix<f64> {
        let mut out = self.factors.inverse();
        for i in 0..out.nrows() {
            for j in 0..out.ncols() {
                out[(i, j)] *= self.scale[i] * self.scale[j];
            }
        }
        out
    }
}
