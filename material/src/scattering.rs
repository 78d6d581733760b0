//! From diffusion's κ and μ to a medium that scatters and absorbs, as renderers take it, and back.
//!
//! σa = μ, σs' = 1/(3κ) − μ, with an isotropic phase function (g = 0): the similarity relation
//! makes σs' stand for every g. Where 3κμ > 1 no medium has these coefficients: the fit has left
//! what the diffusion model can say.

use std::path::Path;

use crate::{Channel, FileError, Material};

/// What to do with voxels whose κ and μ no scattering medium has: 3κμ > 1, σs' < 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Impossible {
    /// Convert nothing and count them.
    #[default]
    Refuse,
    /// Give them σs' = 0: they absorb as they should and scatter not at all.
    Clamp,
}

/// The length that is 1 in a renderer's scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SceneUnit {
    /// 1 mm: the numbers are those of the material.
    #[default]
    Millimetre,
    /// 10 mm: Maya, Unreal.
    Centimetre,
    /// 1000 mm: Blender, Houdini, glTF.
    Metre,
}

impl SceneUnit {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Millimetre, Self::Centimetre, Self::Metre];

    /// Its length, mm.
    pub fn millimetres(self) -> f64 {
        match self {
            Self::Millimetre => 1.0,
            Self::Centimetre => 10.0,
            Self::Metre => 1000.0,
        }
    }

    /// `mm`, `cm` or `m`.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Metre => "m",
        }
    }
}

impl std::str::FromStr for SceneUnit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let unit = Self::ALL.into_iter().find(|unit| unit.symbol() == text);
        unit.ok_or_else(|| format!("expected mm, cm or m, found {text:?}"))
    }
}

/// Absorption and reduced scattering of one voxel, 1/mm: σa = μ, σs' = 1/(3κ) − μ (negative
/// where 3κμ > 1).
pub fn absorption_and_scattering(kappa_mm: f32, mu_per_mm: f32) -> (f64, f64) {
    let mu = f64::from(mu_per_mm);
    (mu, 1.0 / (3.0 * f64::from(kappa_mm)) - mu)
}

/// The way back: κ = 1/(3(σa + σs')) in mm and μ = σa in 1/mm.
pub fn diffusion_and_absorption(sigma_a: f64, sigma_s: f64) -> (f32, f32) {
    ((1.0 / (3.0 * (sigma_a + sigma_s))) as f32, sigma_a as f32)
}

/// How many voxels of a channel have 3κμ > 1.
pub fn impossible_voxels(channel: &Channel) -> usize {
    let values = channel.kappa_mm.iter().zip(&channel.mu_per_mm);
    values.filter(|&(&kappa, &mu)| absorption_and_scattering(kappa, mu).1 < 0.0).count()
}

/// A material as a renderer takes it: coefficients of scattering in the scene's own unit.
///
/// **The frame** is a renderer's: z points at the camera and y up, so that the block lies in the
/// box (0, 0, 0) … [`size`](Self::size) with the back face at z = 0, the front face at the largest
/// z and the top row of the camera's picture at the largest y. Going there is half a turn about the
/// x axis, cell (x, y, z) → (x, ny−1−y, nz−1−z): nothing is mirrored.
#[derive(Clone, Copy, Debug)]
pub struct ScatteringMedium<'a> {
    material: &'a Material,
    unit: SceneUnit,
    clamped: usize,
}

impl<'a> ScatteringMedium<'a> {
    /// The medium that a material is.
    ///
    /// # Errors
    /// [`FileError::Impossible`], about `path`, where some values are impossible and must not be
    /// clamped.
    pub fn of(
        material: &'a Material,
        unit: SceneUnit,
        impossible: Impossible,
        path: &Path,
    ) -> Result<Self, FileError> {
        let clamped = material.channels().iter().map(impossible_voxels).sum();
        if clamped > 0 && impossible == Impossible::Refuse {
            let of = material.channels().len() * material.grid().len();
            return Err(FileError::Impossible { path: path.into(), count: clamped, of });
        }
        Ok(Self { material, unit, clamped })
    }

    /// What it was made from.
    pub fn material(&self) -> &'a Material {
        self.material
    }

    /// The scene's unit of length.
    pub fn unit(&self) -> SceneUnit {
        self.unit
    }

    /// Values, voxels times channels, whose scattering was set to zero.
    pub fn clamped(&self) -> usize {
        self.clamped
    }

    /// Edges of a cell in the scene's unit, along x, y and z.
    pub fn spacing(&self) -> [f64; 3] {
        self.material.grid().spacing_mm().map(|mm| mm / self.unit.millimetres())
    }

    /// Edges of the block in the scene's unit.
    pub fn size(&self) -> [f64; 3] {
        self.material.grid().size_mm().map(|mm| mm / self.unit.millimetres())
    }

    /// Index into the material's arrays of the cell (x, y, z) of the renderer's frame.
    pub fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        let grid = self.material.grid();
        let [_, ny, nz] = grid.cells();
        grid.index(x, ny - 1 - y, nz - 1 - z)
    }

    /// σa and σs' of a channel at an index into the material's arrays, per scene unit.
    pub fn sigma(&self, channel: usize, index: usize) -> (f64, f64) {
        let channel = &self.material.channels()[channel];
        let (a, s) = absorption_and_scattering(channel.kappa_mm[index], channel.mu_per_mm[index]);
        (a * self.unit.millimetres(), s.max(0.0) * self.unit.millimetres())
    }

    /// Largest extinction σt of the channels at an index, per scene unit.
    pub fn density(&self, index: usize) -> f64 {
        let extinction = |c| {
            let (a, s) = self.sigma(c, index);
            a + s
        };
        (0..self.material.channels().len()).map(extinction).fold(0.0, f64::max)
    }

    /// Fails, about `path`, unless there is one channel or three: what renderers' colours are.
    pub(crate) fn one_or_three(&self, path: &Path, format: &str) -> Result<usize, FileError> {
        match self.material.channels().len() {
            channels @ (1 | 3) => Ok(channels),
            found => {
                let reason = format!("{format} holds 1 or 3 channels, found {found}");
                Err(FileError::CannotHold { path: path.into(), reason })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// σs' = 1/(3κ) − μ: κ = 1/3.03 and μ = 0.01 make σs' = 1; and back.
    #[test]
    fn the_mapping_is_the_one_of_diffusion_theory() {
        let (a, s) = absorption_and_scattering(1.0 / 3.03, 0.01);
        // κ and μ are f32: 1e-7 each.
        assert!((a - 0.01).abs() < 1e-8 && (s - 1.0).abs() < 3e-7, "{a} {s}");
        assert_eq!(diffusion_and_absorption(a, s), (1.0 / 3.03, 0.01));
    }

    #[test]
    fn units_are_read_as_they_are_written() {
        for unit in SceneUnit::ALL {
            assert_eq!(unit.symbol().parse(), Ok(unit));
        }
        assert!("inch".parse::<SceneUnit>().unwrap_err().contains("inch"));
    }
}
