//! The forward solve of a set-up: 16 illuminations to 1e-6, set-up included, in unknowns ×
//! right-hand sides per second.
//!
//! `cargo bench -p diaphane-diffusion`; with `DIAPHANE_BENCH_LARGE=1` also 256 × 256 × 20.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use diffusion::{Batch, CpuSolver, Forward, Illuminations, Medium};
use material::{BoundaryConvention, Face, Grid, Optics};

const PATTERNS: usize = 4;

/// Waves of contrast 10 in κ and 20 in μ, a dense inclusion (contrast 75 to its surroundings) and
/// a clear one: as hard as a veined stone gets.
fn block(grid: Grid) -> Medium {
    let cells = grid.cells().map(|n| n as f64);
    let [nx, ny, _] = grid.cells();
    let radius = 0.2 * cells[0].min(cells[1]).min(1.5 * cells[2]);
    let inside = |p: [f64; 3], share: [f64; 3]| {
        let square = |a: usize| (p[a] - share[a] * cells[a]).powi(2);
        (0..3).map(square).sum::<f64>() < radius * radius
    };
    let (mut kappa, mut mu) = (Vec::new(), Vec::new());
    for i in 0..grid.len() {
        let p @ [x, y, z] = [i % nx, i / nx % ny, i / (nx * ny)].map(|c| c as f64 + 0.5);
        let wave = |phase: f64| {
            let parts =
                (x / 5.0 + phase).sin() + (y / 4.0 - z / 6.0).cos() + (z / 3.5 + x / 9.0).sin();
            0.5 + parts / 6.0
        };
        let (mut k, mut m) = (0.15 * 10f64.powf(wave(0.0)), 0.001 * 20f64.powf(wave(2.0)));
        if inside(p, [0.35, 0.4, 0.5]) {
            k = 0.02;
        }
        if inside(p, [0.7, 0.65, 0.6]) {
            (k, m) = (3.0, 0.05);
        }
        kappa.push(k);
        mu.push(m);
    }
    Medium::new(grid, kappa, mu).expect("κ and μ are positive")
}

fn forward(c: &mut Criterion) {
    let mut grids = vec![[64, 64, 20], [130, 53, 37]];
    if std::env::var_os("DIAPHANE_BENCH_LARGE").is_some() {
        grids.push([256, 256, 20]);
    }
    let optics = Optics { boundary: BoundaryConvention::Wang2008, ..Optics::from_eta(1.3) };
    let mut group = c.benchmark_group("forward to 1e-6");
    group.sample_size(10);
    for cells in grids {
        let grid = Grid::new(cells, [1.0; 3]).expect("a valid grid");
        let (medium, light) = (
            block(grid),
            Illuminations::regions(&grid, Face::Back, PATTERNS).expect("maps fit the face"),
        );
        group.throughput(Throughput::Elements((grid.len() * light.count()) as u64));
        let [nx, ny, nz] = cells;
        let mut solver = CpuSolver::<f32>::new();
        group.bench_function(format!("{nx}x{ny}x{nz}"), |bencher| {
            bencher.iter(|| {
                let mut forward = Forward::new(medium.clone(), &optics, &mut solver)?;
                let mut fluence = Batch::zeros(grid.len(), light.count());
                forward.solve(&light, &mut fluence, 1e-6)
            });
        });
    }
    group.finish();
}

criterion_group!(benches, forward);
criterion_main!(benches);
