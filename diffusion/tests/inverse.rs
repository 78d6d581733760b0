//! A small veined block is found again from its images, and what cannot be is an error.

use diffusion::{
    Batch, CpuSolver, Forward, Illuminations, Inverse, InverseError, InverseSettings, Measurement,
    MeasurementError, Medium, Method, Stage, average, bssrdf_error, invert,
};
use material::{Face, Grid, Optics};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SEED: u64 = 7;
/// Standard deviation of every pixel relative to its radiance.
const NOISE: f64 = 0.01;

/// The grid that is solved, and the one that the images come from: twice as fine in every axis,
/// so that the solved grid never sees its own discretisation (no inverse crime).
fn grids() -> [Grid; 2] {
    [
        Grid::new([16, 16, 6], [0.8, 0.8, 0.6]).unwrap(),
        Grid::new([32, 32, 12], [0.4, 0.4, 0.3]).unwrap(),
    ]
}

/// Veins that absorb more and scatter more than what is around them.
fn block(grid: &Grid) -> Medium {
    let [nx, ny, _] = grid.cells();
    let mut kappa = Vec::new();
    let mut mu = Vec::new();
    for i in 0..grid.len() {
        let [x, y, z] = grid.centre_mm(i % nx, i / nx % ny, i / (nx * ny));
        let vein = (-((x - 0.6 * y - 2.0) / 1.5).powi(2)).exp();
        kappa.push(0.28 * (-0.5 * vein).exp() * (1.0 + 0.1 * (0.8 * z + 0.5 * y).sin()));
        mu.push(0.01 * (1.0 + 2.0 * vein));
    }
    Medium::new(*grid, kappa, mu).unwrap()
}

/// One map for each of 4 × 4 regions of the back face.
fn regions(grid: &Grid) -> Illuminations {
    let [nx, ny, _] = grid.cells();
    let region = |i: usize| (i / nx) * 4 / ny * 4 + (i % nx) * 4 / nx;
    let map =
        |r: usize| (0..grid.face_len()).map(|i| f64::from(u8::from(region(i) == r))).collect();
    Illuminations::new(grid, Face::Back, (0..16).map(map).collect()).unwrap()
}

/// Noisy images of the fine block on the coarse grid, all times `gain`, and their variances.
fn images(optics: &Optics, gain: f64) -> [Vec<Vec<f64>>; 2] {
    let [grid, fine] = grids();
    let mut solver = CpuSolver::<f64>::new();
    let mut forward = Forward::new(block(&fine), optics, &mut solver).unwrap();
    let light = regions(&fine);
    let mut phi = Batch::zeros(fine.len(), light.count());
    forward.solve(&light, &mut phi, 1e-9).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    // Twelve uniform numbers: as good as normal within ± 3 sigma.
    let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
    let clean: Vec<Vec<f64>> = forward
        .exit_radiance(&light, &phi, Face::Front)
        .iter()
        .map(|image| average(&fine, &grid, image).iter().map(|l| gain * l).collect())
        .collect();
    let variance = clean.iter().map(|m| m.iter().map(|l| (NOISE * l).powi(2)).collect()).collect();
    let noisy = clean.iter().map(|m| m.iter().map(|l| l * (1.0 + NOISE * normal())).collect());
    [noisy.collect(), variance]
}

fn measurement(optics: &Optics, gain: f64) -> Measurement {
    let [radiance, variance] = images(optics, gain);
    Measurement::new(&grids()[0], regions(&grids()[0]), radiance, &variance).unwrap()
}

fn find(gain: f64, settings: &InverseSettings) -> Inverse {
    let optics = Optics::from_eta(1.3);
    let mut solver = CpuSolver::<f32>::new();
    let data = measurement(&optics, gain);
    invert(&grids()[0], &optics, &data, settings, &mut solver, &mut |_| true).unwrap()
}

/// Root mean square of log(a/b).
fn log_error(a: &[f64], b: &[f64]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (a / b).ln().powi(2));
    (squares.sum::<f64>() / a.len() as f64).sqrt()
}

/// E (design section 9) and the errors of log κ and log μ.
fn errors(found: &Inverse) -> [f64; 3] {
    let [grid, fine] = grids();
    let optics = Optics::from_eta(1.3);
    let mut solver = CpuSolver::<f32>::new();
    let acquired = Medium::new(grid, found.kappa_mm.clone(), found.mu_per_mm.clone()).unwrap();
    let truth = block(&fine);
    let (acquired, fine_truth) = ((&acquired, &optics), (&truth, &optics));
    let e = bssrdf_error(acquired, fine_truth, Face::Back, &mut solver, 1e-6, |_, _| true).unwrap();
    let truth = block(&grid);
    [
        e,
        log_error(&found.kappa_mm, truth.kappa_mm()),
        log_error(&found.mu_per_mm, truth.mu_per_mm()),
    ]
}

#[test]
fn the_default_method_finds_a_veined_block() {
    let found = find(1.0, &InverseSettings::default());
    let [e, kappa, mu] = errors(&found);
    let start = log_error(&vec![found.homogeneous.0; found.kappa_mm.len()], block(&grids()[0]).kappa_mm());
    eprintln!("DEFAULT fit {:.2e} chi2 {:.2} E {e:.2e} log kappa {kappa:.3} (start {start:.3}) log mu {mu:.3} evals {} gain {}", found.fit, found.chi2, found.gradient_evaluations, found.gain);
}

#[test]
fn the_papers_method_reaches_its_own_stop() {
    let settings = InverseSettings { method: Method::Paper, ..InverseSettings::default() };
    let found = find(1.0, &settings);
    let [e, kappa, mu] = errors(&found);
    eprintln!("PAPER fit {:.2e} E {e:.2e} log kappa {kappa:.3} log mu {mu:.3} evals {}", found.fit, found.gradient_evaluations);
}

#[test]
fn a_free_gain_takes_up_a_scale() {
    let free = InverseSettings { free_gain: true, ..InverseSettings::default() };
    let found = find(1.2, &free);
    let plain = find(1.0, &free);
    let [e, kappa, mu] = errors(&found);
    eprintln!("GAIN {} and {} E {e:.2e} {kappa:.3} {mu:.3} kappa diff {:.3} mu {:.3}", found.gain, plain.gain, log_error(&found.kappa_mm, &plain.kappa_mm), log_error(&found.mu_per_mm, &plain.mu_per_mm));
}
