//! The exact gradient of a function of the front face's radiance, by the discrete adjoint.

use crate::cpu::sweep::{Row, RowKernel, rows};
use crate::operator::{PER_THREAD, face_cells, unknown_per_fluence};
use crate::{Batch, Forward, Illuminations, LinearSolver, SolveError, SolveReport};
use material::{Face, Scheme};
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
    /// direct term through the g in L; from there to κ and μ by what conducts; the beam's source by
    /// [`Beam::add_gradient`](crate::beam::Beam). The objective's own sum over fields is inside w and φ. With [`Scheme::Stam`] the unknown is κφ: inner
    /// faces know no κ, and absorption and boundary do so otherwise. This is the gradient of the
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

        let scheme = self.scheme();
        let medium = self.medium();
        let mu = medium.mu_per_mm();
        // What conducts, which is κ or not: up to the beam it is what derivatives are by.
        let conduction = self.conduction();
        let kappa = conduction.of_cells(medium);
        let volume = grid.cell_volume_mm3();
        let cells = grid.cells();
        let h = grid.spacing_mm();
        let strides = [1, cells[0], plane];
        let operator = self.solver_operator().ok_or(SolveError::NotPrepared)?;
        let product = products(cells, fluence, adjoint);
        let each = || (0..grid.len()).into_par_iter().with_min_len(PER_THREAD);
        let by_mu = |i: usize| -volume * product[i][OWN] / unknown_per_fluence(scheme, kappa[i]);
        let mut by_mu: Vec<f64> = each().map(by_mu).collect();

        // Inner faces: T = 2 A κa κb / (h (κa + κb)), ∂T/∂κa = 2 A κb² / (h (κa + κb)²).
        let scale: [f64; 3] = std::array::from_fn(|a| 2.0 * volume / (h[a] * h[a]));
        let by_links = |i: usize| {
            let mut sum = 0.0;
            for a in 0..3 {
                // Across the face from `low` to the next cell, of which i is one; no face, no link.
                let across = |low: usize| {
                    if operator.link[a][low] == 0.0 {
                        return 0.0;
                    }
                    let high = low + strides[a];
                    let other = if low == i { high } else { low };
                    (kappa[other] / (kappa[low] + kappa[high])).powi(2) * product[low][a]
                };
                sum -= scale[a] * (across(i) + i.checked_sub(strides[a]).map_or(0.0, across));
            }
            sum
        };
        let mut by_kappa: Vec<f64> = match scheme {
            Scheme::FiniteVolume => each().map(by_links).collect(),
            // The absorption of κφ is μ/κ.
            Scheme::Stam => {
                each().map(|i| volume * mu[i] * product[i][OWN] / (kappa[i] * kappa[i])).collect()
            }
        };

        // Boundary faces: g = A / (2C + h/(2κ)) enters, ∂g/∂κ = g² h / (2 A κ²); e leaves, which is g, or
        // g/κ = A / (2Cκ + h/2), ∂e/∂κ = −2C e²/A.
        for axis in 0..3 {
            let face_area = volume / h[axis];
            for side in 0..2 {
                let front = axis == 2 && side == 0;
                let lit = axis == 2 && front == (light.face() == Face::Front);
                for (k, cell) in face_cells(cells, axis, side).enumerate() {
                    let e = operator.edge[axis][side][k];
                    let g = e * unknown_per_fluence(scheme, kappa[cell]);
                    let g_slope = g * g * h[axis] / (2.0 * face_area * kappa[cell] * kappa[cell]);
                    let e_slope = match scheme {
                        Scheme::FiniteVolume => g_slope,
                        Scheme::Stam => -2.0 * surface.boundary_constant * e * e / face_area,
                    };
                    let (mut by_g, mut by_e) = (0.0, -product[cell][OWN]);
                    if lit || front {
                        for m in 0..light.count() {
                            let drive = if lit { surface.drive } else { 0.0 };
                            let outside = drive * light.maps()[m][k];
                            by_g += adjoint.get(m, cell) * outside;
                            if front {
                                let by_flux = by_radiance[m][k] * surface.exit_per_flux / area;
                                by_e += by_flux * fluence.get(m, cell);
                                by_g -= by_flux * outside;
                            }
                        }
                    }
                    by_kappa[cell] += g_slope * by_g + e_slope * by_e;
                }
            }
        }

        let slopes = by_kappa.par_iter_mut().zip(&mut by_mu).zip(medium.kappa_mm()).zip(mu);
        slopes.for_each(|(((by_kappa, by_mu), kappa), mu)| {
            let (_, d_by_kappa, d_by_mu) = conduction.at(*kappa, *mu);
            *by_mu += *by_kappa * d_by_mu;
            *by_kappa *= d_by_kappa;
        });

        if surface.beam != 0.0 {
            let mut weight = vec![0.0; grid.len()];
            weight.par_chunks_mut(plane).enumerate().for_each(|(z, out)| {
                for (m, map) in light.maps().iter().enumerate() {
                    for (c, (o, e)) in out.iter_mut().zip(map).enumerate() {
                        *o += surface.beam * e * adjoint.get(m, z * plane + c);
                    }
                }
            });
            let beam = self.beam(light.face());
            beam.add_gradient(medium, &weight, &mut by_kappa, &mut by_mu);
        }
        Ok((Gradient { by_kappa, by_mu }, report))
    }
}

