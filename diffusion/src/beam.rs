//! The first-scatter source of a collimated beam along z, and its derivative.
//!
//! A beam of unit irradiance that enters a column loses exp(−σt' h) in every cell, with the
//! reduced extinction σt' = 1/(3κ); of what it loses, the share α = σs'/σt' = 1 − 3κμ becomes
//! diffuse light. Integrated over cell c: s_c = A α_c (exp(−τ_in) − exp(−τ_out)).
//!
//! Within a cell more scatters near the lamp than far from it: on average [`nearer`] cells before
//! the middle, which is where a cell's source acts. That share of s_c belongs to the cell before,
//! so that the mean depth is right; without it light starts h²/12 mean free paths too deep. Before the
//! outermost cell is the face: to what would act on the far side of it, fluence goes on as straight
//! as it does inside, and light that is moved there has left. It is not put into the image of the lit cell,
//! whose exit radiance stands for all of its light: with both, the BSSRDF from front to front on cells of half a mean
//! free path was three times as far from a finer grid's.

use crate::Medium;
use crate::conduction::Conduction;
use material::{Face, Grid};
use rayon::prelude::*;

/// A beam of unit irradiance on every column.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Beam {
    /// The face that it enters through.
    pub face: Face,
    /// C of that face.
    pub boundary_constant: f64,
    /// What the face leads fluence away with.
    pub conduction: Conduction,
}

/// The share of a cell's source that belongs to the cell before it, or has left if it is the first,
/// and its derivatives.
struct Moved {
    share: f64,
    by_kappa: f64,
    by_mu: f64,
}

impl Beam {
    fn moved(&self, kappa: f64, mu: f64, h: f64, first: bool) -> Moved {
        let tau = h / (3.0 * kappa);
        let (share, by_kappa) = (nearer(tau), -nearer_slope(tau) * tau / kappa);
        if !first {
            return Moved { share, by_kappa, by_mu: 0.0 };
        }
        // What a source one cell before the outermost loses through the face, of what it would be inside: the
        // fluence falls on a straight line to 0 at 2CD outside.
        let (d, d_by_kappa, d_by_mu) = self.conduction.at(kappa, mu);
        let beyond = h / (2.0 * self.boundary_constant * d + 0.5 * h);
        let beyond_slope = -2.0 * self.boundary_constant / h * beyond * beyond;
        Moved {
            share: share * beyond,
            by_kappa: by_kappa * beyond + share * beyond_slope * d_by_kappa,
            by_mu: share * beyond_slope * d_by_mu,
        }
    }

    /// s_c for every cell, mm²: the source in cell c for unit irradiance on its column.
    pub fn first_scatter(&self, medium: &Medium) -> Vec<f64> {
        let grid = medium.grid();
        let plane = grid.face_len();
        let [hx, hy, hz] = grid.spacing_mm();
        let mut arrives = vec![1.0; plane];
        let mut out = vec![0.0; grid.len()];
        let mut before = None;
        for z in self.depths(grid) {
            let cells = z * plane..(z + 1) * plane;
            let coefficients = (&medium.kappa_mm()[cells.clone()], &medium.mu_per_mm()[cells]);
            // Own source, and what belongs to the cell before.
            let scatter = |(arrives, (kappa, mu)): (&mut f64, (&f64, &f64))| {
                let lost = -(-hz / (3.0 * kappa)).exp_m1() * *arrives;
                *arrives -= lost;
                let source = hx * hy * (1.0 - 3.0 * kappa * mu) * lost;
                let Moved { share, .. } = self.moved(*kappa, *mu, hz, before.is_none());
                (source * (1.0 - share), source * share)
            };
            let (own, nearer): (Vec<f64>, Vec<f64>) =
                arrives.par_iter_mut().zip(coefficients.into_par_iter()).map(scatter).unzip();
            out[z * plane..(z + 1) * plane].copy_from_slice(&own);
            if let Some(before) = before {
                let before = &mut out[before * plane..][..plane];
                before.iter_mut().zip(&nearer).for_each(|(out, source)| *out += source);
            }
            before = Some(z);
        }
        out
    }

