//! Least squares for a handful of unknowns: Levenberg–Marquardt with central differences.

use nalgebra::{DMatrix, DVector};

use crate::error::{CalibrationError, Result};

/// Where the least squares lie and how sharply.
pub(crate) struct Fit {
    pub(crate) x: Vec<f64>,
    /// 1-sigma of each unknown, from the residuals' own scatter.
    pub(crate) sigma: Vec<f64>,
}

/// Minimises Σ r² from `start`; `steps` are each unknown's natural scale for differences.
///
/// # Errors
/// Residuals that are not finite at the start, or no convergence in 500 rounds.
pub(crate) fn levenberg_marquardt(
    what: &'static str,
    residuals: impl Fn(&[f64]) -> Vec<f64>,
    start: &[f64],
    steps: &[f64],
) -> Result<Fit> {
    let failed = |reason: &str| CalibrationError::NotConverged { what, reason: reason.into() };
    let n = start.len();
    let mut x = start.to_vec();
    let mut r = DVector::from_vec(residuals(&x));
    if !r.norm_squared().is_finite() {
        return Err(failed("a point lies behind the device at the starting values"));
    }
    let mut damping = 1e-3;
    for _ in 0..500 {
        let jacobian = differences(&residuals, &x, steps, r.len());
        let normal = jacobian.transpose() * &jacobian;
        let gradient = jacobian.transpose() * &r;
        loop {
            let mut damped = normal.clone();
            for i in 0..n {
                damped[(i, i)] += damping * normal[(i, i)].max(1e-300);
            }
            let step = damped.cholesky().map(|c| c.solve(&gradient));
            let trial = step.map(|step| {
                let moved: Vec<f64> = x.iter().zip(step.iter()).map(|(a, s)| a - s).collect();
                let r = DVector::from_vec(residuals(&moved));
                (moved, r, step)
            });
            match trial {
                Some((moved, lower, step)) if lower.norm_squared() <= r.norm_squared() => {
                    let gain = r.norm_squared() - lower.norm_squared();
                    let still = step.iter().zip(steps).all(|(s, scale)| s.abs() < 1e-7 * scale);
                    let settled = still || gain <= 1e-14 * r.norm_squared();
                    (x, r, damping) = (moved, lower, (damping * 0.1).max(1e-12));
                    if settled {
                        return Ok(Fit { sigma: sigmas(&normal, &r), x });
                    }
                    break;
                }
                // No step of any length goes down: this is the bottom, to rounding.
                _ if damping > 1e12 => return Ok(Fit { sigma: sigmas(&normal, &r), x }),
                _ => damping *= 10.0,
            }
        }
    }
    Err(failed("500 rounds were not enough"))
}

fn differences(
    residuals: impl Fn(&[f64]) -> Vec<f64>,
    x: &[f64],
    steps: &[f64],
    rows: usize,
) -> DMatrix<f64> {
    let mut jacobian = DMatrix::zeros(rows, x.len());
    let mut moved = x.to_vec();
    for (column, &scale) in steps.iter().enumerate() {
        // Cube root of the machine's precision balances truncation and rounding.
        let h = 6e-6 * scale;
        moved[column] = x[column] + h;
        let above = residuals(&moved);
        moved[column] = x[column] - h;
        let below = residuals(&moved);
        moved[column] = x[column];
        for (row, (a, b)) in above.iter().zip(&below).enumerate() {
            jacobian[(row, column)] = (a - b) / (2.0 * h);
        }
    }
    jacobian
}

fn sigmas(normal: &DMatrix<f64>, r: &DVector<f64>) -> Vec<f64> {
    let freedom = r.len().saturating_sub(normal.nrows()).max(1) as f64;
    let variance = r.norm_squared() / freedom;
    match normal.clone().try_inverse() {
        Some(inverse) => {
            inverse.diagonal().iter().map(|v| (v * variance).max(0.0).sqrt()).collect()
        }
        None => vec![f64::INFINITY; normal.nrows()],
    }
}
