//! A small volume is found again from its images.

use diffusion::*;
use material::{Face, Grid, Optics};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const SEED: u64 = 7;

/// Truth on twice the resolution, images averaged down: the solved grid never sees its own
/// discretisation (no inverse crime).
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

fn regions(grid: &Grid, n: usize) -> Illuminations {
    let [nx, ny, _] = grid.cells();
    let maps = (0..n * n)
        .map(|r| {
            (0..grid.face_len())
                .map(|i| f64::from(u8::from((i / nx) * n / ny * n + (i % nx) * n / nx == r)))
                .collect()
        })
        .collect();
    Illuminations::new(grid, Face::Back, maps).unwrap()
}

fn images(grid: &Grid, fine: &Grid, optics: &Optics) -> Vec<Vec<f64>> {
    let mut solver = CpuSolver::<f64>::new();
    let mut forward = Forward::new(block(fine), optics, &mut solver).unwrap();
    let light = regions(fine, 4);
    let mut phi = Batch::zeros(fine.len(), 16);
    forward.solve(&light, &mut phi, 1e-9).unwrap();
    let images = forward.exit_radiance(&light, &phi, Face::Front);
    let (nx, fx) = (grid.cells()[0], fine.cells()[0]);
    images
        .iter()
        .map(|l| {
            (0..grid.face_len())
                .map(|i| {
                    let (x, y) = (2 * (i % nx), 2 * (i / nx));
                    (l[y * fx + x] + l[y * fx + x + 1] + l[(y + 1) * fx + x] + l[(y + 1) * fx + x + 1])
                        / 4.0
                })
                .collect()
        })
        .collect()
}

fn noisy(images: &[Vec<f64>], share: f64) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut normal = || -> f64 {
        use rand::RngExt;
        (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
    };
    let noisy = images.iter().map(|m| m.iter().map(|l| l * (1.0 + share * normal())).collect());
    let variance = images.iter().map(|m| m.iter().map(|l| (share * l).powi(2)).collect());
    (noisy.collect(), variance.collect())
}

#[test]
fn finds_a_veined_block_again() {
    let grid = Grid::new([16, 16, 6], [0.8, 0.8, 0.6]).unwrap();
    let fine = Grid::new([32, 32, 12], [0.4, 0.4, 0.3]).unwrap();
    let optics = Optics::from_eta(1.3);
    let (radiance, variance) = noisy(&images(&grid, &fine, &optics), 0.01);
    let measurement = Measurement::new(&grid, regions(&grid, 4), radiance, &variance).unwrap();
    let mut solver = CpuSolver::<f32>::new();
    for (method, model) in [(Method::Lbfgs, 1e-3), (Method::Lbfgs, 3e-3), (Method::Lbfgs, 1e-2), (Method::Lbfgs, 3e-2), (Method::Paper,0.0)] {
        let settings = InverseSettings { method, model_error: model, max_evaluations: 300, ..Default::default() };
        let t = std::time::Instant::now();
        let mut show = |_: &Progress| true;
        let found = invert(&grid, &optics, &measurement, &settings, &mut solver, &mut show).unwrap();
        let truth = block(&grid);
        let ft = block(&fine);
        let mean_log = |a: &[f64], b: &[f64]| {
            (a.iter().zip(b).map(|(a, b)| (a / b).ln().powi(2)).sum::<f64>() / a.len() as f64).sqrt()
        };
        let el = t.elapsed().as_secs_f64();
        let m = Medium::new(grid, found.kappa_mm.clone(), found.mu_per_mm.clone()).unwrap();
        let e = bssrdf_error((&m, &optics), (&ft, &optics), Face::Back, &mut solver, 1e-6, |_, _| true).unwrap();
        let e0 = bssrdf_error((&truth, &optics), (&ft, &optics), Face::Back, &mut solver, 1e-6, |_, _| true).unwrap();
        eprintln!("{method:?} {model} {:.1}s E {e:.2e} (truth on coarse {e0:.2e}) fit {:.2e} chi2 {:.2} lambda {:.1e} evals {} solves {} hom {:?} ek {:.3} em {:.3}", el, found.fit, found.chi2, found.lambda, found.gradient_evaluations, found.linear_solves, found.homogeneous, mean_log(&found.kappa_mm, truth.kappa_mm()), mean_log(&found.mu_per_mm, truth.mu_per_mm()));
    }
}
