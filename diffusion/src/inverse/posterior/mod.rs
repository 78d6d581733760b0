//! How far the images determine κ and μ, voxel by voxel, and how far smoothness alone does.
//!
//! # What is asked
//! Near its answer the objective is quadratic in u = (log κ, log μ). Times half the energy E of the
//! images, its curvature is H + P: H = Jᵀ W J is the data's (Gauss–Newton; J the derivative of the
//! images, W = 1/variance, so that H counts in units of one standard deviation), P = λ E · ½ ∂²R/∂u²
//! the smoothness term's. Along a patch b, a bump of width ℓ around a voxel against its surroundings
//! (`patch.rs`), the data have the curvature d = bᵀHb and the smoothness p = bᵀPb. A patch in κ can be
//! made up for by the same patch in μ, and the other way round: with the other one free, what is left of d
//! is d' = d_κκ − d_κμ²/(d_μμ + p_μ). The *resolution* of a voxel is the smallest width with
//! d' ≥ 10 p: finer detail comes from smoothness more than from the images.
//!
//! Not the diagonals of H and P themselves: a voxel alone never changes images much, and how much
//! depends on the voxels' size, so that their ratio says more about the grid than about the block.
//! Nor 1/√d as a standard deviation: neighbours, too, make up for each other.
//!
//! Where edges are kept, P is that of small steps all the same: across an edge the smoothness holds less than that, and
//! the resolution there is finer than what is said.
//!
//! # What it bounds
//! Of a true patch b the answer holds M b with M = (H + P)⁻¹H, the resolution matrix of Backus and
//! Gilbert (1968), everything being free to make up for everything. In P's scalar product its share in
//! b is f = ⟨b, Mb⟩/⟨b, b⟩ = 1 − bᵀP(H + P)⁻¹Pb / p, and bᵀP(H + P)⁻¹Pb is the largest value of
//! (bᵀPv)²/(vᵀ(H + P)v) over all v. The patches in κ and in μ are some of them, so f ≤ d'/(d' + p).
//! That is a bound and no estimate: in simulated blocks, back and front lit, with 0.3 to 3 % of noise,
//! f was at most 0.07 at d' < p, a third to two thirds at d' from 10 to 30 p, and more beyond. Hence the
//! 10. Deep down d' is made up for by what lies above, which nothing here
//! knows: the resolution is a lower bound on the detail that is determined.
//!
//! # How
//! For a random z of ±1 on every pixel, E[(b · JᵀW^½z)²] = d (Hutchinson, 1990), with a relative
//! standard deviation of at most √2. One z costs one adjoint solve of all patterns and serves all
//! patches of both coefficients. What is left of the scatter is averaged over a bump of the patch's width
//! within the slice: patches that overlap have much the same d/p, and those that do not are hit by
//! other random numbers. Against 400 probes without that average, 8 with it scatter by 12 to 15 % in
//! the resolution (22 to 25 % without it), and 200 with it by 4 to 6 %, which is what it smears.

mod patch;
#[cfg(test)]
mod tests;

use super::{Inverse, InverseError, InverseSettings, Measurement, Method, OF_MU};
use crate::{Batch, Forward, LinearSolver, Medium};
use material::{Face, Grid, Optics};
use patch::Ladder;
pub use patch::widest_patch_mm;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Relative residual of the solves of [`Solved::determination`]. From 1e-7 to this one the resolution
/// changes by less than 1 % on average, far less than it scatters.
pub const PROBING_TOLERANCE: f64 = 1e-2;

/// An inverse problem and what [`invert`](crate::invert) found.
#[derive(Clone, Copy, Debug)]
pub struct Solved<'a> {
    /// The grid.
    pub grid: &'a Grid,
    /// The optical convention.
    pub optics: &'a Optics,
    /// The images.
    pub measurement: &'a Measurement,
    /// The settings.
    pub settings: &'a InverseSettings,
    /// κ, μ, gain and λ.
    pub found: &'a Inverse,
}

