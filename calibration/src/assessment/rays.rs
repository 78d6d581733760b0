//! How well it is known which way each pixel looks.
//!
//! Intrinsics hang together, so their own sigmas say little about a picture: an error of the
//! principal point and a small turn of the device look alike, and whoever uses the device finds
//! its pose anew and takes such an error up. What remains after the best turn is what counts: the
//! cross-reprojection of mrcal (D. Kogan, <https://mrcal.secretsauce.net>, "projection
//! uncertainty" and "differencing"), with the turn fitted over the whole picture.

use nalgebra::{DMatrix, Matrix2x3, Matrix3, Matrix3xX, Rotation3, Vector2, Vector3};

use crate::error::{CalibrationError, Result};
use crate::geometry::camera_model::{CameraModel, INTRINSIC_NAMES};
use crate::geometry::result::{Covariance, Device};

/// Points across and down at which it is taken, the picture's rim included.
pub(crate) const POINTS: [usize; 2] = [21, 16];

/// Covariance of what a device's uncertain intrinsics do to the pixels of its picture, the best
/// turn of the device taken off.
#[derive(Clone, Debug, PartialEq)]
pub struct RayUncertainty {
    /// Points across and down; rows follow each other in the lists below.
    pub points: [usize; 2],
    /// Where, pixels.
    pub pixels: Vec<[f64; 2]>,
    /// Covariance of x and y there, pixels².
    pub covariance_px: Vec<[[f64; 2]; 2]>,
}

/// A grid of pixels over a picture, its rim included, row by row.
pub(crate) fn grid(size: [usize; 2]) -> Vec<[f64; 2]> {
    let place = |axis: usize, i: usize| {
        let last = (size[axis].max(1) - 1) as f64;
        last * i as f64 / (POINTS[axis] - 1) as f64
    };
    (0..POINTS[1])
        .flat_map(|row| (0..POINTS[0]).map(move |column| [place(0, column), place(1, row)]))
        .collect()
}

/// One pixel's ray and what turning the device and changing its intrinsics does to the pixel.
struct Ray {
    ray: Vector3<f64>,
    pixel: [f64; 2],
    by_turn: Matrix2x3<f64>,
    by_intrinsics: [[f64; INTRINSIC_NAMES.len()]; 2],
}

impl Ray {
    /// Where `device`, turned, sees a ray; None behind it.
    fn seen(device: &CameraModel, ray: Vector3<f64>) -> Option<Self> {
        let seen = device.project_with_slopes(ray.into())?;
        // g · (w × r) = w · (r × g) for a turn w.
        let row = |a: usize| ray.cross(&Vector3::from(seen.by_point[a])).transpose();
        let by_turn = Matrix2x3::from_rows(&[row(0), row(1)]);
        Some(Self { ray, pixel: seen.pixel, by_turn, by_intrinsics: seen.by_intrinsics })
    }

    fn of(device: &CameraModel, pixel: [f64; 2]) -> Option<Self> {
        let [x, y] = device.undistort(pixel)?;
        Self::seen(device, Vector3::new(x, y, 1.0))
    }
}

impl RayUncertainty {
    /// s'(q) = (J_i − J_r M) δ with M = (Σ J_rᵀ J_r)⁻¹ Σ J_rᵀ J_i, J_i and J_r being the slopes of
    /// pixel q by the intrinsics δ and by a turn of the device; returns Cov s' = A Cov δ Aᵀ.
    ///
    /// `name` is the device's in `covariance`: "camera" or "projector".
    ///
    /// # Errors
    /// A distortion without a ray for some pixel, or a covariance that is none.
    pub fn of(device: &Device, name: &'static str, covariance: &Covariance) -> Result<Self> {
        let free: Vec<(usize, String)> = INTRINSIC_NAMES
            .iter()
            .enumerate()
            .map(|(at, intrinsic)| (at, format!("{name}.{intrinsic}")))
            .filter(|(_, name)| covariance.parameters.contains(name))
            .collect();
        let n = free.len();
        let delta = DMatrix::from_fn(n, n, |i, j| covariance.of(&free[i].1, &free[j].1));
        let model = &device.model;
        let pixels = grid([model.width, model.height]);
        let folded = |pixel| CalibrationError::Folded {
            what: name,
            distortion: device.selection.distortion.name(),
            pixel,
        };
        let rays = pixels
            .iter()
            .map(|&q| Ray::of(model, q).ok_or_else(|| folded(q)))
            .collect::<Result<Vec<_>>>()?;
        let slopes: Vec<DMatrix<f64>> = rays
            .iter()
            .map(|r| DMatrix::from_fn(2, n, |a, j| r.by_intrinsics[a][free[j].0]))
            .collect();
        let mut turns = Matrix3::zeros();
        let mut mixed = Matrix3xX::zeros(n);
        for (ray, slope) in rays.iter().zip(&slopes) {
            turns += ray.by_turn.transpose() * ray.by_turn;
            mixed += ray.by_turn.transpose() * slope;
        }
        let undetermined = || CalibrationError::Degenerate {
            what: name,
            reason: "its pixels all look the same way".into(),
        };
        let implied = turns.cholesky().ok_or_else(undetermined)?.solve(&mixed);
        let covariance_px = rays
            .iter()
            .zip(&slopes)
            .map(|(ray, slope)| {
                let left = slope - ray.by_turn * &implied;
                let c = &left * &delta * left.transpose();
                [[c[(0, 0)], c[(0, 1)]], [c[(1, 0)], c[(1, 1)]]]
            })
            .collect();
        Ok(Self { points: POINTS, pixels, covariance_px })
    }

