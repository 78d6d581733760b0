//! Against closed forms. Seeds are fixed; a tolerance is some standard errors wide, and narrower
//! than what the mistakes that it is for would make.

use super::*;
use crate::SampleSpec;
use diffusion::{CpuSolver, Forward};
use material::{Face, Grid, Illumination};
use std::f64::consts::PI;

/// A slab of the same cells everywhere, as wide as it likes: its sides are mirrors.
fn slab(thickness: f64, albedo: f64, optics: &Optics, anisotropy: f64) -> MonteCarlo {
    // Cells of different edges: their order and scale count.
    let grid = Grid::new([2, 3, 10], [0.7, 1.1, thickness / 10.0]).unwrap();
    let medium = Medium::homogeneous(grid, 1.0 / 3.0, 1.0 - albedo).unwrap();
    MonteCarlo::new(&medium, &Optics { lateral: LateralBoundary::NoFlux, ..*optics }, anisotropy)
        .unwrap()
}

fn lit(block: &MonteCarlo, face: Face, photons: u64) -> TransportMap {
    let v = &block.voxels;
    let grid = Grid::new(v.cells, v.spacing_mm).unwrap();
    let light = Illuminations::new(&grid, face, vec![vec![1.0; grid.face_len()]]).unwrap();
    block.radiance(&light, photons, [7; 32]).unwrap().remove(0)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Scattered once, with the mirror images that the surfaces make of beam and camera:
/// L = α/(4π) ∫ F(t) G(t) dt over the optical depth t, F the fluence of the beam and G what gets
/// from there to the camera. At α = 1e-3 further scatterings add less than α; the noise is 3e-3.
#[test]
fn light_that_scatters_once_is_the_closed_form() {
    let (albedo, tau) = (1e-3, 1.5);
    for eta in [1.0, 1.5] {
        for face in [Face::Front, Face::Back] {
            let found =
                mean(&lit(&slab(tau, albedo, &Optics::from_eta(eta), 0.0), face, 400_000).radiance);
            let r = material::normal_reflectance(eta);
            let echo = 1.0 / (1.0 - r * r * (-2.0 * tau).exp());
            let reach = |t: f64| (1.0 - r) * echo * ((-t).exp() + r * (t - 2.0 * tau).exp());
            let steps = 1000;
            let integral: f64 = (0..steps)
                .map(|i| (f64::from(i) + 0.5) * tau / f64::from(steps))
                .map(|t| reach(if face == Face::Front { t } else { tau - t }) * reach(t))
                .sum::<f64>()
                * tau
                / f64::from(steps);
            let expected = albedo / (4.0 * PI) * integral / (eta * eta);
            assert!((found / expected - 1.0).abs() < 0.01, "{eta} {face:?}: {found} {expected}");
        }
    }
}

/// The same for a phase function with a direction: σs α/(4π) p(θ) without surfaces, forwards
/// where the block is lit from the back and backwards from the front.
#[test]
fn light_that_scatters_once_goes_where_the_phase_function_sends_it() {
    let (thickness, g) = (1.5, 0.4);
    let reduced = 1e-3;
    let block = slab(thickness, reduced, &Optics::from_eta(1.0), g);
    let scattering = reduced / (1.0 - g);
    let extinction = scattering + 1.0 - reduced;
    let tau = extinction * thickness;
    let phase = |cosine: f64| (1.0 - g * g) / (1.0 + g * g - 2.0 * g * cosine).powf(1.5);
    let forwards = scattering * thickness * (-tau).exp() * phase(1.0);
    let backwards = scattering / extinction * (1.0 - (-2.0 * tau).exp()) / 2.0 * phase(-1.0);
    for (face, expected) in [(Face::Back, forwards), (Face::Front, backwards)] {
        let found = mean(&lit(&block, face, 400_000).radiance) * 4.0 * PI;
        // Further scatterings: a few σs, sent more strongly forwards than the first.
        assert!((found / expected - 1.0).abs() < 0.015, "{face:?}: {found} {expected}");
    }
}

/// Black columns of different depth let exp(−τ) through and nothing else; 200 000 photons a column
/// tell that to 0.4 %, where one is given the light of another it is off by a third.
#[test]
fn what_only_absorbs_lets_through_what_lambert_and_beer_say() {
    let grid = Grid::new([3, 2, 4], [1.0, 2.0, 0.5]).unwrap();
    let mu: Vec<f64> = (0..grid.len()).map(|i| 0.2 + 0.3 * (i % 5) as f64).collect();
    let kappa = mu.iter().map(|mu| 1.0 / (3.0 * mu)).collect();
    let medium = Medium::new(grid, kappa, mu.clone()).unwrap();
    let block = MonteCarlo::new(&medium, &Optics::from_eta(1.0), 0.0).unwrap();
    for column in 0..6 {
        let one = (0..6).map(|c| f64::from(u8::from(c == column))).collect();
        let light = Illuminations::new(&grid, Face::Back, vec![one]).unwrap();
        let map = block.radiance(&light, 200_000, [3; 32]).unwrap().remove(0);
        let tau: f64 = (0..4).map(|z| 0.5 * mu[z * 6 + column]).sum();
        assert!(map.radiance.iter().all(|l| *l == 0.0));
        let found = map.balance.front * tau.exp();
        assert!((found - 1.0).abs() < 0.012, "{column}: {found}");
    }
}

/// Diffuse light through a conservative slab of 20 mean free paths (Milne): (4/3)/(20 + 2 · 0.7104);
/// and what leaves has the limb darkening of Chandrasekhar's H: L(1) = √3/4 H(1) J/π with
/// H(1) = 2.9078. Diffusion is 3e-3 off in the first and 26 % (Lambert) or 7e-3 (P1) in the second.
#[test]
fn a_thick_slab_is_milnes() {
    let optics = Optics { illumination: Illumination::Diffuse, ..Optics::from_eta(1.0) };
    let map = lit(&slab(20.0, 1.0, &optics, 0.0), Face::Back, 400_000);
    let through = (4.0 / 3.0) / (20.0 + 2.0 * 0.710_446);
    assert!((map.balance.front / through - 1.0).abs() < 0.01, "{:?}", map.balance);
    let darkening = mean(&map.radiance) * PI / map.balance.front;
    let known = 3.0_f64.sqrt() / 4.0 * 2.9078;
    assert!((darkening / known - 1.0).abs() < 0.005, "{darkening} {known}");
}

/// No light is lost or made: entered = absorbed + left + what roulette took, but for the rounding of
/// single precision in each collision; and on average roulette takes nothing.
#[test]
fn the_balance_is_even() {
    for (eta, g, albedo) in [(1.0, 0.0, 0.99), (1.4, 0.0, 0.9), (1.3, 0.8, 0.999)] {
        for face in [Face::Front, Face::Back] {
            let map = lit(&slab(8.0, albedo, &Optics::from_eta(eta), g), face, 100_000);
            let Balance { reflected, absorbed, front, back, sides, roulette } = map.balance;
            let sum = reflected + absorbed + front + back + sides;
            assert_eq!(sides, 0.0);
            assert!((sum - 1.0).abs() < 5e-3, "{eta} {face:?}: {:?}", map.balance);
            assert!((sum + roulette - 1.0).abs() < 1e-5, "{:?}", map.balance);
        }
    }
}

fn wax() -> (Medium, Illuminations) {
    let spec = SampleSpec { kind: crate::SampleKind::Wax, seed: 5 };
    let grid = spec.solved_grid();
    let [nx, ny, _] = grid.cells();
    let region = |i: usize| (i % nx * 4 / nx == 1) && (i / nx * 4 / ny == 2);
    let map = (0..nx * ny).map(|i| f64::from(u8::from(region(i)))).collect();
    (spec.medium(&grid, 0).unwrap(), Illuminations::new(&grid, Face::Back, vec![map]).unwrap())
}

/// One thread and several give the same bits; another seed others.
#[test]
fn maps_do_not_depend_on_threads() {
    let (medium, light) = wax();
    let block = MonteCarlo::new(&medium, &Optics::from_eta(1.4), 0.0).unwrap();
    let run = |threads: usize, seed: u8| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| block.radiance(&light, 6_400, [seed; 32]).unwrap().remove(0))
    };
    assert_eq!(run(1, 1), run(3, 1));
    assert_ne!(run(1, 1).radiance, run(1, 2).radiance);
}