/// The finest detail that the images determine, for every voxel.
///
/// The smallest width of a patch with d' ≥ 10 p (see `inverse/posterior/mod.rs`), between the largest
/// edge of a cell and [`widest_patch_mm`], mm. Infinite where not even that is determined. It is
/// a lower bound, and from 8 probes good to about 15 %.
#[derive(Clone, Debug, PartialEq)]
pub struct Determination {
    /// Of log κ, one value a voxel.
    pub kappa_mm: Vec<f64>,
    /// Of log μ.
    pub mu_mm: Vec<f64>,
}

/// How many times the smoothness's curvature the data's has to be.
const DETERMINED: f64 = 10.0;

/// Curvatures along the patches of one width, the data's over the smoothness's, one value a voxel.
struct Curvature {
    width_mm: f64,
    /// d/p of log κ and of log μ.
    data: [Vec<f32>; 2],
    /// d between the two over the geometric mean of their p.
    cross: Vec<f32>,
}

impl Curvature {
    /// Adds the products of a probe with the patches in log κ and log μ.
    fn add(&mut self, kappa: &[f64], mu: &[f64]) {
        let [of_kappa, of_mu] = &mut self.data;
        let sums = of_kappa.par_iter_mut().zip(of_mu).zip(&mut self.cross);
        sums.zip(kappa.par_iter().zip(mu)).for_each(|(((of_kappa, of_mu), cross), (kappa, mu))| {
            *of_kappa += (kappa * kappa) as f32;
            *of_mu += (mu * mu) as f32;
            *cross += (kappa * mu) as f32;
        });
    }

    /// Does the same to all of its maps.
    fn each(&mut self, mut change: impl FnMut(&mut Vec<f32>)) {
        let Self { data: [of_kappa, of_mu], cross, .. } = self;
        [of_kappa, of_mu, cross].into_iter().for_each(&mut change);
    }

    /// d'/p of log κ (0) or log μ (1).
    fn ratio(&self, which: usize, voxel: usize) -> f64 {
        let [own, other] = [which, 1 - which].map(|which| f64::from(self.data[which][voxel]));
        own - f64::from(self.cross[voxel]).powi(2) / (other + 1.0)
    }
}

