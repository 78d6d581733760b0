//! How light outside and fluence inside are tied together at the faces.

use material::{BoundaryConvention, Illumination, Optics, diffuse_reflectance, normal_reflectance};

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
    /// Share of the irradiance that enters as a collimated beam.
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
    /// - `transport`: the partial-current condition, with C =
    ///   [`material::partial_current_constant`]. Diffuse light enters with drive 4/(1 − R_φ) times
    ///   the transmitted irradiance η²(1 − R_φ) E (the η² law), so 4η². A
    ///   collimated beam loses Fresnel's share at normal incidence and becomes the first-scatter
    ///   source. Along the normal the P1 radiance inside is (φs + 3 Jₙ)/(4π) with
    ///   φs = Q + 2C Jₙ; it leaves with Fresnel's transmittance, divided by η².
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
                let (drive, beam) = match optics.illumination {
                    Illumination::Diffuse => (4.0 * eta2, 0.0),
                    Illumination::Collimated => (0.0, transmitted),
                };
                let leave = transmitted / eta2 / (4.0 * PI);
                Self {
                    boundary_constant: c,
                    drive,
                    beam,
                    exit_per_flux: leave * (2.0 * c + 3.0),
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

    /// The index-matched transport exit is 5 Jₙ/(4π).
    #[test]
    fn matched_transport_exit() {
        let s = SurfaceModel::new(&Optics::from_eta(1.0));
        assert!((s.exit_per_flux - 5.0 / (4.0 * std::f64::consts::PI)).abs() < 1e-15);
        assert_eq!((s.drive, s.beam), (0.0, 1.0));
    }
}
