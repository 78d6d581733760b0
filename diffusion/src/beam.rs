//! The first-scatter source of a collimated beam along z, and its derivative.
//!
//! A beam of unit irradiance that enters a column loses exp(−σt' h) in every cell, with the
//! reduced extinction σt' = 1/(3κ); of what it loses, the share α = σs'/σt' = 1 − 3κμ becomes
//! diffuse light. Integrated over cell c: s_c = A α_c (exp(−τ_in) − exp(−τ_out)).

use crate::Medium;
use material::Face;
use rayon::prelude::*;

/// s_c for every cell, mm²: the source in cell c for unit irradiance on its column.
pub(crate) fn first_scatter(medium: &Medium, face: Face) -> Vec<f64> {
    let grid = medium.grid();
    let plane = grid.face_len();
    let [hx, hy, hz] = grid.spacing_mm();
    let mut depth = vec![0.0; plane];
    let mut out = vec![0.0; grid.len()];
    for z in depths(grid.cells()[2], face) {
        let base = z * plane;
        for c in 0..plane {
            let (kappa, mu) = (medium.kappa_mm()[base + c], medium.mu_per_mm()[base + c]);
            let next = depth[c] + hz / (3.0 * kappa);
            let lost = (-depth[c]).exp() - (-next).exp();
            out[base + c] = hx * hy * (1.0 - 3.0 * kappa * mu) * lost;
            depth[c] = next;
        }
    }
    out
}

/// Adds to the gradients what the source contributes.
///
/// `weight[c]` is Σ_m E_m w_m in cell c: the adjoint fluence times the irradiance of the column.
/// Extinction in a cell feeds its own source, and dims all cells behind it.
pub(crate) fn add_gradient(
    medium: &Medium,
    face: Face,
    weight: &[f64],
    d_kappa: &mut [f64],
    d_mu: &mut [f64],
) {
    let grid = medium.grid();
    let plane = grid.face_len();
    let [hx, hy, hz] = grid.spacing_mm();
    let area = hx * hy;
    let order: Vec<usize> = depths(grid.cells()[2], face).collect();
    let columns: Vec<Vec<(f64, f64)>> = (0..plane)
        .into_par_iter()
        .map(|c| {
            let mut tau_in = Vec::with_capacity(order.len());
            let mut tau = 0.0;
            for &z in &order {
                tau_in.push(tau);
                tau += hz / (3.0 * medium.kappa_mm()[z * plane + c]);
            }
            let mut behind = 0.0;
            let mut column = vec![(0.0, 0.0); order.len()];
            for (k, &z) in order.iter().enumerate().rev() {
                let i = z * plane + c;
                let (kappa, mu) = (medium.kappa_mm()[i], medium.mu_per_mm()[i]);
                let (first, last) = ((-tau_in[k]).exp(), (-tau_in[k] - hz / (3.0 * kappa)).exp());
                let albedo = 1.0 - 3.0 * kappa * mu;
                let by_extinction = hz * (area * albedo * last * weight[i] - behind);
                let lost = area * (first - last) * weight[i];
                column[k] =
                    (-by_extinction / (3.0 * kappa * kappa) - 3.0 * mu * lost, -3.0 * kappa * lost);
                behind += albedo * lost;
            }
            column
        })
        .collect();
    for (c, column) in columns.iter().enumerate() {
        for (&z, (by_kappa, by_mu)) in order.iter().zip(column) {
            d_kappa[z * plane + c] += by_kappa;
            d_mu[z * plane + c] += by_mu;
        }
    }
}

/// Planes in the order in which the beam meets them.
fn depths(nz: usize, face: Face) -> Box<dyn Iterator<Item = usize>> {
    match face {
        Face::Front => Box::new(0..nz),
        Face::Back => Box::new((0..nz).rev()),
    }
}
