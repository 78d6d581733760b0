//! A small veined block is found again from its images, and what cannot be is an error.

use diffusion::{
    Batch, CpuSolver, Forward, Gpu, GpuError, Illuminations, Inverse, InverseError,
    InverseSettings, Measurement, MeasurementError, Medium, Method, SolveError, Stage, average,
    bssrdf_error, invert, invert_from, invert_on_gpu,
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
        Grid::new([24, 24, 8], [0.5, 0.5, 0.45]).unwrap(),
        Grid::new([48, 48, 16], [0.25, 0.25, 0.225]).unwrap(),
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
    Illuminations::regions(grid, Face::Back, 4).unwrap()
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
    let (acquired, fine_truth) = ((&acquired, &optics, 1.0), (&truth, &optics));
    let e = bssrdf_error(acquired, fine_truth, Face::Back, &mut solver, 1e-6, |_, _| true).unwrap();
    let truth = block(&grid);
    [
        e,
        log_error(&found.kappa_mm, truth.kappa_mm()),
        log_error(&found.mu_per_mm, truth.mu_per_mm()),
    ]
}

/// The images carry 1 % noise per pixel, so
/// - the fit cannot be asked for less than NOISE² = 1e-4 less what the unknowns explain of the noise
///   (measured 6.9e-5 on both);
/// - E and the logs are the larger of the values measured on both (6.8e-4, 0.055, 0.20) with a third
///   to spare. Homogeneous blocks are off by 0.43 in log κ. μ is known less well: a slab of a few mean free paths loses
///   more light through its sides than to absorption.
///
/// Gives the error of log κ.
fn check_the_veined_block(found: &Inverse) -> f64 {
    let [e, kappa, mu] = errors(found);
    eprintln!(
        "fit {:.2e}, E {e:.2e}, log kappa {kappa:.3}, log mu {mu:.3}, lambda {:.1e}",
        found.fit, found.lambda
    );
    assert!(0.4 * NOISE * NOISE < found.fit && found.fit < 0.93 * NOISE * NOISE, "{}", found.fit);
    assert!(e < 9e-4, "{e:.2e}");
    assert!(kappa < 0.073, "{kappa}");
    assert!(mu < 0.27, "{mu}");
    assert!((1..=found.work.gradient_evaluations).contains(&found.history.len()));
    kappa
}

#[test]
fn the_default_method_finds_a_veined_block() {
    let found = find(1.0, &InverseSettings::default());
    let kappa = check_the_veined_block(&found);
    let start = vec![found.homogeneous.0; found.kappa_mm.len()];
    assert!(log_error(&start, block(&grids()[0]).kappa_mm()) > 2.0 * kappa);
    assert_eq!(found.gain, 1.0);
}

/// The GPU's single precision takes another path to as good a block: the limits are those of the CPU.
#[test]
fn the_gpu_finds_the_block_as_well() {
    let gpu = match Gpu::open(None) {
        Ok(gpu) => gpu,
        Err(error) => return println!("SKIPPED: {error}"),
    };
    let optics = Optics::from_eta(1.3);
    let (data, settings) = (measurement(&optics, 1.0), InverseSettings::default());
    let found =
        invert_on_gpu(None, &grids()[0], &optics, &data, &settings, &gpu, &mut |_| true).unwrap();
    check_the_veined_block(&found);
}

/// A device that is lost on the way is an error like any other, and the CPU goes on from the last
/// iterate: to as good a block, without doing again what was done.
#[test]
fn the_cpu_goes_on_where_a_gpu_was_lost() {
    let gpu = match Gpu::open(None) {
        Ok(gpu) => gpu,
        Err(error) => return println!("SKIPPED: {error}"),
    };
    let optics = Optics::from_eta(1.3);
    let (data, settings) = (measurement(&optics, 1.0), InverseSettings::default());
    let mut last = None;
    let mut observe = |p: &diffusion::Progress<'_>| {
        if p.cells == grids()[0].cells() && last.is_none() {
            last = p.iterate();
            gpu.give_up();
        }
        true
    };
    let lost = invert_on_gpu(None, &grids()[0], &optics, &data, &settings, &gpu, &mut observe);
    let lost = lost.map(|found| found.fit).unwrap_err();
    assert!(matches!(lost, InverseError::Solve(SolveError::Gpu(GpuError::Lost { .. }))), "{lost}");

    let last = last.unwrap();
    let done = last.work.gradient_evaluations;
    assert!(done > 10, "{done}");
    let mut coarse = 0;
    let mut observe = |p: &diffusion::Progress<'_>| {
        coarse += usize::from(p.cells != grids()[0].cells());
        true
    };
    let mut solver = CpuSolver::<f32>::new();
    let (grid, from) = (&grids()[0], Some(last));
    let found = invert_from(from, grid, &optics, &data, &settings, &mut solver, &mut observe);
    let found = found.unwrap();
    assert_eq!(coarse, 0);
    assert!(found.work.gradient_evaluations > done);
    check_the_veined_block(&found);
}

