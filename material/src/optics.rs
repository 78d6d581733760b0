//! How light gets in and out of the block: the boundary convention that κ and μ
//! were acquired under. Without it the numbers mean nothing in absolute units.

use crate::milne::surface_layer;
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
    /// Matches radiative transport in absolute units: Milne's boundary, first-scatter source for
    /// collimated light, exit along the normal.
    #[default]
    Transport,
    /// Wang et al. 2008, equations (2) and (3), as printed.
    Wang2008,
    /// Wang et al. 2010, equations (2) and (4), as printed.
    Wang2010,
}

/// Which equation of κ and φ is discretised where κ varies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scheme {
    /// ∇·(κ∇φ) − μφ = 0, by conservative finite volumes.
    #[default]
    FiniteVolume,
    /// Δ(κφ) − μφ = 0: what the stencil of Wang et al. 2008, equation (8), after Stam 1995, comes
    /// to. Another equation where κ varies; to reproduce the paper.
    Stam,
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
    /// Diffusion equation inside; materials from before there was a choice have the default.
    #[serde(default, skip_serializing_if = "is_default")]
    pub scheme: Scheme,
}

fn is_default(scheme: &Scheme) -> bool {
    *scheme == Scheme::default()
}

impl Optics {
    /// Optics of the default convention, `transport`, with C derived from the refractive index.
    pub fn from_eta(eta: f64) -> Self {
        Self::with_boundary(eta, BoundaryConvention::default())
    }

    /// Optics of a convention, with the C that belongs to it: [`transport_constant`] for
    /// `transport`, [`boundary_constant`] for the papers' own.
    pub fn with_boundary(eta: f64, boundary: BoundaryConvention) -> Self {
        let boundary_constant = match boundary {
            BoundaryConvention::Transport => transport_constant(eta),
            BoundaryConvention::Wang2008 | BoundaryConvention::Wang2010 => boundary_constant(eta),
        };
        Self {
            eta,
            boundary_constant,
            boundary,
            lateral: LateralBoundary::default(),
            illumination: Illumination::default(),
            scheme: Scheme::default(),
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

/// C = (1 + F_dr) / (1 − F_dr) of the Robin condition, as Wang et al. have it: as if the light that
/// flows out and the light that is there were reflected alike.
pub fn boundary_constant(eta: f64) -> f64 {
    let f = diffuse_reflectance(eta);
    (1.0 + f) / (1.0 - f)
}

/// C of the Robin condition as radiative transport has it: where the straight line of the fluence reaches
/// zero, 2Cκ = 2C/3 mean free paths outside of the surface, it does so for Milne's problem
/// ([`surface_layer`]). The P1 partial currents (Haskell et al. 1994) come within 6 % of it and
/// [`boundary_constant`] within 20 %; what that does to pictures stands in docs/transport.md.
pub fn transport_constant(eta: f64) -> f64 {
    1.5 * surface_layer(eta).extrapolation
}

/// Fresnel reflectance of unpolarised light, from either side, at a surface of refractive index η: the mean of
/// ((η a − b)/(η a + b))² and ((η b − a)/(η b + a))², a and b the cosines inside and outside against the normal.
pub fn fresnel_reflectance(eta: f64, cos_inside: f64, cos_outside: f64) -> f64 {
    let ratio = |a: f64, b: f64| ((a - b) / (a + b)).powi(2);
    0.5 * (ratio(eta * cos_inside, cos_outside) + ratio(eta * cos_outside, cos_inside))
}

/// [`fresnel_reflectance`] along the normal, ((η − 1)/(η + 1))².
pub fn normal_reflectance(eta: f64) -> f64 {
    fresnel_reflectance(eta, 1.0, 1.0)
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
