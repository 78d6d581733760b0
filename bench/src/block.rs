//! The blocks that are solved: W08's four samples by size, in a veined marble of ours.

use diffusion::Medium;
use material::{Face, Grid};

/// A grid and its light.
pub(crate) struct Sample {
    pub cells: [usize; 3],
    pub lit: Face,
    /// What W08 needed for it on a GeForce 8800 GTX, hours.
    pub paper_h: Option<f64>,
}

/// W08 Table II.
pub(crate) const TABLE_II: [Sample; 4] = [
    Sample { cells: [130, 53, 37], lit: Face::Back, paper_h: Some(2.0) },
    Sample { cells: [140, 75, 48], lit: Face::Front, paper_h: Some(4.0) },
    Sample { cells: [256, 256, 20], lit: Face::Back, paper_h: Some(11.0) },
    Sample { cells: [128, 128, 41], lit: Face::Back, paper_h: Some(3.0) },
];

/// Cubes, from what fits a cache to what hardly fits the memory of a machine: time for an unknown should not
/// depend on it.
pub(crate) const CUBES: [Sample; 4] = [
    Sample { cells: [32; 3], lit: Face::Back, paper_h: None },
    Sample { cells: [64; 3], lit: Face::Back, paper_h: None },
    Sample { cells: [128; 3], lit: Face::Back, paper_h: None },
    Sample { cells: [256; 3], lit: Face::Back, paper_h: None },
];

/// Edge of a cell, mm: about half a mean free path of the marble.
const CELL_MM: f64 = 0.4;
/// Regions along each side of the lit face.
pub(crate) const REGIONS: usize = 4;

/// A grid of cubes.
pub(crate) fn grid(cells: [usize; 3], refinement: usize) -> Result<Grid, material::GridError> {
    Grid::new(cells.map(|n| n * refinement), [CELL_MM / refinement as f64; 3])
}

/// Marble with veins that scatter more and absorb more than what is around them; colour channels
/// 0, 1, 2 differ in both.
pub(crate) fn marble(grid: &Grid, channel: usize) -> Medium {
    let [nx, ny, _] = grid.cells();
    let (mut kappa, mut mu) = (Vec::with_capacity(grid.len()), Vec::with_capacity(grid.len()));
    let (base_kappa, base_mu) = ([0.30, 0.27, 0.24][channel], [0.004, 0.006, 0.009][channel]);
    for i in 0..grid.len() {
        let [x, y, z] = grid.centre_mm(i % nx, i / nx % ny, i / (nx * ny));
        let bend = 2.0 * (0.21 * y + 0.4 * z).sin() + 1.5 * (0.13 * x - 0.3 * z).cos();
        let vein = (-((0.35 * x - 0.2 * y + bend).sin() / 0.25).powi(2)).exp();
        let cloud = 0.1 * ((0.5 * x).sin() + (0.4 * y + 0.7 * z).cos());
        kappa.push(base_kappa * (cloud - 0.5 * vein).exp());
        mu.push(base_mu * (1.0 + 3.0 * vein) * (-cloud).exp());
    }
    // Both are exponentials of finite numbers.
    Medium::new(*grid, kappa, mu).expect("positive coefficients")
}