    /// Adds to the gradients what the source contributes.
    ///
    /// `weight[c]` is Σ_m E_m w_m in cell c: the adjoint fluence times the irradiance of the column.
    /// Extinction in a cell feeds its own source, moves it towards the lamp, and dims all cells behind it.
    pub fn add_gradient(
        &self,
        medium: &Medium,
        weight: &[f64],
        d_kappa: &mut [f64],
        d_mu: &mut [f64],
    ) {
        let grid = medium.grid();
        let plane = grid.face_len();
        let [hx, hy, hz] = grid.spacing_mm();
        let area = hx * hy;
        let order: Vec<usize> = self.depths(grid).collect();
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
                    let (first, last) =
                        ((-tau_in[k]).exp(), (-tau_in[k] - hz / (3.0 * kappa)).exp());
                    let albedo = 1.0 - 3.0 * kappa * mu;
                    // What has left counts nothing.
                    let before = k.checked_sub(1).map_or(0.0, |k| weight[order[k] * plane + c]);
                    let gain = before - weight[i];
                    let moved = self.moved(kappa, mu, hz, k == 0);
                    let weight = weight[i] + moved.share * gain;
                    let by_extinction = hz * (area * albedo * last * weight - behind);
                    let lost = area * (first - last);
                    column[k] = (
                        -by_extinction / (3.0 * kappa * kappa) - 3.0 * mu * lost * weight
                            + albedo * lost * moved.by_kappa * gain,
                        -3.0 * kappa * lost * weight + albedo * lost * moved.by_mu * gain,
                    );
                    behind += albedo * lost * weight;
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
    fn depths(&self, grid: &Grid) -> Box<dyn Iterator<Item = usize>> {
        let nz = grid.cells()[2];
        match self.face {
            Face::Front => Box::new(0..nz),
            Face::Back => Box::new((0..nz).rev()),
        }
    }
}

/// How far before the middle of a cell of optical thickness τ its light scatters on average, in
/// cells: 1/2 − 1/τ + 1/(e^τ − 1), 0 for a thin cell and 1/2 for an opaque one.
fn nearer(tau: f64) -> f64 {
    if tau < SERIES {
        let square = tau * tau;
        tau / 12.0 * (1.0 - square / 60.0 * (1.0 - square / 42.0))
    } else {
        0.5 - tau.recip() + tau.exp_m1().recip()
    }
}

/// The derivative of [`nearer`].
fn nearer_slope(tau: f64) -> f64 {
    if tau < SERIES {
        let square = tau * tau;
        (1.0 - square / 20.0 * (1.0 - square * 5.0 / 126.0)) / 12.0
    } else {
        (tau * tau).recip() - (2.0 * (0.5 * tau).sinh()).powi(-2)
    }
}

/// Below this optical thickness, where the closed forms cancel, three terms of their series are
/// exact to rounding.
const SERIES: f64 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;

    /// The mean of where an exponential scatters, by the midpoint rule, and where series and closed form
    /// meet: both to rounding, the closed forms' being 1e-16/τ and 1e-16/τ².
    #[test]
    fn light_scatters_before_the_middle() {
        for tau in [1e-3, 0.049_999_9, 0.050_000_1, 0.3, 2.0, 30.0] {
            const STEPS: usize = 100_000;
            let (mut all, mut first) = (0.0, 0.0);
            for i in 0..STEPS {
                let t = (i as f64 + 0.5) / STEPS as f64;
                let scattered = (-tau * t).exp();
                all += scattered;
                first += scattered * (0.5 - t);
            }
            // The rule's own error: the integrand's slope changes by 2τ, or τ²/2 over their mean, / (24 · 1e10).
            let bound = 1e-13 + 1e-11 * tau * (1.0 + tau);
            assert!((nearer(tau) - first / all).abs() < bound, "{tau}: {}", nearer(tau));
        }
        let (low, high) = (SERIES * (1.0 - 1e-9), SERIES * (1.0 + 1e-9));
        assert!((nearer_slope(high) - nearer_slope(low)).abs() < 1e-12);
        let difference = (nearer(0.7 + 1e-5) - nearer(0.7 - 1e-5)) / 2e-5;
        assert!((nearer_slope(0.7) - difference).abs() < 1e-9);
    }
}