/// Two estimates differ by what their standard errors say: the mean square of the difference over
/// its standard error is 1. 1600 cells, whose neighbours share photons, and the noise of the errors
/// themselves leave a few percent.
#[test]
fn standard_errors_tell_the_noise() {
    let (medium, light) = wax();
    let block = MonteCarlo::new(&medium, &Optics::from_eta(1.4), 0.0).unwrap();
    let [a, b] = [1, 2].map(|s| block.radiance(&light, 100_000, [s; 32]).unwrap().remove(0));
    let square = |c: usize| {
        let variance = a.standard_error[c].powi(2) + b.standard_error[c].powi(2);
        (a.radiance[c] - b.radiance[c]).powi(2) / variance
    };
    let n = a.radiance.len();
    let found = (0..n).map(square).sum::<f64>() / n as f64;
    assert!((found - 1.0).abs() < 0.12, "{found}");
}

/// Where light diffuses, a phase function with a direction and its reduced isotropic one look the
/// same, and as the diffusion equation has it, in absolute units. Diffusion itself is 0.6 % off at
/// most (docs/transport.md), half a mean free path a cell 0.5 %, the noise is 0.4 %.
#[test]
fn thick_bright_blocks_agree_with_diffusion() {
    let grid = Grid::new([2, 2, 24], [0.5; 3]).unwrap();
    let medium = Medium::homogeneous(grid, 1.0 / 3.0, 0.002).unwrap();
    for eta in [1.0, 1.3, 1.5] {
        let optics = Optics { lateral: LateralBoundary::NoFlux, ..Optics::from_eta(eta) };
        let light = Illuminations::new(&grid, Face::Back, vec![vec![1.0; 4]]).unwrap();
        let mut solver = CpuSolver::<f64>::new();
        let mut forward = Forward::new(medium.clone(), &optics, &mut solver).unwrap();
        let expected = mean(&forward.images(&light, 1e-8).unwrap()[0]);
        for g in [0.0, 0.6] {
            let block = MonteCarlo::new(&medium, &optics, g).unwrap();
            let found = mean(&block.radiance(&light, 400_000, [4; 32]).unwrap()[0].radiance);
            println!("η = {eta}, g = {g}: {}", found / expected);
            assert!((found / expected - 1.0).abs() < 0.02, "{eta} {g}: {found} {expected}");
        }
    }
}

