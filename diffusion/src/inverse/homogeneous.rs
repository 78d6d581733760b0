//! The homogeneous start: one κ and one μ for the whole block (W08 section 4.2).

use super::InverseError;
use super::objective::Misfit;
use material::Grid;

/// κ and μ that fit the images best as two numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Start {
    pub kappa_mm: f64,
    pub mu_per_mm: f64,
}

/// u = (log κ, log μ) of a block of so many cells that is the same everywhere.
pub(crate) fn logs(cells: usize, kappa_mm: f64, mu_per_mm: f64) -> Vec<f64> {
    let mut u = vec![kappa_mm.ln(); 2 * cells];
    u[cells..].fill(mu_per_mm.ln());
    u
}

/// Steps in log κ and log μ that are tried, largest first. The last one places the start within
/// a few percent, less than the block's own variation.
const STEPS: [f64; 5] = [1.2, 0.6, 0.3, 0.15, 0.07];

/// The least 3κμ of a start: an albedo of 0.999. The best homogeneous block of a bright, veined
/// sample may well be one that absorbs nothing; but ∂J/∂log μ = μ ∂J/∂μ, so from there log μ would
/// never move again.
const LEAST_ABSORPTION: f64 = 1e-3;

/// Descends in log κ and log μ by a compass search: two unknowns, a smooth misfit, and one
/// forward solve a try, warm-started from the last. What is minimised is the plain fit: dark
/// pixels say little about two numbers, and the discretisation shows most there. A block about ten
/// mean free paths thick with an albedo near one is where it begins.
///
/// `misfit` is the forward problem of one κ and one μ.
pub(crate) fn fit(
    grid: &Grid,
    mut misfit: impl FnMut(f64, f64) -> Result<Misfit, InverseError>,
) -> Result<Start, InverseError> {
    let thickness = grid.size_mm()[2];
    let mut u = [(thickness / 30.0).ln(), (0.03 / thickness).ln()];
    let mut value = |u: [f64; 2]| {
        let [kappa, mu] = coefficients(u);
        misfit(kappa, mu).map(|m| m.fit)
    };
    let mut best = value(u)?;
    for step in STEPS {
        // Six moves of the largest step cross three orders of magnitude; a start that is still
        // moving then is further off than any sample.
        for _ in 0..6 {
            let mut moved = false;
            for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)] {
                let mut next = u;
                next[axis] += sign * step;
                let tried = value(next)?;
                if tried < best {
                    (best, u, moved) = (tried, next, true);
                }
            }
            if !moved {
                break;
            }
        }
    }
    let [kappa_mm, mu_per_mm] = coefficients(u);
    Ok(Start { kappa_mm, mu_per_mm })
}

/// κ and μ from their logarithms.
fn coefficients([log_kappa, log_mu]: [f64; 2]) -> [f64; 2] {
    let kappa = log_kappa.exp();
    [kappa, log_mu.exp().max(LEAST_ABSORPTION / (3.0 * kappa))]
}
