//! The smoothness term R(u) = V^(−1/3) ∫ ‖∇u‖² + ((u − u₀)/ℓ)² dV, u = log κ or log μ, V a cell's volume.
//!
//! The first part is what counts. The second is a weak pull towards the homogeneous start u₀, with the
//! block's longest edge ℓ: what neither images nor neighbours determine would else drift by powers of
//! ten as λ falls (together both are the prior of a random field whose correlation reaches as far as
//! the block does).

use material::Grid;

/// c_a = (A_a/h_a)/V^⅓ of every axis: 1 for cubic cells, and a stretched grid measures the same
/// block the same way.
pub(crate) fn step_weights(grid: &Grid) -> [f64; 3] {
    let volume = grid.cell_volume_mm3();
    grid.spacing_mm().map(|h| volume / (h * h) / volume.cbrt())
}

/// What one cell's (u − u₀)² counts: V^⅔/ℓ².
pub(crate) fn pull(grid: &Grid) -> f64 {
    let longest = grid.size_mm().into_iter().fold(0.0, f64::max);
    grid.cell_volume_mm3().powf(2.0 / 3.0) / (longest * longest)
}

/// Σ_cells V^⅔ ((u − u₀)/ℓ)². Adds its derivative to `gradient`.
pub(crate) fn squared_distance(grid: &Grid, u: &[f64], centre: f64, gradient: &mut [f64]) -> f64 {
    let pull = pull(grid);
    let mut total = 0.0;
    for (u, g) in u.iter().zip(gradient) {
        total += pull * (u - centre) * (u - centre);
        *g += 2.0 * pull * (u - centre);
    }
    total
}

/// Σ_faces c_a (u_b − u_a)², a finite-difference V^(−1/3) ∫ ‖∇u‖² dV. Adds `scale` times its
/// derivative to `gradient` and returns its value.
pub(crate) fn squared_gradient(grid: &Grid, u: &[f64], scale: f64, gradient: &mut [f64]) -> f64 {
    let cells = grid.cells();
    let weights = step_weights(grid);
    let strides = [1, cells[0], cells[0] * cells[1]];
    let mut total = 0.0;
    for axis in 0..3 {
        let c = weights[axis];
        for i in 0..u.len() {
            let position = [i % cells[0], i / cells[0] % cells[1], i / strides[2]][axis];
            if position + 1 < cells[axis] {
                let j = i + strides[axis];
                let step = u[j] - u[i];
                total += c * step * step;
                gradient[j] += 2.0 * scale * c * step;
                gradient[i] -= 2.0 * scale * c * step;
            }
        }
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A linear ramp along each axis has ‖∇u‖² = 1 wherever there is a face: R · V^⅓ = faces · V.
    #[test]
    fn a_ramp_has_unit_gradient() {
        let grid = Grid::new([5, 4, 3], [0.5, 2.0, 0.7]).unwrap();
        let scale = grid.cell_volume_mm3().powf(2.0 / 3.0);
        for axis in 0..3 {
            let u: Vec<f64> =
                (0..grid.len()).map(|i| grid.centre_mm(i % 5, i / 5 % 4, i / 20)[axis]).collect();
            let n = grid.cells();
            let faces = grid.len() / n[axis] * (n[axis] - 1);
            let r = squared_gradient(&grid, &u, 0.0, &mut vec![0.0; grid.len()]);
            assert!((r / (faces as f64 * scale) - 1.0).abs() < 1e-12, "{axis}: {r}");
        }
    }

    /// The gradient of a quadratic form by central differences is exact to rounding.
    #[test]
    fn gradient_of_smoothness() {
        let grid = Grid::new([3, 4, 2], [0.5, 2.0, 0.7]).unwrap();
        let u: Vec<f64> = (0..24).map(|i| (i as f64 * 1.7).sin()).collect();
        let mut g = vec![0.0; 24];
        squared_gradient(&grid, &u, 3.0, &mut g);
        for i in 0..24 {
            let at = |s: f64| {
                let mut v = u.clone();
                v[i] += s;
                3.0 * squared_gradient(&grid, &v, 0.0, &mut [0.0; 24])
            };
            assert!((g[i] - (at(0.5) - at(-0.5))).abs() < 1e-11);
        }
    }
}
