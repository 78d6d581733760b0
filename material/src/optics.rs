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

    /// Optics of a convention, with the C that belongs to it: [`partial_current_constant`] for
    /// `transport`, [`boundary_constant`] for the papers' own.
    pub fn with_boundary(eta: f64, boundary: BoundaryConvention) -> Self {
        let boundary_constant = match boundary {
            BoundaryConvention::Transport => partial_current_constant(eta),
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

/// C = (1 + R_J) / (1 − R_φ) of the Robin condition, from the partial currents of the P1 radiance
/// (φ + 3 J cos θ)/(4π) at a face that reflects by Fresnel's equations (Haskell et al. 1994,
/// section 3): R_φ = 2 ∫ R(μ) μ dμ of the fluence's part, R_J = 3 ∫ R(μ) μ² dμ of the flux's, over
/// the cosine μ inside, 0 to 1. Against transport this is within 0.6 % where
/// [`boundary_constant`] makes a slab 8 to 10 % too bright (docs/transport.md).
pub fn partial_current_constant(eta: f64) -> f64 {
    if eta <= 1.0 {
        return 1.0;
    }
    // Below the critical angle's cosine all is reflected. Above it the cosine outside is the
    // variable, o do = η² μ dμ: the integrands are smooth in it.
    let critical = (1.0 - 1.0 / (eta * eta)).sqrt();
    let (mut fluence, mut flux) = (critical.powi(2), critical.powi(3));
    const STEPS: u32 = 1000;
    for i in 0..STEPS {
        let outside = (f64::from(i) + 0.5) / f64::from(STEPS);
        let inside = (1.0 - (1.0 - outside * outside) / (eta * eta)).sqrt();
        let ratio = |a: f64, b: f64| ((a - b) / (a + b)).powi(2);
        let r = 0.5 * (ratio(eta * inside, outside) + ratio(eta * outside, inside));
        let weight = r * outside / (eta * eta * f64::from(STEPS));
        fluence += 2.0 * weight;
        flux += 3.0 * weight * inside;
    }
    (1.0 + flux) / (1.0 - fluence)
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

    /// R_eff = (C − 1)/(C + 1) is 0.431 at η = 1.33 and 0.493 at 1.4 (Haskell et al. 1994, table 1 and
    /// text), to the digits given; and nothing is reflected where there is no surface, towards
    /// which it goes without a step.
    #[test]
    fn partial_current_constant_is_haskells() {
        let reflectance = |eta: f64| {
            let c = partial_current_constant(eta);
            (c - 1.0) / (c + 1.0)
        };
        for (eta, known) in [(1.33, 0.431), (1.4, 0.493)] {
            assert!((reflectance(eta) - known).abs() < 1e-3, "{eta}: {}", reflectance(eta));
        }
        assert_eq!(partial_current_constant(1.0), 1.0);
        assert!((partial_current_constant(1.0 + 1e-6) - 1.0).abs() < 1e-2);
    }
}
