//! The discrete adjoint against central differences and Taylor's theorem, in double precision.

use diffusion::{Batch, CpuSolver, Forward, Illuminations, Medium};
use material::{BoundaryConvention, Face, Grid, Illumination, LateralBoundary, Optics, Scheme};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SEED: u64 = 20080731;

struct Case {
    grid: Grid,
    optics: Optics,
    light: Illuminations,
    target: Vec<Vec<f64>>,
    kappa: Vec<f64>,
    mu: Vec<f64>,
}

fn cases() -> Vec<(String, Case)> {
    let grid = Grid::new([6, 5, 4], [0.8, 1.1, 0.6]).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut out = Vec::new();
    for boundary in
        [BoundaryConvention::Transport, BoundaryConvention::Wang2008, BoundaryConvention::Wang2010]
    {
        for (illumination, scheme) in [
            (Illumination::Collimated, Scheme::FiniteVolume),
            (Illumination::Diffuse, Scheme::FiniteVolume),
            (Illumination::Collimated, Scheme::Stam),
        ] {
            for (face, lateral) in
                [(Face::Back, LateralBoundary::Open), (Face::Front, LateralBoundary::NoFlux)]
            {
                let convention = Optics::from_eta(1.3);
                let optics = Optics { boundary, illumination, lateral, scheme, ..convention };
                let mut random = |lo: f64, hi: f64, n: usize| -> Vec<f64> {
                    (0..n).map(|_| rng.random_range(lo..hi)).collect()
                };
                let maps = (0..5).map(|_| random(0.0, 1.0, grid.face_len())).collect();
                let target = (0..5).map(|_| random(0.0, 0.05, grid.face_len())).collect();
                let case = Case {
                    grid,
                    optics,
                    light: Illuminations::new(&grid, face, maps).unwrap(),
                    target,
                    kappa: random(0.15, 0.6, grid.len()),
                    mu: random(0.005, 0.1, grid.len()),
                };
                let name = format!("{boundary:?} {illumination:?} {scheme:?} {face:?} {lateral:?}");
                out.push((name, case));
            }
        }
    }
    out
}

impl Case {
    /// Σ (L − target)², and the residual 2 (L − target).
    fn value(&self, kappa: &[f64], mu: &[f64]) -> f64 {
        self.evaluate(kappa, mu, false).0
    }

    fn evaluate(&self, kappa: &[f64], mu: &[f64], gradient: bool) -> (f64, Vec<f64>, Vec<f64>) {
        let medium = Medium::new(self.grid, kappa.to_vec(), mu.to_vec()).unwrap();
        let mut solver = CpuSolver::<f64>::new();
        let mut forward = Forward::new(medium, &self.optics, &mut solver).unwrap();
        let mut phi = Batch::zeros(self.grid.len(), self.light.count());
        forward.solve(&self.light, &mut phi, 1e-13).unwrap();
        let images = forward.exit_radiance(&self.light, &phi, Face::Front);
        let mut value = 0.0;
        let mut slope = images.clone();
        for (m, image) in images.iter().enumerate() {
            for (c, l) in image.iter().enumerate() {
                let r = l - self.target[m][c];
                value += r * r;
                slope[m][c] = 2.0 * r;
            }
        }
        if !gradient {
            return (value, Vec::new(), Vec::new());
        }
        let mut adjoint = Batch::zeros(self.grid.len(), self.light.count());
        let (g, _) = forward.gradient(&self.light, &phi, &slope, &mut adjoint, 1e-13).unwrap();
        (value, g.by_kappa, g.by_mu)
    }
}

/// Every cell, interior, edge and corner, for κ and for μ. Central differences with a relative
/// step of 1e-4 leave an error of second order (1e-8) and rounding of 1e-13/1e-4; 1e-6 of the
/// largest derivative leaves room for both and would not pass a missing boundary term, which
/// changes boundary cells by percents.
#[test]
fn gradient_agrees_with_central_differences_in_every_cell() {
    for (name, case) in cases() {
        let (_, by_kappa, by_mu) = case.evaluate(&case.kappa, &case.mu, true);
        for (what, gradient, which) in [("kappa", &by_kappa, 0), ("mu", &by_mu, 1)] {
            let base = [&case.kappa, &case.mu][which];
            let largest = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
            for i in 0..case.grid.len() {
                let step = 1e-4 * base[i];
                let at = |s: f64| {
                    let mut moved = [case.kappa.clone(), case.mu.clone()];
                    moved[which][i] += s;
                    case.value(&moved[0], &moved[1])
                };
                let difference = (at(step) - at(-step)) / (2.0 * step);
                let error = (gradient[i] - difference).abs() / largest;
                assert!(
                    error < 1e-6,
                    "{name}: d/d{what}[{i}]: {} against {difference}",
                    gradient[i]
                );
            }
        }
    }
}

/// J(p + h d) − J(p) − h ∇J·d falls with h²: halving h divides it by 4, to within the next order.
#[test]
fn taylor_remainder_is_of_second_order() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for (name, case) in cases() {
        let (value, by_kappa, by_mu) = case.evaluate(&case.kappa, &case.mu, true);
        let d_kappa: Vec<f64> =
            case.kappa.iter().map(|k| k * rng.random_range(-1.0..1.0)).collect();
        let d_mu: Vec<f64> = case.mu.iter().map(|m| m * rng.random_range(-1.0..1.0)).collect();
        let slope: f64 = by_kappa.iter().zip(&d_kappa).map(|(g, d)| g * d).sum::<f64>()
            + by_mu.iter().zip(&d_mu).map(|(g, d)| g * d).sum::<f64>();
        let remainder = |h: f64| {
            let moved = |v: &[f64], d: &[f64]| -> Vec<f64> {
                v.iter().zip(d).map(|(v, d)| v + h * d).collect()
            };
            (case.value(&moved(&case.kappa, &d_kappa), &moved(&case.mu, &d_mu)) - value - h * slope)
                .abs()
        };
        let order = (remainder(2e-3) / remainder(1e-3)).log2();
        assert!((order - 2.0).abs() < 0.02, "{name}: order {order}");
    }
}
