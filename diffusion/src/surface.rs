//! How light outside and fluence inside are tied together at the faces.

use material::{
    BoundaryConvention, Illumination, Optics, diffuse_reflectance, normal_reflectance,
    surface_layer,
};

/// The numbers that a boundary convention comes down to.
///
/// Boundary: φ + 2Cκ ∂φ/∂n = `drive` · E, with E the irradiance that arrives on the face.
/// Volume source: `beam` · E enters as a collimated beam and scatters for the first time
/// inside. Exit: L = `exit_per_flux` · Jₙ + `exit_per_irradiance` · E, with Jₙ = −κ ∂φ/∂n.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceModel {
    /// C of the Robin condition.
    pub boundary_constant: f64,
    /// Fluence units at the boundary for each unit of irradiance.
    pub drive: f64,
    /// Share of the irradiance that enters as a collimated beam and becomes diffuse light.
    pub beam: f64,
    /// Radiance for each unit of outward flux, 1/sr.
    pub exit_per_flux: f64,
    /// Radiance for each unit of irradiance on the same spot, 1/sr.
    pub exit_per_irradiance: f64,
}

impl SurfaceModel {
    /// The model that `optics` names.
    ///
    /// - `wang2008`: W08 (2), (3): drive 1, L = (C/π) Jₙ.
    /// - `wang2010`: W10 (2), (4): drive 4T/(1 − F_dr), L = T/(4π) [(1 + 1/A) φs − 4q/(1 + F_dr)];
    ///   with φs = Q + 2A Jₙ that is L = T/(π(1 − F_dr)) (Jₙ + q), q = T E.
    /// - `transport`: what goes through the layer below the surface is that of Milne's problem
    ///   ([`material::surface_layer`]), with C = [`material::transport_constant`]. Diffuse light enters with
    ///   drive 4η²: in equilibrium the fluence inside is 4η² E (the η² law). A collimated beam
    ///   loses Fresnel's share at normal incidence and becomes the first-scatter source. Seen from far below,
    ///   that source, one mean free path deep on average, acts 1 + 2C/3 from where the fluence reaches
    ///   zero; transport has γ there, the layer's beam depth, so the beam is γ/(1 + 2C/3) as strong.
    ///   Along the normal the radiance inside is (Q + 3γ Jₙ)/(4π), where P1 has 3 + 2C in place of 3γ; it
    ///   leaves with Fresnel's transmittance, divided by η².
    pub fn new(optics: &Optics) -> Self {
        use std::f64::consts::PI;
        let c = optics.boundary_constant;
        let f = diffuse_reflectance(optics.eta);
        let transmitted = 1.0 - normal_reflectance(optics.eta);
        let eta2 = optics.eta * optics.eta;
        match optics.boundary {
            BoundaryConvention::Wang2008 => Self {
                boundary_constant: c,
                drive: 1.0,
                beam: 0.0,
                exit_per_flux: c / PI,
                exit_per_irradiance: 0.0,
            },
            BoundaryConvention::Wang2010 => Self {
                boundary_constant: c,
                drive: 4.0 / (1.0 - f) * transmitted,
                beam: 0.0,
                exit_per_flux: transmitted / PI / (1.0 - f),
                exit_per_irradiance: transmitted * transmitted / PI / (1.0 - f),
            },
            BoundaryConvention::Transport => {
                let depth = surface_layer(optics.eta).beam_depth;
                let (drive, beam) = match optics.illumination {
                    Illumination::Diffuse => (4.0 * eta2, 0.0),
                    Illumination::Collimated => (0.0, transmitted * depth / (1.0 + 2.0 * c / 3.0)),
                };
                let leave = transmitted / eta2 / (4.0 * PI);
                Self {
                    boundary_constant: c,
                    drive,
                    beam,
                    exit_per_flux: leave * 3.0 * depth,
                    exit_per_irradiance: leave * drive,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// W10 (4) evaluated directly for a surface fluence and an irradiance must equal the
    /// two-coefficient form; only rounding separates them.
    #[test]
    fn wang2010_exit_is_equation_4() {
        let optics = Optics::with_boundary(1.4, BoundaryConvention::Wang2010);
        let s = SurfaceModel::new(&optics);
        let (f, a) = (diffuse_reflectance(1.4), optics.boundary_constant);
        let t = 1.0 - normal_reflectance(1.4);
        let (phi_s, irradiance) = (3.7, 0.6);
        let q = t * irradiance;
        let printed =
            t / (4.0 * std::f64::consts::PI) * ((1.0 + 1.0 / a) * phi_s - 4.0 / (1.0 + f) * q);
        let flux = (phi_s - s.drive * irradiance) / (2.0 * a);
        let ours = s.exit_per_flux * flux + s.exit_per_irradiance * irradiance;
        assert!((printed - ours).abs() < 1e-14, "{printed} {ours}");
    }

    /// Without a surface the exit is √3 H(1) Jₙ/(4π) with Chandrasekhar's H(1) = 2.90781 (P1: 5 Jₙ/(4π)),
    /// and the beam is H(1)/√3 / 1.71045 (P1: 1), to the digits given.
    #[test]
    fn matched_transport_is_milnes() {
        let s = SurfaceModel::new(&Optics::from_eta(1.0));
        let exit = 3.0_f64.sqrt() * 2.90781 / (4.0 * std::f64::consts::PI);
        assert!((s.exit_per_flux / exit - 1.0).abs() < 1e-5, "{}", s.exit_per_flux);
        let beam = 2.90781 / 3.0_f64.sqrt() / 1.710_446;
        assert!((s.beam / beam - 1.0).abs() < 1e-5, "{}", s.beam);
        assert_eq!(s.drive, 0.0);
    }
}
