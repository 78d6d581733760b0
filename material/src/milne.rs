//! Diffuse light near a flat surface, exactly: Milne's problem with a surface that reflects by Fresnel's
//! equations.
//!
//! Deep in a half-space that scatters isotropically and absorbs nothing, fluence falls on a straight line
//! towards the surface. Where that line reaches zero, and how much light leaves along the normal, is what a
//! diffusion equation needs to know of the layer in which light is not diffuse. Without a surface both are
//! classical (Chandrasekhar, Radiative Transfer, 1960, sections 13 and 36), by his function H:
//!
//! ```text
//! log H(μ) = −μ/π ∫₀^(π/2) log(1 − θ cot θ) / (cos²θ + μ² sin²θ) dθ
//! ```
//!
//! With one, what leaves upwards, I(μ), is H(μ) for the light from below, and what the half-space
//! gives back of the light that the surface reflects, R(μ) I(μ):
//!
//! ```text
//! I(μ) = H(μ) + ∫₀¹ ½ H(μ) H(μ') μ'/(μ + μ') R(μ') I(μ') dμ'
//! ```
//!
//! (the same, section 37), a linear system on a few nodes. Reflected light adds 2π√3 ∫ H μ R I dμ to the
//! fluence far below, and nothing to the flux. Held against Monte Carlo in docs/transport.md.

use crate::fresnel_reflectance;
use std::f64::consts::PI;

/// The layer below a surface, in mean free paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceLayer {
    /// How far outside of the surface the straight line of the fluence reaches zero.
    pub extrapolation: f64,
    /// How deep a beam along the normal lets all of its light in, seen from far below, counted from there;
    /// and, since light goes either way alike, 4π/3 of the radiance inside the surface along the normal for each
    /// unit of flux.
    pub beam_depth: f64,
}

/// The extrapolation without a surface: Hopf's constant.
const HOPF: f64 = 0.710_446_089_6;

/// Abscissae and weights of the Gauss–Legendre rule of eight nodes, those of one side.
const NODES: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_27),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// The layer below a surface of refractive index η, relative to outside; 1 or less is none.
pub fn surface_layer(eta: f64) -> SurfaceLayer {
    if eta <= 1.0 {
        let beam_depth = h_function(&[1.0])[0] / 3.0_f64.sqrt();
        return SurfaceLayer { extrapolation: HOPF, beam_depth };
    }
    below_surface(eta).0
}

/// The layer, and the share of the flux from below that leaves through the surface: all of it.
fn below_surface(eta: f64) -> (SurfaceLayer, f64) {
    // Below the critical cosine all is reflected. Above it the cosine outside is the variable, in which
    // Fresnel's reflectance is smooth: η² μ dμ = o do.
    let critical = (1.0 - 1.0 / (eta * eta)).sqrt();
    let nodes = || {
        NODES.into_iter().flat_map(|(x, w)| [(0.5 - 0.5 * x, 0.5 * w), (0.5 + 0.5 * x, 0.5 * w)])
    };
    let trapped = nodes().map(|(x, w)| (critical * x, critical * w, 1.0));
    let leaves = nodes().map(|(outside, w)| {
        let inside = (1.0 - (1.0 - outside * outside) / (eta * eta)).sqrt();
        let r = fresnel_reflectance(eta, inside, outside);
        (inside, w * outside / (eta * eta * inside), r)
    });
    // Cosine, weight and reflectance.
    let nodes: Vec<(f64, f64, f64)> = trapped.chain(leaves).collect();
    let cosines: Vec<f64> = nodes.iter().map(|n| n.0).collect();
    let (h, hs) = (h_function(&[1.0])[0], h_function(&cosines));
    let given_back = |cosine: f64, h: f64, radiance: &[f64]| -> f64 {
        let each = nodes.iter().zip(&hs).zip(radiance);
        each.map(|(((mu, w, r), other), i)| 0.5 * h * other * mu / (cosine + mu) * w * r * i).sum()
    };
    // Every pass is one more reflection, of which part leaves: it converges for any η.
    let mut radiance = hs.clone();
    loop {
        let next: Vec<f64> =
            cosines.iter().zip(&hs).map(|(mu, h)| h + given_back(*mu, *h, &radiance)).collect();
        let change = next.iter().zip(&radiance).map(|(a, b)| (a / b - 1.0).abs());
        let settled = change.fold(0.0, f64::max) < 1e-12;
        radiance = next;
        if settled {
            break;
        }
    }
    // ∫ H μ dμ = 2/√3.
    let flux = 4.0 * PI / 3.0_f64.sqrt();
    let reflected: f64 =
        nodes.iter().zip(&hs).zip(&radiance).map(|(((mu, w, r), h), i)| h * mu * w * r * i).sum();
    let leaves: f64 =
        nodes.iter().zip(&radiance).map(|((mu, w, r), i)| mu * w * (1.0 - r) * i).sum();
    let layer = SurfaceLayer {
        extrapolation: HOPF + 2.0 * PI * 3.0_f64.sqrt() * reflected / (3.0 * flux),
        beam_depth: 4.0 * PI / 3.0 * (h + given_back(1.0, h, &radiance)) / flux,
    };
    (layer, 2.0 * PI * leaves / flux)
}

