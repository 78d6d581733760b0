//! What the surface of a front-lit block sends back beside the light that scattered on its way
//! through: the diffuse reflectance of the surface itself, and light that scattered once.
//!
//! On lit cells of the front face
//!
//! ```text
//! L = gain · (L_multiple + (s + b) E) + ρ/π E
//! ```
//!
//! with L_multiple from the diffusion equation, E the irradiance, ρ the surface's diffuse
//! reflectance (W08, section 6.1), s the share of light that scattered once (the patent's L_s), and b
//! what the exit radiance of `wang2008` takes away where light comes in.

use std::f64::consts::PI;

use crate::{BoundaryConvention, Channel, Material, Optics, normal_reflectance};

/// How much of the light on it the surface itself reflects diffusely, in one channel: ρ of every
/// cell of the front face, x fastest, 0 where it reflects nothing. What a material has that was
/// lit from the front, where one picture had light on all of the face.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surface {
    /// ρ, dimensionless: a white Lambertian plane has 1.
    pub reflectance: Vec<f32>,
}

/// Radiance along the normal, for each unit of irradiance, of light that scattered once below a
/// surface cell with κ (mm) and μ (1/mm); 1/sr.
///
/// The patent (US 8 243 071, its equation for L_s) has σs F/(4π) ∫ L_i (n·ω) dω, scattering at the
/// surface point itself, where a length is missing: σs is per mm. Light along the normal of a half
/// space, T E below the surface, scatters isotropically at depth z and leaves along the normal:
///
/// ```text
/// s = T/η² ∫ σs'/(4π) T exp(−2 σt' z) dz = T²/η² · α/(8π),   α = σs'/σt' = 1 − 3κμ,
/// ```
///
/// T being Fresnel's transmittance at normal incidence, and 1/η² what radiance loses on its way
/// out of a denser medium. The length that was missing is 1/(2σt').
///
/// Under `transport` it is 0: there light that scattered once is a part of L_multiple, as the first
/// scattering of a beam is its source, and diffuse light enters it as a whole; the radiance of
/// what leaves has no order of scattering left out.
pub fn single_scattering(optics: &Optics, kappa_mm: f64, mu_per_mm: f64) -> f64 {
    match optics.boundary {
        BoundaryConvention::Transport => 0.0,
        BoundaryConvention::Wang2008 | BoundaryConvention::Wang2010 => {
            let transmitted = 1.0 - normal_reflectance(optics.eta);
            // An impossible voxel, 3κμ > 1, does not scatter.
            let albedo = (1.0 - 3.0 * kappa_mm * mu_per_mm).max(0.0);
            (transmitted / optics.eta).powi(2) * albedo / (8.0 * PI)
        }
    }
}

/// What lit cells lack of the radiance of multiple scattering, for each unit of irradiance; 1/sr.
///
/// W08 (3) has L = (φ − q)/(2π), the net flux: right where no light comes in, but below zero where it
/// does. What comes out there is φ/(2π), so q/(2π) is put back, q being E under `wang2008`. The other
/// conventions' exit radiances know of E themselves.
fn taken_away(optics: &Optics) -> f64 {
    match optics.boundary {
        BoundaryConvention::Wang2008 => 1.0 / (2.0 * PI),
        BoundaryConvention::Wang2010 | BoundaryConvention::Transport => 0.0,
    }
}

/// What follows from a channel's κ and μ, and from the convention, that lit cells have beside
/// L_multiple, for each unit of irradiance: gain · (s + b) of every cell of the front face, 1/sr.
pub fn lit_response(material: &Material, channel: &Channel) -> Vec<f64> {
    let optics = material.optics();
    let cells = channel.kappa_mm.iter().zip(&channel.mu_per_mm).take(material.grid().face_len());
    let both = |(kappa, mu): (&f32, &f32)| {
        let once = single_scattering(optics, f64::from(*kappa), f64::from(*mu));
        channel.gain * (once + taken_away(optics))
    };
    cells.map(both).collect()
}

impl Material {
    /// What is added to L_multiple on lit front cells for each unit of irradiance, gain · (s + b) + ρ/π
    /// in 1/sr, one list of front cells a channel; None for a material without a surface.
    pub fn surface_response(&self) -> Option<Vec<Vec<f64>>> {
        let response = |(channel, surface): (&Channel, &Surface)| {
            let known = lit_response(self, channel);
            let both = known.iter().zip(&surface.reflectance);
            both.map(|(known, rho)| known + f64::from(*rho) / PI).collect()
        };
        Some(self.channels().iter().zip(self.surface()?).map(response).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Illumination;

    /// Against the integral over depth, step by step down to 40 mean free paths, from σs' and σt'
    /// themselves. The midpoint rule is off by (2σt' dz)²/24 = 7e-8 of it.
    #[test]
    fn single_scattering_is_the_integral_over_depth() {
        for (eta, sigma_a, sigma_s) in [(1.0, 0.0, 1.7), (1.3, 0.4, 1.8), (1.5, 0.02, 0.3)] {
            let sigma_t = sigma_a + sigma_s;
            let (kappa, mu) = (1.0 / (3.0 * sigma_t), sigma_a);
            let enters: f64 = 4.0 * eta / ((1.0 + eta) * (1.0 + eta));
            let dz = 1e-3 / (2.0 * sigma_t);
            let steps = 80_000;
            let scattered = (0..steps).map(|i: u32| {
                let z = (f64::from(i) + 0.5) * dz;
                // As much on its way in as on its way out.
                sigma_s / (4.0 * PI) * (enters * (-sigma_t * z).exp()) * (-sigma_t * z).exp() * dz
            });
            let expected = scattered.sum::<f64>() * enters / (eta * eta);
            for boundary in [BoundaryConvention::Wang2008, BoundaryConvention::Wang2010] {
                let found = single_scattering(&Optics::with_boundary(eta, boundary), kappa, mu);
                assert!((found / expected - 1.0).abs() < 1e-6, "{eta}: {found}, {expected}");
            }
        }
    }

    /// Nothing is counted twice, and nothing is negative.
    #[test]
    fn transport_and_impossible_voxels_have_none() {
        for illumination in [Illumination::Collimated, Illumination::Diffuse] {
            let optics = Optics { illumination, ..Optics::from_eta(1.4) };
            assert_eq!(single_scattering(&optics, 0.2, 0.01), 0.0);
        }
        let wang = Optics::with_boundary(1.4, BoundaryConvention::Wang2008);
        assert_eq!(single_scattering(&wang, 1.0, 0.5), 0.0);
    }
}