#[test]
fn impossible_light_is_refused() {
    let grid = Grid::new([2, 2, 2], [1.0; 3]).unwrap();
    let optics = Optics::from_eta(1.0);
    let clear = Medium::homogeneous(grid, 1.0, 0.5).unwrap();
    let error = MonteCarlo::new(&clear, &optics, 0.0).err().unwrap();
    assert!(matches!(
        error,
        TransportError::NoScattering { kappa: 1.0, mu: 0.5, x: 0, y: 0, z: 0 }
    ));
    let medium = Medium::homogeneous(grid, 0.3, 0.01).unwrap();
    assert!(matches!(
        MonteCarlo::new(&medium, &optics, 1.0).err(),
        Some(TransportError::Anisotropy { .. })
    ));
    let block = MonteCarlo::new(&medium, &optics, 0.0).unwrap();
    let light = |map: [f64; 4]| Illuminations::new(&grid, Face::Front, vec![map.to_vec()]).unwrap();
    let negative = block.radiance(&light([0.0, 0.0, -1.0, 0.0]), 1000, [0; 32]).unwrap_err();
    assert_eq!(negative, TransportError::NegativeLight { pattern: 0, x: 0, y: 1 });
    let few = block.radiance(&light([1.0; 4]), 3, [0; 32]).unwrap_err();
    assert_eq!(few, TransportError::TooFewPhotons { found: 3 });
    // No light is not an error, and looks like nothing.
    let dark = block.radiance(&light([0.0; 4]), 1000, [0; 32]).unwrap().remove(0);
    assert_eq!((dark.radiance, dark.standard_error), (vec![0.0; 4], vec![0.0; 4]));
}