impl Solved<'_> {
    /// How far the images determine the answer, from `probes` random vectors made from `seed`. (Any
    /// solver does, wherever the answer was found.) `observer` is told probes done and in all, and
    /// returns false to stop.
    ///
    /// None where no smoothness of log κ and log μ is at work that the images could be weighed
    /// against: λ = 0, or the paper's method.
    ///
    /// # Errors
    /// A solve fails, or `observer` returns false.
    pub fn determination<S: LinearSolver>(
        &self,
        probes: usize,
        seed: u64,
        solver: &mut S,
        observer: impl FnMut(usize, usize) -> bool,
    ) -> Result<Option<Determination>, InverseError> {
        if self.settings.method != Method::Lbfgs || self.found.lambda == 0.0 {
            return Ok(None);
        }
        let ladder = Ladder::new(self.grid);
        let mut curvatures = self.curvatures(&ladder, probes, seed, solver, observer)?;
        for (patch, curvature) in curvatures.iter_mut().enumerate() {
            curvature.each(|values| ladder.within_slices(patch, values));
        }
        let of = |which: usize| {
            (0..self.grid.len()).map(|i| resolution(&curvatures, which, i)).collect()
        };
        Ok(Some(Determination { kappa_mm: of(0), mu_mm: of(1) }))
    }

    /// Curvatures along all patches, as the probes have them.
    fn curvatures<S: LinearSolver>(
        &self,
        ladder: &Ladder,
        probes: usize,
        seed: u64,
        solver: &mut S,
        mut observer: impl FnMut(usize, usize) -> bool,
    ) -> Result<Vec<Curvature>, InverseError> {
        let Solved { grid, optics, settings, found, .. } = *self;
        let measurement = self.measurement.with_model_error(settings.model_error);
        let medium = Medium::new(*grid, found.kappa_mm.clone(), found.mu_per_mm.clone())
            .map_err(|e| InverseError::Optimiser(e.to_string()))?;
        let light = measurement.light();
        let mut fluence = Batch::zeros(grid.len(), light.count());
        let mut adjoint = Batch::zeros(grid.len(), light.count());
        let mut forward = Forward::new(medium, optics, solver)?;
        forward.solve(light, &mut fluence, PROBING_TOLERANCE)?;

        let sigma_inverse: Vec<Vec<f64>> =
            measurement.weight().iter().map(|w| w.iter().map(|w| w.sqrt()).collect()).collect();
        // What a fitted gain can make up for says nothing about κ and μ.
        let gained = settings.free_gain.then(|| {
            let images = forward.exit_radiance(light, &fluence, Face::Front);
            maps(&images, &sigma_inverse, |l, s| l * s)
        });

        let energy = measurement.weighted_energy();
        let mut curvatures: Vec<Curvature> = ladder
            .widths_mm()
            .map(|width_mm| {
                let zeros = || vec![0.0; grid.len()];
                Curvature { width_mm, data: [zeros(), zeros()], cross: zeros() }
            })
            .collect();
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        for probe in 0..probes {
            if !observer(probe, probes) {
                return Err(InverseError::Interrupted);
            }
            let mut sign = || if random.random::<bool>() { 1.0 } else { -1.0 };
            let mut z: Vec<Vec<f64>> =
                sigma_inverse.iter().map(|map| map.iter().map(|_| sign()).collect()).collect();
            if let Some(gained) = &gained {
                let along = dot(gained, &z) / dot(gained, gained);
                z = maps(&z, gained, |z, g| z - along * g);
            }
            let by_radiance = maps(&z, &sigma_inverse, |z, s| found.gain * z * s);
            adjoint.clear();
            let (gradient, _) =
                forward.gradient(light, &fluence, &by_radiance, &mut adjoint, PROBING_TOLERANCE)?;
            let by_log = |by: &[f64], value: &[f64]| -> Vec<f64> {
                by.iter().zip(value).map(|(g, v)| g * v).collect()
            };
            let by_logs = [
                by_log(&gradient.by_kappa, &found.kappa_mm),
                by_log(&gradient.by_mu, &found.mu_per_mm),
            ];
            let [kappa, mu] = by_logs.each_ref().map(|by_log| ladder.products(by_log));
            for ((kappa, mu), curvature) in kappa.zip(mu).zip(&mut curvatures) {
                curvature.add(&kappa, &mu);
            }
        }
        let scale = 1.0 / (probes as f64 * found.lambda * energy);
        for (curvature, roughness) in curvatures.iter_mut().zip(ladder.roughness()) {
            let weigh = |values: &mut Vec<f32>, counts: f64| {
                let ratio =
                    |(v, r): (&mut f32, &f64)| *v = (scale / counts * f64::from(*v) / r) as f32;
                values.iter_mut().zip(&roughness).for_each(ratio);
            };
            let Curvature { data: [of_kappa, of_mu], cross, .. } = curvature;
            weigh(of_kappa, 1.0);
            weigh(of_mu, OF_MU);
            weigh(cross, OF_MU.sqrt());
        }
        Ok(curvatures)
    }
}

/// The smallest width with d' ≥ 10 p; between two widths by the logarithms.
fn resolution(curvatures: &[Curvature], which: usize, voxel: usize) -> f64 {
    let mut before: Option<(f64, f64)> = None;
    for curvature in curvatures {
        let excess = (curvature.ratio(which, voxel) / DETERMINED).ln();
        let log_width = curvature.width_mm.ln();
        if excess >= 0.0 {
            return match before {
                Some((width, lack)) if lack.is_finite() => {
                    (width + (log_width - width) * lack / (lack - excess)).exp()
                }
                _ => curvature.width_mm,
            };
        }
        before = Some((log_width, excess));
    }
    f64::INFINITY
}

fn maps(a: &[Vec<f64>], b: &[Vec<f64>], of: impl Fn(f64, f64) -> f64) -> Vec<Vec<f64>> {
    let map = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| of(*a, *b)).collect();
    a.iter().zip(b).map(map).collect()
}

fn dot(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum()
}
