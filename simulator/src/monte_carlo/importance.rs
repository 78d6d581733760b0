//! How much a photon at some depth matters to the camera.

use super::voxels::Voxels;
use material::Face;

/// Weight windows by depth: one value a layer, front to back.
///
/// The radiance that light at depth z goes on to make, whatever its direction, solves the diffusion
/// equation with the camera in the lamp's place (the adjoint); over the layers' means that is one
/// tridiagonal system. A photon whose weight times importance is large gets split, one for which it
/// is small plays roulette. The result does not depend on these values, only its noise does. They
/// are relative to where a beam on the `lit` face scatters first.
pub(super) fn by_depth(voxels: &Voxels, boundary_constant: f64, lit: Face) -> Vec<f32> {
    let layers = voxels.layers();
    let h = voxels.spacing_mm[2];
    let kappa: Vec<f64> = layers.iter().map(|l| 1.0 / (3.0 * l.reduced_extinction)).collect();
    let edge = |k: f64| 1.0 / (2.0 * boundary_constant + h / (2.0 * k));
    let n = layers.len();
    // Thomas' algorithm, forwards: links to the layer behind, pivots, sources.
    let mut tau = 0.0_f64;
    let (mut upper, mut value) = (vec![0.0; n], vec![0.0; n]);
    let link = |a: usize, b: usize| 2.0 / (h * (1.0 / kappa[a] + 1.0 / kappa[b]));
    for i in 0..n {
        let next = tau + layers[i].reduced_extinction * h;
        let source = layers[i].albedo * ((-tau).exp() - (-next).exp());
        tau = next;
        let before = if i == 0 { edge(kappa[0]) } else { link(i - 1, i) };
        let behind = if i + 1 == n { edge(kappa[i]) } else { link(i, i + 1) };
        let absorbed = layers[i].absorption * h;
        let (up, known) = if i == 0 { (0.0, 0.0) } else { (upper[i - 1], value[i - 1]) };
        let pivot = before * (1.0 - up) + behind + absorbed;
        upper[i] = behind / pivot;
        let from_before = if i == 0 { 0.0 } else { before * known };
        value[i] = (source + from_before) / pivot;
    }
    for i in (0..n.saturating_sub(1)).rev() {
        value[i] += upper[i] * value[i + 1];
    }
    let order: Vec<usize> = match lit {
        Face::Front => (0..n).collect(),
        Face::Back => (0..n).rev().collect(),
    };
    let (mut left, mut at_source) = (1.0, 0.0);
    for z in order {
        let next = left * (-layers[z].reduced_extinction * h).exp();
        at_source += (left - next) * value[z];
        left = next;
    }
    // What passes unscattered does not matter; and single precision has an end.
    let at_source = (at_source / (1.0 - left)).max(1e-300);
    value.iter().map(|v| (v / at_source).clamp(1e-18, 1e18) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use diffusion::Medium;
    use material::Grid;

    /// Against the closed form deep inside a thick slab: importance falls by exp(−h √(μ/κ)) a
    /// layer. The layers' discretisation is off by (h μ_eff)²/24 of the exponent, below 1 %.
    #[test]
    fn importance_falls_as_diffuse_light_does() {
        let grid = Grid::new([2, 2, 60], [0.5; 3]).unwrap();
        let (kappa, mu) = (1.0 / 3.0, 0.1);
        let medium = Medium::homogeneous(grid, kappa, mu).unwrap();
        let importance = by_depth(&Voxels::new(&medium, 0.0).unwrap(), 1.0, Face::Front);
        let expected = (-0.5 * (mu / kappa).sqrt()).exp();
        for z in 25..45 {
            let found = f64::from(importance[z + 1] / importance[z]);
            assert!((found / expected).ln().abs() < 0.01 * expected.ln().abs(), "{z}: {found}");
        }
    }
}
