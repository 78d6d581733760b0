//! How far an acquired material is from the true one: E, log κ, log μ.

use super::scene::Scene;
use super::solving::{Device, go_on};
use crate::Failure;
use diffusion::{Forward, Illuminations, Medium, average};
use material::Grid;
use serde::{Deserialize, Serialize};

/// Source cells that are solved for in one batch.
const SOURCES: usize = 16;
/// Relative residual of the solves: E is known to about its root, far below any that is acquired.
const TOLERANCE: f64 = 1e-5;

/// What a material is off by.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Errors {
    /// E: squared difference of the diffuse BSSRDF over its square, from all cells of the lit face
    /// to all cells of the front face.
    pub e: f64,
    /// Root mean square of log(κ/κ_true) over all cells.
    pub log_kappa: f64,
    /// Root mean square of log(μ/μ_true).
    pub log_mu: f64,
}

/// The true block's BSSRDF, computed once: `diffusion::bssrdf_error` would do it anew for each
/// material, on the finer grid, which takes most of the time.
pub(crate) struct Truth {
    scene: Scene,
    coefficients: Medium,
    /// One map a source cell, on the solved grid's front face.
    bssrdf: Vec<Vec<f32>>,
    energy: f64,
}

impl Truth {
    /// `told` hears how many batches of how many are done.
    ///
    /// # Errors
    /// A solve fails, or Ctrl-C was pressed.
    pub fn new(
        scene: &Scene,
        device: &mut Device,
        told: impl FnMut(usize, usize),
    ) -> Result<Self, Failure> {
        let (mut bssrdf, mut energy) = (Vec::new(), 0.0);
        each_source(scene, scene.fine_truth()?, device, told, |_, image| {
            energy += image.iter().map(|l| l * l).sum::<f64>();
            bssrdf.push(image.iter().map(|l| *l as f32).collect());
        })?;
        Ok(Self { scene: *scene, coefficients: scene.truth()?, bssrdf, energy })
    }

    /// # Errors
    /// Coefficients that are none, a solve that fails, or Ctrl-C was pressed.
    pub fn errors(
        &self,
        kappa_mm: &[f64],
        mu_per_mm: &[f64],
        device: &mut Device,
    ) -> Result<Errors, Failure> {
        let medium = Medium::new(self.scene.grid, kappa_mm.to_vec(), mu_per_mm.to_vec())?;
        let mut difference = 0.0;
        each_source(
            &self.scene,
            medium,
            device,
            |_, _| {},
            |source, image| {
                let pairs = image.iter().zip(&self.bssrdf[source]);
                difference += pairs.map(|(a, t)| (a - f64::from(*t)).powi(2)).sum::<f64>();
            },
        )?;
        Ok(Errors {
            e: difference / self.energy,
            log_kappa: log_error(kappa_mm, self.coefficients.kappa_mm()),
            log_mu: log_error(mu_per_mm, self.coefficients.mu_per_mm()),
        })
    }

    /// The E that is left with the true κ and μ: what the solved grid itself gets wrong.
    ///
    /// # Errors
    /// As [`errors`](Self::errors).
    pub fn of_the_grid(&self, device: &mut Device) -> Result<f64, Failure> {
        let true_values = &self.coefficients;
        Ok(self.errors(true_values.kappa_mm(), true_values.mu_per_mm(), device)?.e)
    }

    pub fn kappa_mm(&self) -> &[f64] {
        self.coefficients.kappa_mm()
    }

    pub fn mu_per_mm(&self) -> &[f64] {
        self.coefficients.mu_per_mm()
    }
}

/// Root mean square of log(a/b).
pub(crate) fn log_error(a: &[f64], b: &[f64]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a / b).ln().powi(2));
    (squares.sum::<f64>() / a.len() as f64).sqrt()
}

/// The front face of `medium`, on the solved grid, under each cell of the lit face by itself.
fn each_source(
    scene: &Scene,
    medium: Medium,
    device: &mut Device,
    mut told: impl FnMut(usize, usize),
    mut take: impl FnMut(usize, &[f64]),
) -> Result<(), Failure> {
    let (coarse, grid): (Grid, Grid) = (scene.grid, *medium.grid());
    let all = coarse.face_len();
    let mut forward = Forward::new(medium, &scene.optics(), &mut device.solver)?;
    for (done, first) in (0..all).step_by(SOURCES).enumerate() {
        go_on()?;
        told(done, all.div_ceil(SOURCES));
        let sources = first..(first + SOURCES).min(all);
        let spot = |source: usize| {
            let mut map = vec![0.0; all];
            map[source] = 1.0;
            scene.upsampled(&grid, &map)
        };
        let light = Illuminations::new(&grid, scene.lit, sources.clone().map(spot).collect())?;
        let images = forward.images(&light, TOLERANCE)?;
        for (source, image) in sources.zip(images) {
            take(source, &average(&grid, &coarse, &image));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use diffusion::{CpuSolver, DeviceChoice, bssrdf_error};
    use material::Face;
    use simulator::{SampleKind, SampleSpec};

    /// E is that of `diffusion::bssrdf_error`, but for residuals of 1e-5 in both.
    #[test]
    fn e_is_the_one_that_verify_reckons() {
        for lit in [Face::Back, Face::Front] {
            let sample = SampleSpec { kind: SampleKind::Stone, seed: 2 };
            let scene = Scene::new(sample, 1, [9, 8, 4], lit).unwrap();
            let mut device = Device::open(&DeviceChoice::Cpu).unwrap();
            let truth = Truth::new(&scene, &mut device, |_, _| {}).unwrap();
            let kappa: Vec<f64> = truth.kappa_mm().iter().map(|k| 1.1 * k).collect();
            let found = truth.errors(&kappa, truth.mu_per_mm(), &mut device).unwrap();
            let medium = Medium::new(scene.grid, kappa, truth.mu_per_mm().to_vec()).unwrap();
            let (optics, fine) = (scene.optics(), scene.fine_truth().unwrap());
            let mut solver = CpuSolver::<f64>::new();
            let expected = bssrdf_error(
                (&medium, &optics, 1.0),
                (&fine, &optics),
                lit,
                &mut solver,
                1e-9,
                |_, _| true,
            );
            let expected = expected.unwrap();
            assert!((found.e / expected - 1.0).abs() < 1e-3, "{} {expected}", found.e);
            assert!((found.log_kappa - 1.1f64.ln()).abs() < 1e-9 && found.log_mu == 0.0);
            assert!(truth.of_the_grid(&mut device).unwrap() != found.e);
        }
    }
}
