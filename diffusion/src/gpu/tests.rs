//! The objective on the GPU against the one on the CPU: kernels of the inverse problem and their
//! twins.

use super::krylov::Krylov;
use super::level::Hierarchy;
use super::{Gpu, OnGpu, upload};
use crate::inverse::{Device, Objective, Problem, Vector, WithSolver};
use crate::{Batch, CpuSolver, Forward, Illuminations, Measurement, Medium, Operator, cpu};
use material::{BoundaryConvention, Face, Grid, Illumination, LateralBoundary, Optics, Scheme};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SEED: u64 = 5;

fn gpu() -> Option<Gpu> {
    Gpu::open(None).map_err(|error| println!("SKIPPED: {error}")).ok()
}

/// Log-uniform coefficients over a decade about the given ones.
fn rough(grid: Grid, kappa: f64, mu: f64, rng: &mut ChaCha8Rng) -> Medium {
    let mut field = |middle: f64| -> Vec<f64> {
        (0..grid.len()).map(|_| middle * 10f64.powf(rng.random_range(-0.5..0.5))).collect()
    };
    let (kappa, mu) = (field(kappa), field(mu));
    Medium::new(grid, kappa, mu).unwrap()
}

fn problem(cells: [usize; 3], count: usize, optics: Optics, face: Face, gain: f64) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let grid = Grid::new(cells, [0.5, 0.6, 0.4]).unwrap();
    let map = |_| (0..grid.face_len()).map(|_| rng.random_range(0.0..1.0)).collect();
    let light = Illuminations::new(&grid, face, (0..count).map(map).collect()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 1);
    let medium = rough(grid, 0.3, 0.02, &mut rng);
    let mut solver = CpuSolver::<f64>::new();
    let mut forward = Forward::new(medium, &optics, &mut solver).unwrap();
    let mut fluence = Batch::zeros(grid.len(), count);
    forward.solve(&light, &mut fluence, 1e-10).unwrap();
    let mut radiance = forward.exit_radiance(&light, &fluence, Face::Front);
    let mut variance = radiance.clone();
    for (l, v) in radiance.iter_mut().flatten().zip(variance.iter_mut().flatten()) {
        *l *= gain * rng.random_range(0.9..1.1);
        // Every tenth pixel is masked.
        *v = if rng.random::<f64>() < 0.1 { f64::INFINITY } else { (0.02 * *l).powi(2) + 1e-12 };
    }
    let measurement = Measurement::new(&grid, light, radiance, &variance).unwrap();
    Problem { grid, optics, measurement, free_gain: gain != 1.0, edge: None }
}

/// Misfit, gradient and smoothness of both devices at the same point.
///
/// Single precision leaves 1e-5 of the misfit at a residual of 1e-6, and of the gradient 1.5e-5 of
/// its largest value at worst, which 1e-4 leaves room for; smoothness is held to rounding.
fn agree(gpu: &Gpu, problem: &Problem, what: &str) {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 2);
    let at = rough(problem.grid, 0.25, 0.03, &mut rng);
    let mut u: Vec<f64> =
        at.kappa_mm().iter().chain(at.mu_per_mm()).map(|v| f64::from(v.ln() as f32)).collect();
    // One cell beyond the range: it counts as at its end, and its derivative is 0.
    let centre = [0.25f64.ln(), 0.03f64.ln()];
    u[3] = centre[0] + 7.0;
    let mut solver = CpuSolver::<f64>::new();
    let mut on_cpu = WithSolver(&mut solver);
    let mut cpu = on_cpu.objective(problem).unwrap();
    let mut device = OnGpu(gpu);
    let mut gpu = device.objective(problem).unwrap();
    cpu.centre(centre);
    gpu.centre(centre);
    let v = gpu.vector(u.clone());
    let (expected, found) = (cpu.forward(&u, 1e-9).unwrap(), gpu.forward(&v, 1e-6).unwrap());
    for (name, e, f) in [
        ("weighted", expected.weighted, found.weighted),
        ("fit", expected.fit, found.fit),
        ("gain", expected.gain, found.gain),
    ] {
        assert!((f / e - 1.0).abs() < 1e-4, "{what}: {name} {f}, on the CPU {e}");
    }
    let (e, f) = (cpu.smoothness(&u), gpu.smoothness(&v));
    assert!((f.0 / e.0 - 1.0).abs() < 1e-5, "{what}: smoothness {}, on the CPU {}", f.0, e.0);
    let smooth = gpu.host(&f.1).unwrap();
    let largest = e.1.largest();
    for (e, f) in e.1.iter().zip(&smooth) {
        assert!((e - f).abs() < 1e-5 * largest, "{what}: smoothness' gradient {f}, {e}");
    }
    let (e, f) = (cpu.gradient(1e-9).unwrap(), gpu.gradient(1e-6).unwrap());
    let f = gpu.host(&f).unwrap();
    let n = problem.grid.len();
    for (name, range) in [("kappa", 0..n), ("mu", n..2 * n)] {
        let largest = e[range.clone()].iter().fold(0.0f64, |a, g| a.max(g.abs()));
        let off = range.map(|i| (e[i] - f[i]).abs()).fold(0.0, f64::max) / largest;
        println!("{what}: gradient by log {name} off by {off:.1e} of the largest");
        assert!(off < 1e-4, "{what}: gradient by log {name}");
    }
    assert_eq!(f[3], 0.0, "{what}: a cell beyond the range");
    assert_eq!(gpu.work().gradient_evaluations, 1);
}

