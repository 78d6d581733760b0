//! A material as a `.npz`.

use std::path::Path;

use super::{NpzReader, write};
use crate::header::{Header, Optional};
use crate::{FileError, Material, Overwrite, Resolution, Surface};

/// Names of the arrays that only a material with a resolution has.
const RESOLUTION: [&str; 2] = ["kappa_resolution_mm", "mu_resolution_mm"];

/// Name of the array that only a material with a surface has.
const SURFACE: &str = "surface_reflectance";

impl Material {
    /// Writes the material for NumPy: `kappa` (mm) and `mu` (1/mm) as float32 of shape
    /// (channels, nz, ny, nx); `names` (channels); `gain` (channels); `spacing_mm` (hx, hy,
    /// hz); scalars `eta` and `C`; and `header`, a JSON text with these and the rest
    /// (boundary convention, lit face, provenance). Where it is known, the resolution of both in the
    /// shape of `kappa`, and `surface_reflectance` of shape (channels, ny, nx).
    ///
    /// # Errors
    /// The file is there already and `overwrite` refuses, or the system does.
    pub fn write_npz(&self, path: &Path, overwrite: Overwrite) -> Result<(), FileError> {
        let channels = self.channels();
        let [nx, ny, nz] = self.grid().cells();
        let shape = [channels.len(), nz, ny, nx];
        write(path, overwrite, |npz| {
            npz.parts_f32("kappa", &shape, channels.iter().map(|c| c.kappa_mm.as_slice()))?;
            npz.parts_f32("mu", &shape, channels.iter().map(|c| c.mu_per_mm.as_slice()))?;
            if let Some(resolution) = self.resolution() {
                let [kappa, mu] = RESOLUTION;
                let of_kappa = resolution.iter().map(|r| r.kappa_mm.as_slice());
                npz.parts_f32(kappa, &shape, of_kappa)?;
                npz.parts_f32(mu, &shape, resolution.iter().map(|r| r.mu_mm.as_slice()))?;
            }
            if let Some(surface) = self.surface() {
                let maps = surface.iter().map(|s| s.reflectance.as_slice());
                npz.parts_f32(SURFACE, &[channels.len(), ny, nx], maps)?;
            }
            let names: Vec<&str> = channels.iter().map(|c| c.name.as_str()).collect();
            npz.texts("names", &names)?;
            for (name, shape, values) in summary(&Header::of(self)) {
                npz.array_f64(name, &shape, &values)?;
            }
            npz.text("header", &serde_json::to_string(&Header::of(self))?)
        })
    }

    /// Reads what [`Material::write_npz`] wrote, also after `kappa` and `mu` were changed in
    /// Python and saved again (in any float type).
    ///
    /// # Errors
    /// The file cannot be read or is damaged, arrays are missing or have other shapes than
    /// the header says, `spacing_mm`, `gain`, `eta` or `C` disagree with the header, or the
    /// values are not a material's.
    pub fn read_npz(path: &Path) -> Result<Self, FileError> {
        Self::of_npz(NpzReader::open(path)?, path)
    }

    pub(crate) fn of_npz(mut npz: NpzReader, path: &Path) -> Result<Self, FileError> {
        let header: Header = serde_json::from_str(&npz.text("header")?).map_err(|e| {
            FileError::malformed(path, format!("array \"header\" cannot be understood: {e}"))
        })?;
        // Two places for one number: an edit of one alone must not go unnoticed.
        for (name, shape, expected) in summary(&header) {
            let found = npz.shaped(name, &shape)?;
            if found != expected {
                let reason =
                    format!("array {name:?}: the header says {expected:?}, found {found:?}");
                return Err(FileError::malformed(path, reason));
            }
        }
        let [nx, ny, nz] = header.grid.cells();
        let voxels = header.grid.len();
        let shape = [header.channels.len(), nz, ny, nx];
        let known = RESOLUTION.iter().any(|name| npz.contains(name));
        let lit = npz.contains(SURFACE);
        let mut parts = |name: &str, shape: &[usize], length: usize| {
            let values = npz.shaped(name, shape)?;
            let part = |part: &[f64]| part.iter().map(|&v| v as f32).collect::<Vec<f32>>();
            Ok::<_, FileError>(values.chunks_exact(length).map(part).collect::<Vec<_>>())
        };
        let surface = if lit {
            let maps = parts(SURFACE, &[header.channels.len(), ny, nx], nx * ny)?;
            Some(maps.into_iter().map(|reflectance| Surface { reflectance }).collect())
        } else {
            None
        };
        let mut volumes = |name: &str| parts(name, &shape, voxels);
        let (kappa, mu) = (volumes("kappa")?, volumes("mu")?);
        let resolution = if known {
            let (kappa, mu) = (volumes(RESOLUTION[0])?, volumes(RESOLUTION[1])?);
            let pairs = kappa.into_iter().zip(mu);
            Some(pairs.map(|(kappa_mm, mu_mm)| Resolution { kappa_mm, mu_mm }).collect())
        } else {
            None
        };
        header.material(kappa, mu, Optional { resolution, surface }, path)
    }
}

/// The numbers of the header that have arrays of their own, with their shapes.
fn summary(header: &Header) -> [(&'static str, Vec<usize>, Vec<f64>); 4] {
    let gain: Vec<f64> = header.channels.iter().map(|c| c.gain).collect();
    [
        ("spacing_mm", vec![3], header.grid.spacing_mm().to_vec()),
        ("gain", vec![gain.len()], gain),
        ("eta", vec![], vec![header.optics.eta]),
        ("C", vec![], vec![header.optics.boundary_constant]),
    ]
}
