//! How residuals scatter, whatever a few of them do.

use crate::median::median;

use super::{KINDS, Problem, Residual, State, residuals};

/// 1-sigma of one coordinate of each kind of residual from the median length, pixels; 1 where
/// there is none.
///
/// The length of a plane normal vector has the median sigma √(2 ln 2).
pub(crate) fn robust_sigma(problem: &Problem<'_>, state: &State) -> [f64; KINDS] {
    let mut lengths = [const { Vec::new() }; KINDS];
    for (_, r) in all(problem, state) {
        lengths[r.sight as usize].push(r.px[0].hypot(r.px[1]));
    }
    lengths.map(|mut lengths| {
        median(&mut lengths).map_or(1.0, |m| (m / (2.0 * std::f64::consts::LN_2).sqrt()).max(1e-9))
    })
}

/// Residuals longer than `sigmas` times the problem's noise, each with its view.
pub(crate) fn far_residuals(
    problem: &Problem<'_>,
    state: &State,
    sigmas: f64,
) -> Vec<(usize, Residual)> {
    let far = |r: &Residual| r.px[0].hypot(r.px[1]) > sigmas * problem.sigma[r.sight as usize];
    all(problem, state).filter(|(_, r)| far(r)).collect()
}

fn all<'a>(
    problem: &'a Problem<'_>,
    state: &'a State,
) -> impl Iterator<Item = (usize, Residual)> + 'a {
    (0..problem.views.len()).flat_map(|view| {
        residuals(problem, state, view).unwrap_or_default().into_iter().map(move |r| (view, r))
    })
}