/// Where [`products`] has φ w; before it stand the three axes.
const OWN: usize = 3;

/// For every cell, Σ over fields of Δφ Δw across the face to the next cell along x, y and z
/// (nothing that counts at the end of an axis), and of φ w.
fn products(cells: [usize; 3], phi: &Batch, w: &Batch) -> Vec<[f64; 4]> {
    let mut out = vec![[0.0; 4]; phi.cells()];
    for block in 0..phi.blocks() {
        let (phi_block, w_block) = (phi.block(block), w.block(block));
        if phi.lanes() == 16 {
            let (phi, w) = (phi_block.as_chunks::<16>().0, w_block.as_chunks().0);
            rows(cells, &mut out, &Products { cells, phi, w });
        } else {
            let (phi, w) = (phi_block.as_chunks::<4>().0, w_block.as_chunks().0);
            rows(cells, &mut out, &Products { cells, phi, w });
        }
    }
    out
}

/// Adds one block's [`products`] to `out`.
struct Products<'a, const L: usize> {
    cells: [usize; 3],
    phi: &'a [[f64; L]],
    w: &'a [[f64; L]],
}

impl<const L: usize> RowKernel<f64, 4> for Products<'_, L> {
    type Sum = f64;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [[f64; 4]], _: &mut [f64; 4]) {
        let row = Row::new(self.cells, y, z);
        let (phi, w) = (row.around(self.phi), row.around(self.w));
        let last = out.len() - 1;
        for x in 0..out.len() {
            let own = (&phi[0][x], &w[0][x]);
            let next = (x + 1).min(last);
            out[x][0] += dot_of_drops(own, (&phi[0][next], &w[0][next]));
            out[x][1] += dot_of_drops(own, (&phi[2][x], &w[2][x]));
            out[x][2] += dot_of_drops(own, (&phi[4][x], &w[4][x]));
            out[x][OWN] += dot_of_drops(own, (&[0.0; L], &[0.0; L]));
        }
    }
}

/// Σ over lanes of (a₀ − b₀)(a₁ − b₁), in four sums side by side.
#[inline(always)]
fn dot_of_drops<const L: usize>(a: (&[f64; L], &[f64; L]), b: (&[f64; L], &[f64; L])) -> f64 {
    let mut sums = [0.0; 4];
    for l in 0..L {
        sums[l % 4] += (a.0[l] - b.0[l]) * (a.1[l] - b.1[l]);
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}