/// W08 stops at ε = 1e-4, which is the noise of these images: it is reached. Its material is
/// the worse one: E measured 3.0e-3, log κ off by 0.21 (a third to spare), and nothing holds μ
/// smooth.
#[test]
fn the_papers_method_reaches_its_own_stop() {
    let settings = InverseSettings { method: Method::Paper, ..InverseSettings::default() };
    let found = find(1.0, &settings);
    let [e, kappa, _] = errors(&found);
    eprintln!("fit {:.2e}, E {e:.2e}, log kappa {kappa:.3}", found.fit);
    assert!(found.fit <= 1e-4, "{}", found.fit);
    assert!(found.work.gradient_evaluations < settings.max_evaluations);
    assert!(e < 4e-3, "{e:.2e}");
    assert!(kappa < 0.28, "{kappa}");
}

/// Images that are all 1.2 times as bright give the same κ and μ and a gain 1.2 times as large:
/// the data term with its best gain does not know about scale, and only the single-precision
/// solves (1e-6) tell the two apart. From there the descents part, and both end where little is gained: at κ and μ
/// that differ by 0.021 and 0.033 (a third to spare). The gain itself is hardly told by the pictures: a skin that
/// absorbs dims all of them alike, and only the smoothness is against one. 1.048 was measured,
/// and it must not get worse; without a free gain, κ and μ would have to take up the 1.2.
#[test]
fn a_free_gain_takes_up_a_scale() {
    let free = InverseSettings { free_gain: true, ..InverseSettings::default() };
    let (bright, plain) = (find(1.2, &free), find(1.0, &free));
    assert!((plain.gain - 1.0).abs() < 0.06, "{}", plain.gain);
    assert!((bright.gain / plain.gain / 1.2 - 1.0).abs() < 2e-3, "{}", bright.gain);
    assert!(log_error(&bright.kappa_mm, &plain.kappa_mm) < 0.028);
    assert!(log_error(&bright.mu_per_mm, &plain.mu_per_mm) < 0.044);
    let fixed = find(1.2, &InverseSettings::default());
    assert!(log_error(&fixed.mu_per_mm, &plain.mu_per_mm) > 0.2);
}

/// The observer sees both stages and can stop either; budgets are kept.
#[test]
fn the_observer_can_stop_and_the_budget_holds() {
    let [grid, _] = grids();
    let optics = Optics::from_eta(1.3);
    let data = measurement(&optics, 1.0);
    let mut solver = CpuSolver::<f32>::new();
    for method in [Method::Lbfgs, Method::Paper] {
        let settings = InverseSettings { method, max_evaluations: 5, ..Default::default() };
        for stage in [Stage::Homogeneous, Stage::Volume] {
            let mut seen = 0;
            let mut observer = |p: &diffusion::Progress<'_>| {
                seen += 1;
                p.stage != stage
            };
            let stopped = invert(&grid, &optics, &data, &settings, &mut solver, &mut observer);
            assert_eq!(stopped.unwrap_err(), InverseError::Interrupted);
            assert!(seen > 0);
        }
        let found = invert(&grid, &optics, &data, &settings, &mut solver, &mut |_| true).unwrap();
        // On each of two grids.
        assert!(found.work.gradient_evaluations <= 10, "{}", found.work.gradient_evaluations);
        assert!(!found.converged);
    }
}

#[test]
fn measurements_that_say_nothing_are_refused() {
    let [grid, _] = grids();
    let make = |radiance: f64, variance: f64| {
        let maps = |value: f64| vec![vec![value; grid.face_len()]; 16];
        Measurement::new(&grid, regions(&grid), maps(radiance), &maps(variance)).map(|_| ())
    };
    assert_eq!(make(0.1, 1.0), Ok(()));
    assert_eq!(make(0.1, f64::INFINITY), Err(MeasurementError::AllMasked));
    // A masked pixel may hold anything.
    assert_eq!(make(f64::NAN, f64::INFINITY), Err(MeasurementError::AllMasked));
    assert_eq!(make(0.0, 1.0), Err(MeasurementError::AllZero));
    for (radiance, variance, name) in
        [(f64::NAN, 1.0, "radiance"), (0.1, f64::NAN, "variance"), (0.1, -1.0, "variance")]
    {
        match make(radiance, variance) {
            Err(MeasurementError::BadValue { array, pattern: 0, x: 0, y: 0, .. }) => {
                assert_eq!(array, name);
            }
            other => panic!("{other:?}"),
        }
    }
    let short = vec![vec![0.1; 3]; 16];
    let wrong = Measurement::new(&grid, regions(&grid), short.clone(), &short);
    assert!(matches!(wrong, Err(MeasurementError::WrongLength { expected: 576, found: 3, .. })));
}
