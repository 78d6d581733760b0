//! The acquired slab itself, relit by the diffusion equation that it was acquired under.

use diffusion::{
    Batch, CpuSolver, Forward, IlluminationError, Illuminations, Medium, MediumError, SolveError,
};
use material::{Face, Material};

/// Relative residual of the solve: a thousandth of what an eye or a camera tells apart.
const TOLERANCE: f64 = 1e-6;

/// Why a material cannot be relit.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RelightError {
    /// The coefficients make no medium.
    #[error(transparent)]
    Medium(#[from] MediumError),
    /// A pattern does not fit the lit face.
    #[error(transparent)]
    Light(#[from] IlluminationError),
    /// The solve failed.
    #[error(transparent)]
    Solve(#[from] SolveError),
}

/// Radiance of the front face under patterns of irradiance on the material's lit face.
///
/// `irradiance` holds one map of nx × ny values (x fastest, sample frame) a pattern, 1 being
/// projector white. Returns `[channel][pattern][cell]`, radiance along the normal in 1/sr times
/// the irradiance unit, with each channel's fitted gain applied. Where the material has a surface,
/// what that sends back is in it ([`surface_radiance`]).
///
/// # Errors
/// A map of another size than the lit face or with values that are not finite; a solve that does
/// not reach 1e-6.
pub fn relight(
    material: &Material,
    irradiance: &[Vec<f64>],
) -> Result<Vec<Vec<Vec<f64>>>, RelightError> {
    let grid = material.grid();
    let light = Illuminations::new(grid, material.lit_face(), irradiance.to_vec())?;
    let mut solver = CpuSolver::<f32>::new();
    let mut out = Vec::with_capacity(material.channels().len());
    for channel in material.channels() {
        let wide = |v: &[f32]| v.iter().map(|&x| f64::from(x)).collect();
        let medium = Medium::new(*grid, wide(&channel.kappa_mm), wide(&channel.mu_per_mm))?;
        let mut forward = Forward::new(medium, material.optics(), &mut solver)?;
        let mut fluence = Batch::zeros(grid.len(), light.count());
        forward.solve(&light, &mut fluence, TOLERANCE)?;
        let mut images = forward.exit_radiance(&light, &fluence, Face::Front);
        images.iter_mut().flatten().for_each(|l| *l *= channel.gain);
        out.push(images);
    }
    if let Some(surface) = surface_radiance(material, irradiance) {
        let sums = out.iter_mut().flatten().flatten();
        sums.zip(surface.iter().flatten().flatten()).for_each(|(l, s)| *l += s);
    }
    Ok(out)
}

/// The part of [`relight`]'s radiance that the surface of a front-lit material sends back beside
/// multiple scattering, (gain · (s + b) + ρ/π) E ([`Material::surface_response`]), in the same shape; None
/// for a material without a surface.
pub fn surface_radiance(
    material: &Material,
    irradiance: &[Vec<f64>],
) -> Option<Vec<Vec<Vec<f64>>>> {
    let lit = |response: &[f64], map: &Vec<f64>| -> Vec<f64> {
        response.iter().zip(map).map(|(r, e)| r * e).collect()
    };
    let channel = |response: Vec<f64>| irradiance.iter().map(|map| lit(&response, map)).collect();
    Some(material.surface_response()?.into_iter().map(channel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use material::{BoundaryConvention, Channel, Grid, Optics, Provenance, Surface};

    const CONVENTIONS: [BoundaryConvention; 3] =
        [BoundaryConvention::Transport, BoundaryConvention::Wang2008, BoundaryConvention::Wang2010];

    fn slab(gain: f64) -> Material {
        lit(Face::Back, Optics::from_eta(1.3), gain)
    }

    fn lit(face: Face, optics: Optics, gain: f64) -> Material {
        let grid = Grid::new([8, 6, 4], [0.5; 3]).unwrap();
        let channel = Channel {
            name: "G".into(),
            kappa_mm: vec![0.3; grid.len()],
            mu_per_mm: vec![0.01; grid.len()],
            gain,
        };
        Material::new(grid, vec![channel], optics, face, Provenance::default()).unwrap()
    }

    /// Light adds up: two halves of the face together give the whole, to the solver's residual.
    #[test]
    fn relighting_is_linear_and_gained() {
        let half = |left: bool| -> Vec<f64> {
            (0..48).map(|i| f64::from(u8::from((i % 8 < 4) == left))).collect()
        };
        let images = relight(&slab(1.0), &[half(true), half(false), vec![1.0; 48]]).unwrap();
        let doubled = relight(&slab(2.0), &[half(true)]).unwrap();
        for c in 0..48 {
            let [a, b, whole] = [0, 1, 2].map(|m| images[0][m][c]);
            assert!(whole > 0.0 && (a + b - whole).abs() < 1e-5 * whole, "{a} + {b} = {whole}");
            assert!((doubled[0][0][c] - 2.0 * a).abs() < 1e-9 * a);
        }
    }

    /// Lit cells get ρ/π E, and under the papers' convention what scatters once, which a channel's
    /// gain weighs as it does the rest; cells without light get nothing.
    #[test]
    fn the_surface_adds_to_lit_cells_alone() {
        use std::f64::consts::PI;
        let rho: Vec<f32> = (0..48).map(|i| 0.01 * i as f32).collect();
        let light: Vec<f64> = (0..48).map(|i| if i % 3 == 0 { 0.0 } else { 0.5 }).collect();
        for boundary in CONVENTIONS {
            let plain = lit(Face::Front, Optics::with_boundary(1.3, boundary), 1.5);
            let surface = vec![Surface { reflectance: rho.clone() }];
            let with = relight(
                &plain.clone().with_surface(surface).unwrap(),
                std::slice::from_ref(&light),
            );
            let (with, without) =
                (with.unwrap(), relight(&plain, std::slice::from_ref(&light)).unwrap());
            // T² α/(8π η²), T = 4η/(1 + η)² and α = 1 − 3 · 0.3 · 0.01, in single precision.
            let once = 1.5 * (4.0_f64 / 2.3 / 2.3).powi(2) * 0.991 / (8.0 * PI);
            let known = match boundary {
                BoundaryConvention::Transport => 0.0,
                BoundaryConvention::Wang2008 => once + 1.5 / (2.0 * PI),
                BoundaryConvention::Wang2010 => once,
            };
            for (i, (rho, e)) in rho.iter().zip(&light).enumerate() {
                let expected = e * (known + f64::from(*rho) / PI);
                let found = with[0][0][i] - without[0][0][i];
                assert!((found - expected).abs() < 1e-8, "{boundary:?} {i}: {found}, {expected}");
            }
        }
    }

    /// No convention takes more light away where it comes in than comes out there, and W08 (3), which
    /// does, is mended: a block under even light is nowhere darker than black, nor brighter than white.
    #[test]
    fn lit_cells_are_neither_darker_than_black_nor_brighter_than_white() {
        use std::f64::consts::PI;
        for boundary in CONVENTIONS {
            let block = lit(Face::Front, Optics::with_boundary(1.3, boundary), 1.0);
            let black = vec![Surface { reflectance: vec![0.0; 48] }];
            let images = relight(&block.with_surface(black).unwrap(), &[vec![1.0; 48]]).unwrap();
            for l in &images[0][0] {
                assert!(*l > 0.0 && *l < 1.0 / PI, "{boundary:?}: {l}");
            }
        }
    }

    #[test]
    fn a_map_of_another_size_is_refused() {
        let error = relight(&slab(1.0), &[vec![1.0; 47]]).unwrap_err();
        assert!(matches!(error, RelightError::Light(IlluminationError::WrongLength { .. })));
    }
}
