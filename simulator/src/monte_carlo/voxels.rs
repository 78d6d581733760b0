//! The block as the photons see it: extinction, albedo and the way up to the camera, cell by cell.

use super::TransportError;
use diffusion::Medium;

/// What a photon needs to know of the cell that it collides in, in one read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Voxel {
    /// Extinction over the majorant: the chance that a tentative collision is a real one.
    pub real: f32,
    /// Scattering over extinction.
    pub albedo: f32,
    /// Optical depth of the whole cell along z.
    pub depth: f32,
    /// Optical depth of what lies between the cell and the front face.
    pub above: f32,
}

/// Means of one layer of cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layer {
    /// μ + σs', 1/mm.
    pub reduced_extinction: f64,
    /// μ, 1/mm.
    pub absorption: f64,
    /// σs' over the first.
    pub albedo: f64,
}

/// The block.
pub(super) struct Voxels {
    pub cells: [usize; 3],
    pub spacing_mm: [f64; 3],
    /// Largest extinction of all cells, 1/mm.
    pub majorant: f32,
    pub voxels: Vec<Voxel>,
    /// Optical depth of every column from face to face.
    pub column: Vec<f32>,
    layers: Vec<Layer>,
}

impl Voxels {
    /// σs' = 1/(3κ) − μ, and σs = σs'/(1 − g): what a phase function of mean cosine g has to be
    /// given so that it diffuses as isotropic scattering with σs' does.
    pub fn new(medium: &Medium, anisotropy: f64) -> Result<Self, TransportError> {
        let grid = medium.grid();
        let (cells, spacing_mm) = (grid.cells(), grid.spacing_mm());
        let plane = grid.face_len();
        let [nx, ny, _] = cells;
        let mut coefficients = Vec::with_capacity(grid.len());
        for (i, (kappa, mu)) in medium.kappa_mm().iter().zip(medium.mu_per_mm()).enumerate() {
            let reduced = 1.0 / (3.0 * kappa) - mu;
            // The rounding of 1/(3κ) must not make a black cell an impossible one.
            if reduced < -1e-9 * mu {
                let (x, y, z) = (i % nx, i / nx % ny, i / plane);
                let (kappa, mu) = (*kappa, *mu);
                return Err(TransportError::NoScattering { kappa, mu, x, y, z });
            }
            coefficients.push((reduced.max(0.0) / (1.0 - anisotropy), *mu));
        }
        let extinction = |&(scattering, mu): &(f64, f64)| scattering + mu;
        let majorant = coefficients.iter().map(extinction).fold(0.0, f64::max);
        let mut column = vec![0.0; plane];
        let voxel = |(i, c): (usize, &(f64, f64))| {
            let total = extinction(c);
            let depth = total * spacing_mm[2];
            let above = column[i % plane];
            column[i % plane] += depth;
            Voxel {
                real: (total / majorant) as f32,
                albedo: (c.0 / total) as f32,
                depth: depth as f32,
                above: above as f32,
            }
        };
        let voxels = coefficients.iter().enumerate().map(voxel).collect();
        let layer = |cells: &[(f64, f64)]| {
            let mean = |value: &dyn Fn(&(f64, f64)) -> f64| {
                cells.iter().map(value).sum::<f64>() / cells.len() as f64
            };
            let absorption = mean(&|c| c.1);
            let reduced_extinction = mean(&|c| c.0 * (1.0 - anisotropy) + c.1);
            Layer { reduced_extinction, absorption, albedo: 1.0 - absorption / reduced_extinction }
        };
        Ok(Self {
            cells,
            spacing_mm,
            majorant: majorant as f32,
            voxels,
            column: column.into_iter().map(|tau| tau as f32).collect(),
            layers: coefficients.chunks(plane).map(layer).collect(),
        })
    }

    /// Means of the layers, front to back.
    pub fn layers(&self) -> &[Layer] {
        &self.layers
    }
}