/// Chandrasekhar's H for isotropic scattering without absorption.
fn h_function(cosines: &[f64]) -> Vec<f64> {
    const STEPS: u32 = 1000;
    // θ = (π/2) (1 − (1 − s³)²): small steps at 0, where the logarithm is singular, and at π/2, where the
    // denominator of a small μ is.
    let terms: Vec<(f64, f64, f64)> = (0..STEPS)
        .map(|i| {
            let s = (f64::from(i) + 0.5) / f64::from(STEPS);
            let cube = s.powi(3);
            let theta = 0.5 * PI * cube * (2.0 - cube);
            let weight = 3.0 * PI * s * s * (1.0 - cube) / f64::from(STEPS);
            let square = theta * theta;
            // 1 − θ cot θ, which cancels where θ is small.
            let less = if theta < 0.01 {
                square / 3.0 * (1.0 + square / 15.0)
            } else {
                1.0 - theta / theta.tan()
            };
            (theta.cos().powi(2), theta.sin().powi(2), weight * less.ln())
        })
        .collect();
    let of = |mu: &f64| {
        let sum: f64 = terms.iter().map(|(cos2, sin2, term)| term / (cos2 + mu * mu * sin2)).sum();
        (-mu / PI * sum).exp()
    };
    cosines.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// H as tabulated by Chandrasekhar (1960, table XI, ϖ = 1), to its five digits.
    #[test]
    fn h_is_chandrasekhars() {
        for (mu, known) in [(0.1, 1.24735), (0.5, 2.01278), (1.0, 2.90781)] {
            assert!((h_function(&[mu])[0] - known).abs() < 1e-5, "{mu}: {}", h_function(&[mu])[0]);
        }
    }

    /// What comes from below leaves, whatever is reflected meanwhile; and a fainter surface goes over into none.
    /// 16 nodes leave 1e-5 at worst, where the critical cosine is small; H is steep at 0.
    #[test]
    fn reflected_light_is_not_lost() {
        for eta in [1.1, 1.3, 1.5, 2.5] {
            let (_, leaves) = below_surface(eta);
            assert!((leaves - 1.0).abs() < 1e-5, "{eta}: {leaves}");
        }
        let none = surface_layer(1.0);
        assert!((none.beam_depth - 1.67882).abs() < 1e-5);
        let faint = surface_layer(1.0 + 1e-6);
        assert!((faint.extrapolation / none.extrapolation - 1.0).abs() < 1e-4);
        assert!((faint.beam_depth / none.beam_depth - 1.0).abs() < 1e-4);
    }

    /// The extrapolation lies a few percent below the P1 partial currents' 2C/3 (Haskell et al. 1994: C =
    /// (1 + 0.431)/(1 − 0.431) at η = 1.33, (1 + 0.493)/(1 − 0.493) at 1.4), as transport has it.
    #[test]
    fn p1_is_near() {
        for (eta, reflectance) in [(1.33, 0.431), (1.4, 0.493)] {
            let p1 = 2.0 / 3.0 * (1.0 + reflectance) / (1.0 - reflectance);
            let ratio = surface_layer(eta).extrapolation / p1;
            assert!((0.93..0.97).contains(&ratio), "{eta}: {ratio}");
        }
    }
}
