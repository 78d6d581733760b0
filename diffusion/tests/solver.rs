//! The linear solver keeps its promise: the residual that was asked for, on any grid, in either
//! precision, for any number of fields, or an error that says why not.

use diffusion::{Batch, CpuSolver, LinearSolver, Medium, Operator, Real, SolveError, SolveReport};
use material::{Grid, LateralBoundary, Optics};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SEED: u64 = 20080731;

/// Log-uniform κ of the given contrast, cell by cell (the roughest field there is).
fn operator(
    cells: [usize; 3],
    spacing: [f64; 3],
    contrast: f64,
    lateral: LateralBoundary,
) -> Operator {
    let grid = Grid::new(cells, spacing).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut field = |lo: f64, ratio: f64| -> Vec<f64> {
        (0..grid.len()).map(|_| lo * ratio.powf(rng.random::<f64>())).collect()
    };
    let (kappa, mu) = (field(0.01, contrast), field(0.001, 20.0));
    let medium = Medium::new(grid, kappa, mu).unwrap();
    Operator::new(&medium, &Optics { lateral, ..Optics::from_eta(1.3) })
}

fn random(cells: usize, count: usize) -> Batch {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 1);
    let mut b = Batch::zeros(cells, count);
    for field in 0..count {
        (0..cells).for_each(|i| b.set(field, i, rng.random_range(-1.0..1.0)));
    }
    b
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn solve<T: Real>(
    operator: &Operator,
    b: &Batch,
    tolerance: f64,
) -> Result<(Batch, SolveReport), SolveError> {
    let mut solver = CpuSolver::<T>::new();
    solver.prepare(operator.clone())?;
    let mut x = Batch::zeros(b.cells(), b.count());
    let report = solver.solve(b, &mut x, tolerance)?;
    Ok((x, report))
}

/// Largest ‖b − A x‖ / ‖b‖, worked out apart from the solver.
fn relative_residual(operator: &Operator, b: &Batch, x: &Batch) -> f64 {
    let r = operator.residual(b, x);
    (0..b.count()).map(|m| norm(&r.field(m)) / norm(&b.field(m))).fold(0.0, f64::max)
}

/// ‖x − y‖/‖y‖ is at most the condition number times the two residuals: about 1e3 · 2e-10
/// at contrast 1000 on this grid.
#[test]
fn both_precisions_reach_the_residual_and_agree() {
    let operator = operator([21, 18, 13], [0.5; 3], 1000.0, LateralBoundary::Open);
    let b = random(operator.len(), 6);
    let (single, report) = solve::<f32>(&operator, &b, 1e-10).unwrap();
    let (double, _) = solve::<f64>(&operator, &b, 1e-10).unwrap();
    for x in [&single, &double] {
        let reached = relative_residual(&operator, &b, x);
        assert!(reached <= 1e-10, "{reached:.1e}");
    }
    let said = (report.relative_residual, relative_residual(&operator, &b, &single));
    assert!((said.0 / said.1 - 1.0).abs() < 1e-6, "reported {} is {}", said.0, said.1);
    for m in 0..6 {
        let (s, d) = (single.field(m), double.field(m));
        let off: Vec<f64> = s.iter().zip(&d).map(|(s, d)| s - d).collect();
        assert!(norm(&off) < 2e-7 * norm(&d), "{m}: {:.1e}", norm(&off) / norm(&d));
    }
}

/// Iterations to 1e-6 stay bounded whatever the shape of grid and cells: the most measured here is
/// 7, and 10 leaves a third to spare. Diagonally preconditioned, the larger grids take over 60.
#[test]
fn any_grid_converges_in_bounded_iterations() {
    for cells in [
        [2, 2, 2],
        [3, 2, 5],
        [2, 2, 33],
        [65, 2, 3],
        [7, 5, 3],
        [17, 19, 23],
        [33, 32, 31],
        [64, 48, 20],
    ] {
        for hz in [0.2, 1.0, 5.0] {
            for lateral in [LateralBoundary::Open, LateralBoundary::NoFlux] {
                let operator = operator(cells, [1.0, 1.0, hz], 20.0, lateral);
                let b = random(operator.len(), 2);
                let (x, report) = solve::<f32>(&operator, &b, 1e-6)
                    .unwrap_or_else(|e| panic!("{cells:?} hz {hz} {lateral:?}: {e}"));
                assert!(relative_residual(&operator, &b, &x) <= 1e-6);
                assert!(
                    report.iterations <= 10,
                    "{cells:?} hz {hz} {lateral:?}: {}",
                    report.iterations
                );
            }
        }
    }
}

/// A field's answer does not depend on how many others are solved with it: every lane
/// has its own coefficients, and only the number of iterations is shared. Both answers are within
/// the tolerance, so they agree to the condition number (below 1e3) times 2e-9.
#[test]
fn a_batch_is_as_good_as_one_by_one() {
    let operator = operator([12, 9, 7], [0.5; 3], 20.0, LateralBoundary::Open);
    let all = random(operator.len(), 33);
    let single: Vec<Vec<f64>> = (0..33)
        .map(|m| {
            let mut b = Batch::zeros(operator.len(), 1);
            (0..operator.len()).for_each(|i| b.set(0, i, all.get(m, i)));
            solve::<f64>(&operator, &b, 1e-9).unwrap().0.field(0)
        })
        .collect();
    for count in [1, 4, 5, 16, 17, 33] {
        let mut b = Batch::zeros(operator.len(), count);
        for m in 0..count {
            (0..operator.len()).for_each(|i| b.set(m, i, all.get(m, i)));
        }
        let (x, report) = solve::<f64>(&operator, &b, 1e-9).unwrap();
        assert_eq!(report.right_hand_sides, count);
        for (m, alone) in single.iter().enumerate().take(count) {
            let off: Vec<f64> = x.field(m).iter().zip(alone).map(|(a, b)| a - b).collect();
            assert!(norm(&off) < 1e-6 * norm(alone), "{m} of {count}");
        }
    }
}