    /// 1-sigma along the worst direction at each point, pixels.
    pub fn sigma_px(&self) -> Vec<f64> {
        self.covariance_px.iter().map(worst_axis).collect()
    }
}

/// Root of the larger eigenvalue.
fn worst_axis([[a, b], [_, c]]: &[[f64; 2]; 2]) -> f64 {
    let (mean, half) = ((a + c) / 2.0, (a - c) / 2.0);
    (mean + half.hypot(*b)).max(0.0).sqrt()
}

/// Where device `b` sees what each of `a`'s pixels looks at, less that pixel, after the turn of
/// `b` that makes these differences least; for the pixels of a [`RayUncertainty`] of `a`.
///
/// None where a distortion folds the picture.
pub fn ray_difference(a: &CameraModel, b: &CameraModel) -> Option<Vec<[f64; 2]>> {
    let pixels = grid([a.width, a.height]);
    let rays = pixels.iter().map(|&q| Ray::of(a, q)).collect::<Option<Vec<_>>>()?;
    let mut turn = Rotation3::identity();
    let mut out = vec![[0.0; 2]; pixels.len()];
    // Gauss–Newton: calibrations of one device are a fraction of a degree apart, where each round
    // squares the error.
    for _ in 0..6 {
        let mut turns = Matrix3::zeros();
        let mut pull = Vector3::zeros();
        for ((ray, q), d) in rays.iter().zip(&pixels).zip(&mut out) {
            let seen = Ray::seen(b, turn * ray.ray)?;
            *d = [seen.pixel[0] - q[0], seen.pixel[1] - q[1]];
            turns += seen.by_turn.transpose() * seen.by_turn;
            pull += seen.by_turn.transpose() * Vector2::from(*d);
        }
        turn = Rotation3::new(-turns.cholesky()?.solve(&pull)) * turn;
    }
    out.iter().flatten().all(|d| d.is_finite()).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is left of a principal point 20 px aside, and of a focal length 1 % longer, which no turn
    /// explains: the largest by the same least squares in NumPy.
    #[test]
    fn a_turn_explains_a_shifted_principal_point() {
        let a = CameraModel::pinhole([800, 600], [1000.0; 2], [400.0, 300.0]);
        let b = CameraModel { cx: 420.0, ..a };
        let largest = |d: Vec<[f64; 2]>| d.iter().map(|d| d[0].hypot(d[1])).fold(0.0, f64::max);
        let shifted = largest(ray_difference(&a, &b).unwrap());
        assert!((shifted - 3.061_496).abs() < 1e-5, "{shifted}");
        let zoomed = CameraModel { fx: 1010.0, fy: 1010.0, ..a };
        let zoomed = largest(ray_difference(&a, &zoomed).unwrap());
        assert!((zoomed - 4.995_410).abs() < 1e-5, "{zoomed}");
    }

    #[test]
    fn the_worst_axis_is_the_longer_one() {
        assert!((worst_axis(&[[9.0, 0.0], [0.0, 4.0]]) - 3.0).abs() < 1e-12);
        // Turned by 45 degrees: sigmas 3 and 1.
        assert!((worst_axis(&[[5.0, 4.0], [4.0, 5.0]]) - 3.0).abs() < 1e-12);
    }
}