#[test]
fn objective_is_its_twin_under_every_convention() {
    let Some(gpu) = gpu() else { return };
    println!("seed {SEED}");
    for (lateral, face, count, gain) in [
        (LateralBoundary::Open, Face::Back, 16, 1.0),
        (LateralBoundary::NoFlux, Face::Front, 3, 1.3),
        (LateralBoundary::Open, Face::Front, 21, 1.0),
    ] {
        for boundary in [
            BoundaryConvention::Transport,
            BoundaryConvention::Wang2008,
            BoundaryConvention::Wang2010,
        ] {
            for (illumination, scheme) in [
                (Illumination::Collimated, Scheme::FiniteVolume),
                (Illumination::Diffuse, Scheme::FiniteVolume),
                (Illumination::Collimated, Scheme::Stam),
            ] {
                let convention = Optics::with_boundary(1.3, boundary);
                let optics = Optics { lateral, illumination, scheme, ..convention };
                let what = format!(
                    "{boundary:?} {illumination:?} {scheme:?} {face:?} {lateral:?} x {count}"
                );
                agree(&gpu, &problem([9, 7, 6], count, optics, face, gain), &what);
            }
        }
    }
}

/// Neighbours in the rough block differ by up to 2.3 in their logarithms: below and beyond the edge.
#[test]
fn edges_are_kept_as_the_twin_keeps_them() {
    let Some(gpu) = gpu() else { return };
    let plain = problem([9, 7, 6], 3, Optics::from_eta(1.3), Face::Back, 1.0);
    agree(&gpu, &Problem { edge: Some(0.5), ..plain }, "edge of 0.5");
}

/// The preconditioner, kernel by kernel the CPU's: a conjugate gradient would hide a smoother with
/// a wrong weight behind an iteration more. Both are in single precision, six levels deep.
#[test]
fn v_cycle_is_its_twin() {
    let Some(gpu) = gpu() else { return };
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 3);
    for (cells, spacing) in [([4, 4, 4], 1.0), ([21, 18, 13], 1.0), ([40, 9, 17], 0.3)] {
        let grid = Grid::new(cells, [1.0, 1.0, spacing]).unwrap();
        let medium = rough(grid, 0.3, 0.02, &mut rng);
        let operator = Operator::new(&medium, &Optics::from_eta(1.3)).rounded();
        let r: Vec<[f32; 16]> =
            (0..grid.len()).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect();
        let expected = cpu::v_cycle(&operator, &r);
        let hierarchy = Hierarchy::new(&gpu, cells, grid.spacing_mm(), 4);
        let krylov = Krylov::new(&gpu, &hierarchy, 4);
        upload(&gpu, &hierarchy, &operator);
        let found = krylov.v_cycle(&gpu, r.as_flattened()).unwrap();
        let expected = expected.as_flattened();
        let largest = expected.iter().fold(0.0f32, |a, v| a.max(v.abs()));
        let off = found.iter().zip(expected).map(|(f, e)| (f - e).abs()).fold(0.0, f32::max);
        println!("{cells:?}: off by {:.1e} of the largest", off / largest);
        assert!(off < 1e-5 * largest, "{cells:?}: {:.1e}", off / largest);
    }
}

#[test]
fn vectors_do_what_vec_does() {
    let Some(gpu) = gpu() else { return };
    let problem = problem([9, 7, 6], 3, Optics::from_eta(1.0), Face::Back, 1.0);
    let mut device = OnGpu(&gpu);
    let objective = device.objective(&problem).unwrap();
    let n = 2 * problem.grid.len();
    let x: Vec<f64> = (0..n).map(|i| f64::from((i as f32 * 0.7).sin())).collect();
    let y: Vec<f64> = (0..n).map(|i| f64::from((i as f32 * 0.3).cos() - 1.5)).collect();
    let (gx, mut gy) = (objective.vector(x.clone()), objective.vector(y.clone()));
    // Sums of 756 terms in single precision.
    assert!((gx.dot(&gy) - x.dot(&y)).abs() < 1e-4);
    assert!((gx.dot(&gx) - x.dot(&x)).abs() < 1e-4);
    assert_eq!(gy.largest(), y.largest());
    let before = gy.clone();
    gy.add_scaled(0.25, &gx);
    gy.scale(-2.0);
    let found = objective.host(&gy).unwrap();
    for i in 0..n {
        assert!((found[i] + 2.0 * (y[i] + 0.25 * x[i])).abs() < 1e-6);
    }
    assert_eq!(objective.host(&before).unwrap(), y);
    // What is remembered in single precision serves as the vector itself does.
    let (kept, own) = (gx.keep(), x.keep());
    assert!((gy.dot_kept(&kept) - found.dot_kept(&own)).abs() < 1e-4);
    gy.add_kept(0.5, &kept);
    let moved = objective.host(&gy).unwrap();
    let mut expected = found.clone();
    expected.add_kept(0.5, &own);
    for (m, e) in moved.iter().zip(&expected) {
        assert!((m - e).abs() < 1e-6, "{m} {e}");
    }
}
