//! The exact gradient of a function of the front face's radiance, by the discrete adjoint.

use crate::{Batch, Forward, Illuminations, LinearSolver, SolveError, SolveReport, beam};
use material::Face;
use rayon::prelude::*;

/// Derivatives of a scalar by κ and by μ of every cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Gradient {
    /// ∂J/∂κ, 1/mm for a dimensionless J.
    pub by_kappa: Vec<f64>,
    /// ∂J/∂μ, mm for a dimensionless J.
    pub by_mu: Vec<f64>,
}

impl<S: LinearSolver> Forward<'_, S> {
    /// The gradient of J(L) for given ∂J/∂L (`by_radiance`, one map a pattern).
    ///
    /// Solves A w = ∂J/∂φ (starting from `adjoint`, which is left holding w) and contracts:
    /// ∂J/∂μ_c = −V w φ; every face −(∂T/∂κ) Δw Δφ; boundary faces (∂g/∂κ) A_f w (Q − φ), and the
    /// direct term through the g in L; the beam's source by `beam::add_gradient`. The
    /// objective's own sum over fields is inside w and φ. This is the gradient of the
    /// discrete objective itself; W08 (7) is the continuous form, without the boundary terms.
    ///
    /// # Errors
    /// As [`LinearSolver::solve`].
    pub fn gradient(
        &mut self,
        light: &Illuminations,
        fluence: &Batch,
        by_radiance: &[Vec<f64>],
        adjoint: &mut Batch,
        tolerance: f64,
    ) -> Result<(Gradient, SolveReport), SolveError> {
        let surface = *self.surface();
        let grid = *self.medium().grid();
        let area = self.face_area();
        let plane = grid.face_len();
        let mut b = Batch::zeros(grid.len(), light.count());
        {
            let g = self.face_conductance(Face::Front);
            for (m, map) in by_radiance.iter().enumerate() {
                for (c, (g, d)) in g.iter().zip(map).enumerate() {
                    b.set(m, c, surface.exit_per_flux * g / area * d);
                }
            }
        }
        let report = self.solve_raw(&b, adjoint, tolerance)?;

        let medium = self.medium();
        let kappa = medium.kappa_mm();
        let volume = grid.cell_volume_mm3();
        let cells = grid.cells();
        let h = grid.spacing_mm();
        let strides = [1, cells[0], plane];
        let [mut by_kappa, mut by_mu] = [vec![0.0; grid.len()], vec![0.0; grid.len()]];
        fluence.lane_products(adjoint, |cell, product| by_mu[cell] -= volume * product);

        // Inner faces: T = 2 A κa κb / (h (κa + κb)), ∂T/∂κa = 2 A κb² / (h (κa + κb)²).
        for axis in 0..3 {
            let drop = face_drops(fluence, adjoint, cells, axis);
            let scale = 2.0 * volume / (h[axis] * h[axis]);
            for (i, d) in drop.iter().enumerate() {
                let position = [i % cells[0], i / cells[0] % cells[1], i / plane][axis];
                if position + 1 < cells[axis] {
                    let j = i + strides[axis];
                    let total = kappa[i] + kappa[j];
                    by_kappa[i] -= scale * (kappa[j] / total).powi(2) * d;
                    by_kappa[j] -= scale * (kappa[i] / total).powi(2) * d;
                }
            }
        }

        // Boundary faces: g = A / (2C + h/(2κ)), ∂g/∂κ = g² h / (2 A κ²).
        let operator = self.solver_operator().ok_or(SolveError::NotPrepared)?;
        for axis in 0..3 {
            let face_area = volume / h[axis];
            for side in 0..2 {
                let lit = axis == 2 && (side == 0) == (light.face() == Face::Front);
                for (k, cell) in crate::operator::face_cells(cells, axis, side).enumerate() {
                    let g = operator.edge[axis][side][k];
                    let slope = g * g * h[axis] / (2.0 * face_area * kappa[cell] * kappa[cell]);
                    let mut by_g = 0.0;
                    for m in 0..light.count() {
                        let (phi, w) = (fluence.get(m, cell), adjoint.get(m, cell));
                        let outside = if lit { surface.drive * light.maps()[m][k] } else { 0.0 };
                        by_g += w * (outside - phi);
                        if axis == 2 && side == 0 {
                            by_g +=
                                by_radiance[m][k] * surface.exit_per_flux / area * (phi - outside);
                        }
                    }
                    by_kappa[cell] += slope * by_g;
                }
            }
        }

        if surface.beam != 0.0 {
            let mut weight = vec![0.0; grid.len()];
            weight.par_chunks_mut(plane).enumerate().for_each(|(z, out)| {
                for (m, map) in light.maps().iter().enumerate() {
                    for (c, (o, e)) in out.iter_mut().zip(map).enumerate() {
                        *o += surface.beam * e * adjoint.get(m, z * plane + c);
                    }
                }
            });
            beam::add_gradient(medium, light.face(), &weight, &mut by_kappa, &mut by_mu);
        }
        Ok((Gradient { by_kappa, by_mu }, report))
    }
}

/// Σ over fields of Δφ Δw across the face between each cell and the next along an axis.
fn face_drops(phi: &Batch, w: &Batch, cells: [usize; 3], axis: usize) -> Vec<f64> {
    let stride = [1, cells[0], cells[0] * cells[1]][axis];
    let lanes = phi.lanes();
    let len = phi.cells();
    let mut out = vec![0.0; len];
    for block in 0..phi.blocks() {
        let (p, w) = (phi.block(block), w.block(block));
        out.par_iter_mut().enumerate().with_min_len(4096).for_each(|(i, o)| {
            let j = i + stride;
            if j < len {
                let at = |v: &'_ [f64], c: usize, l: usize| v[c * lanes + l];
                *o += (0..lanes)
                    .map(|l| (at(p, j, l) - at(p, i, l)) * (at(w, j, l) - at(w, i, l)))
                    .sum::<f64>();
            }
        });
    }
    out
}
