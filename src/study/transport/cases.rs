//! What is looked at: slabs around one in the middle, one thing changed at a time.

use crate::Failure;
use diffusion::Medium;
use material::{Face, Grid, LateralBoundary};
use serde::Serialize;

/// What a case is there to show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Series {
    /// Thickness, albedo and refractive index of a window in a large slab.
    Slab,
    /// How large a cell may be.
    Cell,
    /// Free blocks, of different widths.
    Sides,
    /// Blocks with veins.
    Veins,
    /// Lit from the front.
    Front,
}

impl Series {
    pub fn name(self) -> &'static str {
        match self {
            Self::Slab => "slab",
            Self::Cell => "cell",
            Self::Sides => "sides",
            Self::Veins => "veins",
            Self::Front => "front",
        }
    }
}

/// One block and its light. Its mean free path 1/(μ + σs') is a millimetre, so all lengths are in
/// mean free paths; one region of 4 × 4 is lit, one from the middle of the face.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Case {
    pub series: Series,
    pub thickness: f64,
    /// σs'/(μ + σs'), outside of veins.
    pub albedo: f64,
    pub eta: f64,
    /// Edge of a cell.
    pub cell: f64,
    pub width: f64,
    pub lit: Face,
    pub sides: LateralBoundary,
    /// Sheets that scatter half as much again and absorb five times as much.
    pub veins: bool,
}

impl Default for Case {
    fn default() -> Self {
        Self {
            series: Series::Slab,
            thickness: 12.0,
            albedo: 0.99,
            eta: 1.0,
            cell: 0.5,
            width: 24.0,
            lit: Face::Back,
            sides: LateralBoundary::NoFlux,
            veins: false,
        }
    }
}

pub(crate) const THICKNESSES: [f64; 4] = [6.0, 12.0, 20.0, 40.0];
pub(crate) const ALBEDOS: [f64; 4] = [0.95, 0.98, 0.99, 0.999];
pub(crate) const INDICES: [f64; 3] = [1.0, 1.25, 1.5];

/// All cases, by series.
pub(crate) fn cases() -> Vec<Case> {
    let plain = Case::default();
    let mut out = Vec::new();
    for eta in INDICES {
        for albedo in ALBEDOS {
            out.extend(THICKNESSES.map(|thickness| Case { eta, albedo, thickness, ..plain }));
        }
    }
    let series = |series| Case { series, eta: 1.4, ..plain };
    for eta in [1.0, 1.4] {
        for cell in [0.25, 0.5, 1.0, 2.0] {
            out.push(Case { cell, eta, ..series(Series::Cell) });
        }
        for width in [12.0, 24.0, 48.0] {
            let sides = LateralBoundary::Open;
            out.push(Case { width, sides, eta, ..series(Series::Sides) });
        }
        for albedo in [0.95, 0.99, 0.999] {
            out.push(Case { albedo, eta, veins: true, ..series(Series::Veins) });
            let (lit, thickness) = (Face::Front, 20.0);
            out.push(Case { albedo, eta, lit, thickness, ..series(Series::Front) });
        }
    }
    out.sort_by_key(|case| case.series as u8);
    out
}

impl Case {
    /// Its grid, or one `refinement` times finer along each axis.
    pub fn grid(&self, refinement: usize) -> Result<Grid, Failure> {
        let cells = |length: f64| (length / self.cell).round() as usize * refinement;
        let across = cells(self.width);
        let h = self.cell / refinement as f64;
        Ok(Grid::new([across, across, cells(self.thickness)], [h; 3])?)
    }

    /// κ = 1/(3(σs' + μ)) and μ at the centres of a grid's cells.
    pub fn medium(&self, grid: &Grid) -> Result<Medium, Failure> {
        let [nx, ny, nz] = grid.cells();
        let (mut kappa, mut mu) = (Vec::with_capacity(grid.len()), Vec::with_capacity(grid.len()));
        for i in 0..nx * ny * nz {
            let vein = if self.veins {
                let [x, y, z] = grid.centre_mm(i % nx, i / nx % ny, i / (nx * ny));
                let sheet = (0.46 * x + 0.22 * y + 2.0 * (0.18 * y + 0.5 * z).sin()).sin();
                (-(sheet / 0.3).powi(2)).exp()
            } else {
                0.0
            };
            let absorption = (1.0 - self.albedo) * (1.0 + 4.0 * vein);
            let scattering = self.albedo * (1.0 + 0.5 * vein);
            kappa.push(1.0 / (3.0 * (absorption + scattering)));
            mu.push(absorption);
        }
        Ok(Medium::new(*grid, kappa, mu)?)
    }

    /// Irradiance of the lit face: 1 in the second region of the third row.
    pub fn region(&self, grid: &Grid) -> Vec<f64> {
        let [nx, ny, _] = grid.cells();
        let lit = |i: usize| i % nx * 4 / nx == 1 && i / nx * 4 / ny == 2;
        (0..nx * ny).map(|i| f64::from(u8::from(lit(i)))).collect()
    }
}
