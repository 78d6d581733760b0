//! Against matrices that are written out in full, on a grid of a hundred voxels.

use super::patch::Ladder;
use super::*;
use crate::inverse::smoothness::{OF_MU, squared_gradient};
use crate::{CpuSolver, Illuminations, Lambda, Work};

const SEED: u64 = 1990;

/// A front-lit block whose left half alone is looked at, unless `unmasked`.
struct Case {
    grid: Grid,
    optics: Optics,
    measurement: Measurement,
    settings: InverseSettings,
    found: Inverse,
}

impl Case {
    fn new(cells: [usize; 3], unmasked: bool, free_gain: bool) -> Self {
        let grid = Grid::new(cells, [0.8, 1.0, 0.7]).unwrap();
        let optics = Optics::from_eta(1.3);
        let light = Illuminations::regions(&grid, Face::Front, 2).unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let mut around = |value: f64| -> Vec<f64> {
            (0..grid.len()).map(|_| value * random.random_range(0.7..1.4)).collect()
        };
        let (kappa_mm, mu_per_mm) = (around(0.4), around(0.03));
        let medium = Medium::new(grid, kappa_mm.clone(), mu_per_mm.clone()).unwrap();
        let mut solver = CpuSolver::<f64>::new();
        let images =
            Forward::new(medium, &optics, &mut solver).unwrap().images(&light, 1e-12).unwrap();
        let variance = |image: &Vec<f64>| -> Vec<f64> {
            let seen = |i: usize| unmasked || i % cells[0] < cells[0] / 2;
            let pixel = |(i, l): (usize, &f64)| {
                if seen(i) { (0.02 * l).powi(2) } else { f64::INFINITY }
            };
            image.iter().enumerate().map(pixel).collect()
        };
        let variance: Vec<Vec<f64>> = images.iter().map(variance).collect();
        let measurement = Measurement::new(&grid, light, images, &variance).unwrap();
        let settings = InverseSettings {
            lambda: Lambda::Fixed(1e-4),
            free_gain,
            ..InverseSettings::default()
        };
        let found = Inverse {
            kappa_mm,
            mu_per_mm,
            homogeneous: (0.4, 0.03),
            gain: 1.1,
            fit: 0.0,
            chi2: 0.0,
            lambda: 1e-4,
            converged: true,
            work: Work::default(),
            history: Vec::new(),
        };
        Self { grid, optics, measurement, settings, found }
    }

    fn solved(&self) -> Solved<'_> {
        let Self { grid, optics, measurement, settings, found } = self;
        Solved { grid, optics, measurement, settings, found }
    }

    fn curvatures(&self, probes: usize, seed: u64) -> Vec<Curvature> {
        let mut solver = CpuSolver::<f64>::new();
        let ladder = Ladder::new(&self.grid);
        self.solved().curvatures(&ladder, probes, seed, &mut solver, |_, _| true).unwrap()
    }

    /// Weighted images of (log κ, log μ); with a free gain, the part that no gain makes up for.
    fn images(&self, u: &[f64]) -> Vec<f64> {
        let n = self.grid.len();
        let exp = |u: &[f64]| u.iter().map(|u| u.exp()).collect();
        let medium = Medium::new(self.grid, exp(&u[..n]), exp(&u[n..])).unwrap();
        let mut solver = CpuSolver::<f64>::new();
        let light = self.measurement.light();
        let mut forward = Forward::new(medium, &self.optics, &mut solver).unwrap();
        let images = forward.images(light, 1e-12).unwrap();
        let measurement = self.measurement.with_model_error(self.settings.model_error);
        let weight = measurement.weight().iter().flatten();
        let weighted = images.iter().flatten().zip(weight);
        weighted.map(|(l, w)| self.found.gain * l * w.sqrt()).collect()
    }

    /// H and P in full: H from central differences of the images.
    fn hessians(&self) -> [Vec<Vec<f64>>; 2] {
        let logs = self.found.kappa_mm.iter().chain(&self.found.mu_per_mm).map(|v| v.ln());
        let u: Vec<f64> = logs.collect();
        let base = self.images(&u);
        let norm = scalar(&base, &base);
        let column = |i: usize| -> Vec<f64> {
            let moved = |step: f64| {
                let mut u = u.clone();
                u[i] += step;
                self.images(&u)
            };
            let pairs = moved(1e-4).into_iter().zip(moved(-1e-4));
            let mut column: Vec<f64> = pairs.map(|(a, b)| (a - b) / 2e-4).collect();
            if self.settings.free_gain {
                let along = scalar(&column, &base) / norm;
                column.iter_mut().zip(&base).for_each(|(c, b)| *c -= along * b);
            }
            column
        };
        let j: Vec<Vec<f64>> = (0..u.len()).map(column).collect();
        let h = j.iter().map(|a| j.iter().map(|b| scalar(a, b)).collect()).collect();

        // R is a quadratic form: its derivative along a unit vector is a column of its Hessian.
        let (n, measurement) =
            (self.grid.len(), self.measurement.with_model_error(self.settings.model_error));
        let scale = 0.5 * self.found.lambda * measurement.weighted_energy();
        let mut p = vec![vec![0.0; 2 * n]; 2 * n];
        for (i, row) in p.iter_mut().enumerate() {
            let mut unit = vec![0.0; n];
            unit[i % n] = 1.0;
            let (half, counts) = if i < n { (&mut row[..n], 1.0) } else { (&mut row[n..], OF_MU) };
            squared_gradient(&self.grid, &unit, scale * counts, half);
        }
        [h, p]
    }
}