/// One thread or three: the same bits. The grid is large enough to be cut into several pieces.
#[test]
fn threads_do_not_change_the_answer() {
    let operator = operator([40, 30, 20], [0.5; 3], 75.0, LateralBoundary::Open);
    let b = random(operator.len(), 16);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| solve::<f32>(&operator, &b, 1e-7).unwrap())
    };
    assert_eq!(with(1), with(3));
}

/// Starting at the answer of nearly the same problem saves iterations.
#[test]
fn a_warm_start_needs_fewer_iterations() {
    let operator = operator([24, 20, 12], [0.5; 3], 75.0, LateralBoundary::Open);
    let b = random(operator.len(), 4);
    let mut solver = CpuSolver::<f32>::new();
    solver.prepare(operator).unwrap();
    let mut x = Batch::zeros(b.cells(), 4);
    let cold = solver.solve(&b, &mut x, 1e-6).unwrap().iterations;
    assert_eq!(solver.solve(&b, &mut x, 1e-6).unwrap().iterations, 0);
    for m in 0..4 {
        (0..b.cells()).for_each(|i| x.set(m, i, 1.001 * x.get(m, i)));
    }
    let warm = solver.solve(&b, &mut x, 1e-6).unwrap().iterations;
    assert!(0 < warm && 2 * warm <= cold + 1, "{warm} against {cold}");
}

/// Light on one face of a block 20 cells thick: single precision keeps to the true residual so well
/// that it needs no second run, and with that as many iterations as double. Rounding the
/// solution to single precision would leave a few 1e-6.
#[test]
fn single_precision_takes_no_more_iterations_than_double() {
    let operator = operator([24, 24, 20], [0.5; 3], 1000.0, LateralBoundary::Open);
    let mut b = Batch::zeros(operator.len(), 2);
    (0..24 * 24).for_each(|i| (0..2).for_each(|m| b.set(m, i, (1 + m) as f64)));
    for tolerance in [1e-6, 3e-7] {
        let (_, single) = solve::<f32>(&operator, &b, tolerance).unwrap();
        let (_, double) = solve::<f64>(&operator, &b, tolerance).unwrap();
        assert_eq!(single.iterations, double.iterations, "{tolerance}");
    }
}

/// Zeros are zeros, whether nobody wrote them, somebody did, or they were cleared.
#[test]
fn it_does_not_matter_who_wrote_the_zeros() {
    let operator = operator([24, 20, 12], [0.5; 3], 75.0, LateralBoundary::Open);
    let b = random(operator.len(), 20);
    let mut solver = CpuSolver::<f32>::new();
    solver.prepare(operator).unwrap();
    let mut fresh = Batch::zeros(b.cells(), 20);
    solver.solve(&b, &mut fresh, 1e-6).unwrap();
    let mut written = Batch::zeros(b.cells(), 20);
    written.set(19, 5, 0.0);
    solver.solve(&b, &mut written, 1e-6).unwrap();
    assert_eq!(fresh, written);
    written.clear();
    assert_eq!(written, Batch::zeros(b.cells(), 20));
    solver.solve(&b, &mut written, 1e-6).unwrap();
    assert_eq!(fresh, written);
}

/// A field of zeros beside others has the answer zero, whatever it starts from.
#[test]
fn a_field_without_light_stays_dark() {
    let operator = operator([6, 5, 4], [0.5; 3], 20.0, LateralBoundary::Open);
    let mut b = random(operator.len(), 3);
    (0..b.cells()).for_each(|i| b.set(1, i, 0.0));
    let mut solver = CpuSolver::<f32>::new();
    solver.prepare(operator.clone()).unwrap();
    let mut x = random(operator.len(), 3);
    solver.solve(&b, &mut x, 1e-8).unwrap();
    assert!(x.field(1).iter().all(|v| *v == 0.0));
    assert!(x.field(0).iter().all(|v| v.is_finite()) && norm(&x.field(2)) > 0.0);
}

#[test]
fn what_cannot_be_solved_is_an_error() {
    let operator = operator([12, 9, 7], [0.5; 3], 20.0, LateralBoundary::Open);
    let mut b = random(operator.len(), 18);
    let mut x = Batch::zeros(b.cells(), 18);
    let mut solver = CpuSolver::<f32>::new();
    assert_eq!(solver.solve(&b, &mut x, 1e-6), Err(SolveError::NotPrepared));
    solver.prepare(operator.clone()).unwrap();
    let wrong = SolveError::WrongSize { expected: 756, found: 755 };
    assert_eq!(solver.solve(&random(755, 1), &mut Batch::zeros(755, 1), 1e-6), Err(wrong));

    match solver.solve(&b, &mut x, 1e-30) {
        Err(SolveError::Stalled { wanted, reached, iterations, history }) => {
            assert_eq!((wanted, iterations), (1e-30, history.len()));
            assert!(reached < 1e-12, "stalls at the rounding of doubles, not at {reached:.1e}");
        }
        other => panic!("{other:?}"),
    }
    for bad in [f64::NAN, f64::INFINITY] {
        b.set(17, 100, bad);
        assert_eq!(solver.solve(&b, &mut x, 1e-6), Err(SolveError::NotFinite { field: 17 }));
    }
}
