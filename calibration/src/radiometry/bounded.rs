//! Small convex quadratic programmes with a floor under every unknown.

use nalgebra::{DMatrix, DVector};

use crate::error::{CalibrationError, Result};

/// Minimises ½ xᵀ Q x − bᵀ x subject to x ≥ floor, Q symmetric positive definite.
///
/// Block principal pivoting (Portugal, Júdice & Vicente 1994): exact in a few factorisations,
/// with single pivots as the rule that cannot cycle.
pub(crate) fn least_quadratic(
    q: &DMatrix<f64>,
    b: &DVector<f64>,
    floor: f64,
) -> Result<DVector<f64>> {
    let n = b.len();
    let failed = |reason: &str| CalibrationError::NotConverged {
        what: "monotone response fit",
        reason: reason.into(),
    };
    let mut free = vec![true; n];
    let (mut fewest, mut patience) = (n + 1, 3);
    for _ in 0..20 * n {
        let active: Vec<usize> = (0..n).filter(|&i| free[i]).collect();
        let mut x = DVector::from_element(n, floor);
        if !active.is_empty() {
            let held: DVector<f64> = DVector::from_fn(n, |i, _| if free[i] { 0.0 } else { floor });
            let rhs = b - q * held;
            let part =
                DMatrix::from_fn(active.len(), active.len(), |i, j| q[(active[i], active[j])]);
            let right = DVector::from_fn(active.len(), |i, _| rhs[active[i]]);
            let solved =
                part.cholesky().ok_or_else(|| failed("too little information in the bracket"))?;
            let solved = solved.solve(&right);
            active.iter().zip(solved.iter()).for_each(|(&i, &v)| x[i] = v);
        }
        let push = q * &x - b;
        // Rounding of a multiplier that is really zero.
        let slack = 1e-12 * b.amax().max(q.amax() * floor);
        let wrong: Vec<usize> =
            (0..n).filter(|&i| if free[i] { x[i] < floor } else { push[i] < -slack }).collect();
        let Some(&last) = wrong.last() else { return Ok(x) };
        if wrong.len() < fewest {
            (fewest, patience) = (wrong.len(), 3);
            wrong.iter().for_each(|&i| free[i] = !free[i]);
        } else if patience > 0 {
            patience -= 1;
            wrong.iter().for_each(|&i| free[i] = !free[i]);
        } else {
            free[last] = !free[last];
        }
    }
    Err(failed("the active set keeps changing"))
}
