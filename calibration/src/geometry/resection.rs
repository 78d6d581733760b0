//! A projector (or camera) from a cloud of points that is not flat: the direct linear
//! transformation, which supposes nothing about the principal point (lens-shifted projectors have
//! it outside of the picture). A start for the bundle adjustment.

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::error::{CalibrationError, Result};
use crate::geometry::camera_model::CameraModel;
use crate::geometry::pose::Pose;

/// Direct linear transformation (Hartley & Zisserman 7.1) of points (mm) to pixels, split into
/// a pinhole and its pose; no distortion.
///
/// # Errors
/// Points that lie in one plane.
pub(crate) fn resect(
    points: &[([f64; 3], [f64; 2])],
    size: [usize; 2],
) -> Result<(CameraModel, Pose)> {
    let failed = |reason: &str| CalibrationError::Degenerate {
        what: "projector calibration",
        reason: reason.into(),
    };
    // Both sets are centred and scaled, without which the smallest singular value drowns.
    let n = points.len() as f64;
    let centre: [f64; 3] =
        std::array::from_fn(|a| points.iter().map(|(p, _)| p[a]).sum::<f64>() / n);
    let middle: [f64; 2] =
        std::array::from_fn(|a| points.iter().map(|(_, q)| q[a]).sum::<f64>() / n);
    let spread = |sum: f64| (sum / n).sqrt().max(1e-9);
    let reach = spread(
        points.iter().map(|(p, _)| (0..3).map(|a| (p[a] - centre[a]).powi(2)).sum::<f64>()).sum(),
    );
    let extent = spread(
        points.iter().map(|(_, q)| (0..2).map(|a| (q[a] - middle[a]).powi(2)).sum::<f64>()).sum(),
    );
    let mut normal = DMatrix::<f64>::zeros(12, 12);
    for (p, q) in points {
        let x: [f64; 3] = std::array::from_fn(|a| (p[a] - centre[a]) / reach);
        let x = [x[0], x[1], x[2], 1.0];
        for a in 0..2 {
            let seen = (q[a] - middle[a]) / extent;
            let mut row = [0.0; 12];
            for i in 0..4 {
                row[4 * a + i] = x[i];
                row[8 + i] = -seen * x[i];
            }
            for i in 0..12 {
                for j in 0..12 {
                    normal[(i, j)] += row[i] * row[j];
                }
            }
        }
    }
    let eigen = normal.symmetric_eigen();
    let mut order: Vec<usize> = (0..12).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    // Points of one plane leave a whole family of solutions.
    if eigen.eigenvalues[order[1]] < 1e-9 * eigen.eigenvalues[order[11]] {
        return Err(failed("all views lie in one plane"));
    }
    let p = eigen.eigenvectors.column(order[0]);
    let mut left = Matrix3::from_fn(|i, j| p[4 * i + j]);
    let mut right = Vector3::new(p[3], p[7], p[11]);
    // Undo both scalings: pixel = extent · seen + middle, X = (p − centre) / reach.
    let undo = Matrix3::new(extent, 0.0, middle[0], 0.0, extent, middle[1], 0.0, 0.0, 1.0);
    left = undo * left / reach;
    right = undo * right - left * Vector3::from(centre);
    let (k, mut rotation) =
        upper_and_rotation(&left).ok_or_else(|| failed("the views say too little"))?;
    let mut translation =
        k.try_inverse().ok_or_else(|| failed("the views say too little"))? * right;
    // The sign of the whole is free; a rotation and points in front of the lens fix it.
    if rotation.determinant() < 0.0 {
        rotation = -rotation;
        translation = -translation;
    }
    let pose = Pose::from_parts(&rotation, &translation);
    let scale = k[(2, 2)];
    let [fx, fy, cx, cy] = [k[(0, 0)], k[(1, 1)], k[(0, 2)], k[(1, 2)]].map(|v| v / scale);
    Ok((CameraModel::pinhole(size, [fx, fy], [cx, cy]), pose))
}

/// M = K R with K upper triangular, positive diagonal.
fn upper_and_rotation(m: &Matrix3<f64>) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
    // QR of the inverse: M⁻¹ = Rᵀ K⁻¹.
    let inverse = m.try_inverse()?;
    let (q, r) = inverse.qr().unpack();
    let signs = Matrix3::from_diagonal(&r.diagonal().map(f64::signum));
    let k = (signs * r).try_inverse()?;
    Some((k, (q * signs).transpose()))
}
