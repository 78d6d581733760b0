//! The GPU backend keeps the promise of the CPU's, on whatever GPU there is (a software one will
//! do). Without one the tests say that they were skipped.

use diffusion::{
    Batch, CpuSolver, Forward, Gpu, GpuError, GpuSolver, Illuminations, LinearSolver, Medium,
    Operator, SolveError,
};
use material::{Face, Grid, LateralBoundary, Optics};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SEED: u64 = 20260731;

fn gpu() -> Option<Gpu> {
    match Gpu::open(None) {
        Ok(gpu) => {
            println!("runs on {}", gpu.name());
            Some(gpu)
        }
        Err(error) => {
            println!("SKIPPED: {error}");
            None
        }
    }
}

/// κ log-uniform over `contrast`, μ over 20, cell by cell: the roughest field there is.
fn rough(cells: [usize; 3], contrast: f64, rng: &mut ChaCha8Rng) -> Medium {
    let grid = Grid::new(cells, [0.5, 0.6, 0.4]).unwrap();
    let mut field = |lowest: f64, ratio: f64| -> Vec<f64> {
        (0..grid.len()).map(|_| lowest * ratio.powf(rng.random::<f64>())).collect()
    };
    let (kappa, mu) = (field(0.01, contrast), field(0.001, 20.0));
    Medium::new(grid, kappa, mu).unwrap()
}

fn regions(grid: &Grid, count: usize, rng: &mut ChaCha8Rng) -> Illuminations {
    let map =
        |_| (0..grid.face_len()).map(|_| f64::from(u8::from(rng.random::<f64>() < 0.2))).collect();
    let maps = (0..count).map(map).collect();
    Illuminations::new(grid, Face::Back, maps).unwrap()
}

/// Exit radiance on the GPU within 1e-5 of the CPU's, relative to the brightest value of each
/// pattern.
///
/// Solved to a residual of 1e-7: behind 40 cells of such rubble little light comes out, and
/// radiance is off by up to sixty times the residual, whoever solves.
#[test]
fn exit_radiance_is_the_cpus_on_rough_blocks() {
    let Some(gpu) = gpu() else { return };
    println!("seed {SEED}");
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let shapes = [[24, 20, 12], [17, 19, 23], [33, 32, 9], [40, 8, 15], [12, 12, 40]];
    let mut gpu = GpuSolver::new(gpu);
    let mut cpu = CpuSolver::<f64>::new();
    for (k, cells) in shapes.into_iter().chain(shapes).enumerate() {
        let contrast = [10.0, 30.0, 100.0, 300.0, 1000.0, 1000.0, 300.0, 100.0, 1000.0, 1000.0][k];
        let medium = rough(cells, contrast, &mut rng);
        let light = regions(medium.grid(), [16, 3, 7, 16, 21][k % 5], &mut rng);
        let lateral = if k % 2 == 0 { LateralBoundary::Open } else { LateralBoundary::NoFlux };
        let optics = Optics { lateral, ..Optics::from_eta(1.3) };
        fn images<S: LinearSolver>(
            medium: &Medium,
            optics: &Optics,
            light: &Illuminations,
            solver: &mut S,
            tolerance: f64,
        ) -> (usize, Vec<Vec<f64>>) {
            let mut forward = Forward::new(medium.clone(), optics, solver).unwrap();
            let mut fluence = Batch::zeros(medium.grid().len(), light.count());
            let report = forward.solve(light, &mut fluence, tolerance).unwrap();
            (report.iterations, forward.exit_radiance(light, &fluence, Face::Front))
        }
        let (iterations, found) = images(&medium, &optics, &light, &mut gpu, 1e-7);
        let (theirs, expected) = images(&medium, &optics, &light, &mut cpu, 1e-10);
        let mut worst = 0.0f64;
        for (found, expected) in found.iter().zip(&expected) {
            let brightest = expected.iter().fold(0.0f64, |a, l| a.max(l.abs()));
            for (f, e) in found.iter().zip(expected) {
                let off = (f - e).abs() / brightest;
                assert!(off <= 1e-5, "{cells:?} contrast {contrast}: off by {off:.1e}");
                worst = worst.max(off);
            }
        }
        println!(
            "{cells:?} contrast {contrast}: off by {worst:.1e}; {iterations} iterations, on the CPU {theirs}"
        );
    }
}

