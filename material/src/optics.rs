//! How light gets in and out of the block: the boundary convention that κ and μ
//! were acquired under. Without it the numbers mean nothing in absolute units.

use serde::{Deserialize, Serialize};

/// One of the two large faces of the slab.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Face {
    /// z = 0, the face that the camera sees.
    Front,
    /// z = nz · hz, the far face.
    Back,
}

/// Which boundary condition and exit radiance relate light outside and fluence inside.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum BoundaryConvention {
    /// Matches radiative transport in absolute units: partial-current condition,
    /// first-scatter source for collimated light, P1 exit along the normal.
    #[default]
    Transport,
    /// Wang et al. 2008, equations (2) and (3), as printed.
    Wang2008,
    /// Wang et al. 2010, equations (2) and (4), as printed.
    Wang2010,
}

/// What the four side faces of the block do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LateralBoundary {
    /// A free block: Robin condition with no incoming light.
    #[default]
    Open,
    /// A window in a larger slab: no flux through the sides.
    NoFlux,
}

/// Angular shape of the light that arrives on the lit face.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Illumination {
    /// A projector's beam along the normal.
    #[default]
    Collimated,
    /// Lambertian light over the hemisphere.
    Diffuse,
}

/// The optical convention of a block, carried with every material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Optics {
    /// Refractive index of the block relative to air, ≥ 1.
    pub eta: f64,
    /// C of the Robin condition φ + 2Cκ ∂φ/∂n = q.
    pub boundary_constant: f64,
    /// Boundary condition and exit radiance.
    pub boundary: BoundaryConvention,
    /// Side faces.
    pub lateral: LateralBoundary,
    /// Shape of the incoming light.
    pub illumination: Illumination,
}

impl Optics {
    /// Optics with C derived from the refractive index by [`boundary_constant`].
    pub fn from_eta(eta: f64) -> Self {
        Self {
            eta,
            boundary_constant: boundary_constant(eta),
            boundary: BoundaryConvention::default(),
            lateral: LateralBoundary::default(),
            illumination: Illumination::default(),
        }
    }
}

/// Diffuse Fresnel reflectance F_dr at the inside of a face, from the refractive
/// index: F_dr = −1.440/η² + 0.710/η + 0.668 + 0.0636η (Egan & Hilgeman's fit, as
/// Jensen et al. 2001 use it). The fit gives 0.0016 at η = 1, where nothing is
/// reflected, so η = 1 returns exactly 0.
pub fn diffuse_reflectance(eta: f64) -> f64 {
    if eta <= 1.0 {
        return 0.0;
    }
    (-1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta).max(0.0)
}

/// C = (1 + F_dr) / (1 − F_dr) of the Robin condition.
pub fn boundary_constant(eta: f64) -> f64 {
    let f = diffuse_reflectance(eta);
    (1.0 + f) / (1.0 - f)
}

/// Fresnel reflectance at normal incidence, ((η − 1)/(η + 1))².
pub fn normal_reflectance(eta: f64) -> f64 {
    let r = (eta - 1.0) / (eta + 1.0);
    r * r
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of the fit at η = 1.3, computed by hand from the printed coefficients.
    #[test]
    fn boundary_constant_follows_the_fit() {
        assert!((diffuse_reflectance(1.3) - 0.4448).abs() < 5e-5);
        assert!((boundary_constant(1.3) - 2.602).abs() < 5e-4);
        assert_eq!(boundary_constant(1.0), 1.0);
    }
}