fn scalar(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn times(m: &[Vec<f64>], v: &[f64]) -> Vec<f64> {
    m.iter().map(|row| scalar(row, v)).collect()
}

/// A⁻¹ b by Gauss's elimination, A symmetric and positive definite.
fn eliminated(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for k in 0..n {
        let pivot = a[k].clone();
        for i in k + 1..n {
            let factor = a[i][k] / pivot[k];
            for j in k..n {
                a[i][j] -= factor * pivot[j];
            }
            b[i] -= factor * b[k];
        }
    }
    for k in (0..n).rev() {
        b[k] = (b[k] - scalar(&a[k][k + 1..], &b[k + 1..])) / a[k][k];
    }
    b
}

/// The patch of every voxel for every width, read off from products with unit vectors.
fn patches(grid: &Grid) -> Vec<Vec<Vec<f64>>> {
    let (ladder, n) = (Ladder::new(grid), grid.len());
    let mut out = vec![vec![vec![0.0; n]; n]; ladder.widths_mm().count()];
    for j in 0..n {
        let mut unit = vec![0.0; n];
        unit[j] = 1.0;
        for (out, products) in out.iter_mut().zip(ladder.products(&unit)) {
            out.iter_mut().zip(products).for_each(|(patch, value)| patch[j] = value);
        }
    }
    out
}

/// A patch in log κ (0) or in log μ (1), of both coefficients' unknowns.
fn within(patch: &[f64], which: usize) -> Vec<f64> {
    let mut b = vec![0.0; 2 * patch.len()];
    b[which * patch.len()..][..patch.len()].copy_from_slice(patch);
    b
}

/// What is constant in each slice stays, up to the rounding of f32. Two averages over 2 mm, three cells and
/// halves of two, take a voxel four cells to either side and no further.
#[test]
fn maps_are_averaged_within_slices() {
    let grid = Grid::new([16, 16, 3], [0.5, 0.5, 1.0]).unwrap();
    let ladder = Ladder::new(&grid);
    assert_eq!(ladder.widths_mm().collect::<Vec<_>>(), [1.0, 2.0, 4.0]);
    let slices: Vec<f32> = (0..grid.len()).map(|i| 1.0 + (i / 256) as f32).collect();
    let mut averaged = slices.clone();
    ladder.within_slices(1, &mut averaged);
    assert!(averaged.iter().zip(&slices).all(|(a, b)| (a / b - 1.0).abs() < 1e-6));
    let mut voxel = vec![0.0; grid.len()];
    voxel[256 + 8 * 16 + 8] = 1.0;
    ladder.within_slices(1, &mut voxel);
    // What it keeps along each axis: three times a quarter and twice an eighth, squared and summed.
    let kept: f32 = (3.0 * 0.0625 + 2.0 * 0.015625f32).powi(2);
    assert!((voxel[256 + 8 * 16 + 8] / kept - 1.0).abs() < 1e-6);
    for (i, value) in voxel.iter().enumerate() {
        let away = (i % 16).abs_diff(8).max((i / 16 % 16).abs_diff(8));
        // (1/8)⁴ where both halves meet, far above rounding's dust.
        assert_eq!(*value > 1e-6, i / 256 == 1 && away <= 4, "{i}: {value}");
    }
}

/// Each d comes from 1500 products with Gaussian tails: its relative standard error is at most
/// √(2/1500) = 3.7 %; of some 150 values, strongly correlated, the worst stays within 5 of them and the
/// mean of all within 1 (what the solves' tolerance and the differences add is below 1 %).
#[test]
fn probing_gives_the_curvatures_of_the_written_out_matrices() {
    for (unmasked, free_gain) in [(true, false), (false, false), (true, true)] {
        let case = Case::new([6, 4, 4], unmasked, free_gain);
        let n = case.grid.len();
        let [h, p] = case.hessians();
        let (probes, mut sum, mut count) = (1500, 0.0, 0.0);
        let error = (2.0 / probes as f64).sqrt();
        let curvatures = case.curvatures(probes, SEED);
        for (patches, curvature) in patches(&case.grid).iter().zip(&curvatures) {
            for which in 0..2 {
                for i in (0..n).step_by(5) {
                    let [b, other] = [which, 1 - which].map(|which| within(&patches[i], which));
                    let smooth = [&b, &other].map(|b| scalar(b, &times(&p, b)));
                    let data = [0, 1].map(|k| {
                        let b = [&b, &other][k];
                        scalar(b, &times(&h, b)) / smooth[k]
                    });
                    let found = f64::from(curvature.data[which][i]);
                    let off = found / data[0] - 1.0;
                    assert!(off.abs() < 5.0 * error, "{unmasked} {free_gain} {which} {i}: {off}");
                    let cross = scalar(&b, &times(&h, &other)) / (smooth[0] * smooth[1]).sqrt();
                    let off_cross = f64::from(curvature.cross[i]) - cross;
                    let off_cross = off_cross / (data[0] * data[1]).sqrt();
                    assert!(off_cross.abs() < 5.0 * error, "{which} {i}: {off_cross}");
                    sum += off;
                    count += 1.0;
                }
            }
        }
        eprintln!("unmasked {unmasked}, gain {free_gain}: mean {:.2e}", sum / count);
        assert!((sum / count).abs() < error, "{}", sum / count);
    }
}

/// What the answer holds of a patch, everything free to make up for everything, is never more than
/// d'/(d' + p), for every voxel; both from the written-out matrices, so up to rounding. Bounds near 0 and
/// near 1 both occur.
#[test]
fn no_patch_comes_back_better_than_the_bound() {
    let case = Case::new([6, 4, 4], true, false);
    let n = case.grid.len();
    let [h, p] = case.hessians();
    let sum: Vec<Vec<f64>> =
        h.iter().zip(&p).map(|(h, p)| h.iter().zip(p).map(|(h, p)| h + p).collect()).collect();
    let (mut low, mut high) = (1.0f64, 0.0f64);
    for patches in patches(&case.grid) {
        for which in 0..2 {
            for i in (0..n).step_by(7) {
                let [b, other] = [which, 1 - which].map(|which| within(&patches[i], which));
                let held = eliminated(sum.clone(), times(&h, &b));
                let roughness = times(&p, &b);
                let prior = scalar(&b, &roughness);
                let share = scalar(&held, &roughness) / prior;
                let d = |a: &[f64], b: &[f64]| scalar(a, &times(&h, b));
                let data = d(&b, &b) - d(&b, &other).powi(2) / (d(&other, &other) + prior);
                let bound = data / (data + prior);
                assert!(share < bound + 1e-6, "{which} {i}: {share} {bound}");
                low = low.min(bound);
                high = high.max(bound);
            }
        }
    }
    eprintln!("bounds from {low} to {high}");
    assert!(low < 0.1 && high > 0.9, "nothing was tried: {low} {high}");
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[values.len() / 2]
}

/// In a block that is lit and seen from the front, the finest detail of κ that is determined grows with
/// depth, and under the masked half it is coarser than under the other. The same seed repeats it, the
/// median change to the next one is that of two draws that are good to 15 % each: 0.67 · √2 · 15 %.
#[test]
fn deeper_and_masked_means_coarser() {
    let mut case = Case::new([12, 10, 10], false, false);
    case.found.lambda = 1e-5;
    let run = |case: &Case, seed| {
        let mut solver = CpuSolver::<f32>::new();
        case.solved().determination(16, seed, &mut solver, |_, _| true).unwrap().unwrap()
    };
    let map = run(&case, SEED);
    let [nx, ny, nz] = case.grid.cells();
    let layer = |z: usize, half: usize| {
        let seen = |i: &usize| i % nx / (nx / 2) == half;
        median((0..nx * ny).filter(seen).map(|i| map.kappa_mm[z * nx * ny + i]).collect())
    };
    let [depths, masked] = [0, 1].map(|half| (0..nz).map(|z| layer(z, half)).collect::<Vec<_>>());
    eprintln!("{depths:.2?}, masked {masked:.2?}");
    assert!(depths[nz / 2] > 1.2 * depths[0], "{depths:?}");
    assert!(depths[nz - 1] >= depths[nz / 2], "{depths:?}");
    assert!(masked[0] > 1.2 * depths[0], "{depths:?} {masked:?}");
    assert_eq!(run(&case, SEED), map);
    let other = run(&case, SEED + 1);
    let change =
        median(map.kappa_mm.iter().zip(&other.kappa_mm).map(|(a, b)| (a / b).ln().abs()).collect());
    eprintln!("median change with the seed {change:.3}");
    assert!(change < 0.14, "{change}");
}

#[test]
fn without_smoothness_there_is_nothing_to_weigh_against() {
    let mut case = Case::new([6, 4, 4], true, false);
    let mut solver = CpuSolver::<f32>::new();
    let stopped = case.solved().determination(2, SEED, &mut solver, |done, _| done < 1);
    assert_eq!(stopped, Err(InverseError::Interrupted));
    case.found.lambda = 0.0;
    let none = case.solved().determination(2, SEED, &mut solver, |_, _| true);
    assert_eq!(none, Ok(None));
    case.found.lambda = 1e-4;
    case.settings.method = Method::Paper;
    let none = case.solved().determination(2, SEED, &mut solver, |_, _| true);
    assert_eq!(none, Ok(None));
}

/// The whole way: a rough block is acquired from noisy pictures. Of patches with d' < p hardly anything
/// comes back (measured: 1 % of κ), of those with d' ≥ 10 p most (0.7); the limits leave what another seed
/// makes of it.
#[test]
fn what_is_not_determined_does_not_come_back() {
    let (grid, noise) = (Grid::new([16, 16, 8], [0.6, 0.6, 0.6]).unwrap(), 0.01);
    let n = grid.len();
    let ladder = Ladder::new(&grid);
    let mut random = ChaCha8Rng::seed_from_u64(1);
    // As rough at every width as the smoothness term expects: squared steps alike.
    let mut rough = |middle: f64| -> Vec<f64> {
        let mut u = vec![middle.ln(); n];
        for (k, width) in ladder.widths_mm().enumerate() {
            let noise: Vec<f64> = (0..n).map(|_| random.random_range(-1.0..1.0)).collect();
            let change = ladder.products(&noise).nth(k).unwrap();
            let rms = (scalar(&change, &change) / n as f64).sqrt();
            let size = 0.25 * (grid.spacing_mm()[0] / width).sqrt();
            u.iter_mut().zip(change).for_each(|(u, c)| *u += size / rms * c);
        }
        u
    };
    let truth = [rough(0.35), rough(0.02)];
    let exp = |u: &[f64]| u.iter().map(|u| u.exp()).collect::<Vec<f64>>();
    let optics = Optics::from_eta(1.3);
    let light = Illuminations::regions(&grid, Face::Back, 3).unwrap();
    let mut solver = CpuSolver::<f64>::new();
    let medium = Medium::new(grid, exp(&truth[0]), exp(&truth[1])).unwrap();
    let mut images =
        Forward::new(medium, &optics, &mut solver).unwrap().images(&light, 1e-9).unwrap();
    let mut variance = images.clone();
    for (l, v) in images.iter_mut().flatten().zip(variance.iter_mut().flatten()) {
        *v = (noise * *l).powi(2);
        let normal = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        *l *= 1.0 + noise * normal;
    }
    let measurement = Measurement::new(&grid, light, images, &variance).unwrap();
    let settings = InverseSettings::default();
    let found =
        crate::invert(&grid, &optics, &measurement, &settings, &mut solver, &mut |_| true).unwrap();
    eprintln!("fit {:.2e} chi2 {:.2} lambda {:.1e}", found.fit, found.chi2, found.lambda);
    let answer: Vec<f64> = found.kappa_mm.iter().map(|v| v.ln()).collect();
    let solved = Solved {
        grid: &grid,
        optics: &optics,
        measurement: &measurement,
        settings: &settings,
        found: &found,
    };
    let curvatures = solved.curvatures(&ladder, 16, SEED, &mut solver, |_, _| true).unwrap();
    // ⟨b, truth⟩⟨b, answer⟩ and ⟨b, truth⟩² of κ in the smoothness term's own scalar product.
    let pressed = |u: &Vec<f64>| {
        let mut out = vec![0.0; n];
        squared_gradient(&grid, u, 0.5, &mut out);
        out
    };
    let (true_u, found_u) = (pressed(&truth[0]), pressed(&answer));
    let (mut little, mut much) = ([0.0; 2], [0.0; 2]);
    let both = ladder.products(&true_u).zip(ladder.products(&found_u));
    for ((x, y), curvature) in both.zip(&curvatures) {
        let square = scalar(&x, &x);
        for i in 0..n {
            let ratio = curvature.ratio(0, i);
            let bin = if ratio < 1.0 { &mut little } else { &mut much };
            if !(1.0..DETERMINED).contains(&ratio) {
                *bin = [bin[0] + x[i] * y[i] / square, bin[1] + x[i] * x[i] / square];
            }
        }
    }
    let [little, much] = [little, much].map(|[xy, xx]| xy / xx);
    eprintln!("below 1: {little:.3}, above 10: {much:.3}");
    assert!(little < 0.1, "{little}");
    assert!(much > 0.5, "{much}");
}