/// Any grid, any number of fields: the residual asked for, by the CPU's arithmetic in double
/// precision, from nothing and from a guess.
#[test]
fn any_grid_reaches_the_residual() {
    let Some(gpu) = gpu() else { return };
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 1);
    let mut solver = GpuSolver::new(gpu);
    let mut cpu = CpuSolver::<f32>::new();
    for cells in [[2, 2, 2], [4, 4, 4], [3, 2, 5], [2, 2, 33], [65, 2, 3], [70, 3, 9], [33, 32, 31]]
    {
        let medium = rough(cells, 20.0, &mut rng);
        let operator = Operator::new(&medium, &Optics::from_eta(1.4));
        solver.prepare(operator.clone()).unwrap();
        for count in [4, 5, 18] {
            let mut b = Batch::zeros(operator.len(), count);
            for field in 0..count {
                // Right-hand sides of very different size, and one of zeros.
                let size = if field == 2 { 0.0 } else { 10f64.powi(field as i32 - 8) };
                (0..operator.len())
                    .for_each(|i| b.set(field, i, size * rng.random_range(-1.0..1.0)));
            }
            let mut x = Batch::zeros(operator.len(), count);
            let report =
                solver.solve(&b, &mut x, 1e-6).unwrap_or_else(|e| panic!("{cells:?}: {e}"));
            // The same cycle as the CPU's: its iterations, and one for the residual's rounding. A
            // smoother with a wrong weight takes more.
            cpu.prepare(operator.clone()).unwrap();
            let mut y = Batch::zeros(operator.len(), count);
            let theirs = cpu.solve(&b, &mut y, 1e-6).unwrap().iterations;
            println!("{cells:?} x {count}: {} iterations, the CPU {theirs}", report.iterations);
            assert!(report.iterations <= theirs + 1, "{cells:?}: {} iterations", report.iterations);
            let r = operator.residual(&b, &x);
            let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
            for field in 0..count {
                let (r, b) = (norm(&r.field(field)), norm(&b.field(field)));
                assert!(r <= 1e-6 * b, "{cells:?} field {field}: {:.1e}", r / b);
            }
            let again = solver.solve(&b, &mut x, 1e-6).unwrap();
            println!(
                "{cells:?} x {count}: {} iterations, then {}",
                report.iterations, again.iterations
            );
            assert!(again.iterations <= 1);
        }
    }
}

#[test]
fn what_cannot_be_is_said() {
    let Err(GpuError::NoAdapter { wanted, .. }) = Gpu::open(Some("no such adapter")) else {
        panic!("an adapter of that name");
    };
    assert_eq!(wanted.as_deref(), Some("no such adapter"));
    let Some(gpu) = gpu() else { return };
    let mut solver = GpuSolver::new(gpu);
    let mut x = Batch::zeros(8, 1);
    assert_eq!(solver.solve(&x.clone(), &mut x, 1e-6), Err(SolveError::NotPrepared));
    let grid = Grid::new([2, 2, 2], [1.0; 3]).unwrap();
    let medium = Medium::homogeneous(grid, 0.3, 0.01).unwrap();
    solver.prepare(Operator::new(&medium, &Optics::from_eta(1.0))).unwrap();
    let mut b = Batch::zeros(8, 2);
    b.set(1, 3, f64::NAN);
    let mut x = Batch::zeros(8, 2);
    assert_eq!(solver.solve(&b, &mut x, 1e-6), Err(SolveError::NotFinite { field: 1 }));
    let mut short = Batch::zeros(7, 2);
    let wrong = SolveError::WrongSize { expected: 8, found: 7 };
    assert_eq!(solver.solve(&b, &mut short, 1e-6), Err(wrong));
}
