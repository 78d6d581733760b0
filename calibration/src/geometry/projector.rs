//! The projector as an inverse camera, located by the camera that watches it.
//!
//! In each pose a plane carries a printed board and, beside it, a projected one. The printed board
//! gives the plane in the camera's frame; the rays of the projected corners meet it in points
//! whose projector pixels are known. All points of all poses share one camera frame, so the
//! projector is one resection of a cloud that is not flat: its nine intrinsics and one pose,
//! started by the direct linear transformation, which supposes nothing about the principal point
//! (lens-shifted projectors have it outside the picture), and refined to the least reprojection
//! error. Per-pose extrinsics that would have to be averaged never arise.

use nalgebra::{DMatrix, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};
use crate::geometry::camera::CameraModel;
use crate::geometry::levenberg::levenberg_marquardt;
use crate::geometry::pose::Pose;

/// One pose of the plane: points on it and the projector pixels that light them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProjectorView {
    /// What to call it: the pattern picture's name.
    pub name: String,
    /// Board frame to camera frame.
    pub board_pose: Pose,
    /// Points on the plane in the board's frame, mm (z = 0).
    pub board_points: Vec<[f64; 3]>,
    /// The projector pixels that light them.
    pub projector_pixels: Vec<[f64; 2]>,
}

/// How well one pose is explained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProjectorViewFit {
    /// The view's name.
    pub name: String,
    /// sqrt(Σ(dx² + dy²)/N), projector pixels.
    pub rms_px: f64,
}

/// A calibrated projector with the evidence that it was solved from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProjectorCalibration {
    /// The projector as a camera (k3 is held at 0: projectors distort little).
    pub model: CameraModel,
    /// sqrt(Σ(dx² + dy²)/N) over all points, projector pixels.
    pub rms_px: f64,
    /// Camera frame to projector frame.
    pub pose: Pose,
    /// Distance between the two centres of projection, mm.
    pub baseline_mm: f64,
    /// 1-sigma of fx, fy, cx, cy, k1, k2, p1, p2, from the residuals.
    pub standard_deviations: [f64; 8],
    /// Fit of each view, in the order given.
    pub views: Vec<ProjectorViewFit>,
    /// The observations.
    pub observations: Vec<ProjectorView>,
}

/// Calibrates a projector of `size` = [width, height] pixels from at least three poses.
///
/// # Errors
/// Fewer than three views, unmatched points, views that all lie in one plane, or no convergence.
pub fn calibrate_projector(
    views: &[ProjectorView],
    size: [usize; 2],
) -> Result<ProjectorCalibration> {
    if views.len() < 3 {
        return Err(CalibrationError::TooFewViews {
            what: "projector calibration",
            needed: 3,
            found: views.len(),
        });
    }
    let mut points = Vec::new();
    for view in views {
        let (on_plane, lit) = (view.board_points.len(), view.projector_pixels.len());
        if on_plane != lit || lit < 4 {
            return Err(CalibrationError::Mismatch {
                picture: view.name.clone(),
                expected: "at least 4 points, each with its projector pixel".into(),
                found: format!("{on_plane} points and {lit} pixels"),
            });
        }
        let seen = view.board_points.iter().map(|&p| view.board_pose.apply(p));
        points.extend(seen.zip(view.projector_pixels.iter().copied()));
    }
    let start = resect(&points)?;
    let fit = levenberg_marquardt(
        "projector calibration",
        |x| {
            let (model, pose) = unpack(x, size);
            points
                .iter()
                .flat_map(|&(point, pixel)| {
                    let seen = model.project(pose.apply(point));
                    [seen[0] - pixel[0], seen[1] - pixel[1]]
                })
                .collect()
        },
        &start,
        &[1e3, 1e3, 1e3, 1e3, 1.0, 1.0, 0.1, 0.1, 1.0, 1.0, 1.0, 100.0, 100.0, 100.0],
    )?;
    let (model, pose) = unpack(&fit.x, size);
    let square = |p: [f64; 3], pixel: [f64; 2]| {
        let seen = model.project(pose.apply(p));
        (seen[0] - pixel[0]).powi(2) + (seen[1] - pixel[1]).powi(2)
    };
    let fits = views.iter().map(|view| {
        let squares = view.board_points.iter().zip(&view.projector_pixels);
        let sum: f64 = squares.map(|(&p, &px)| square(view.board_pose.apply(p), px)).sum();
        let rms_px = (sum / view.projector_pixels.len() as f64).sqrt();
        ProjectorViewFit { name: view.name.clone(), rms_px }
    });
    let total: f64 = points.iter().map(|&(p, px)| square(p, px)).sum();
    Ok(ProjectorCalibration {
        model,
        rms_px: (total / points.len() as f64).sqrt(),
        pose,
        baseline_mm: Vector3::from(pose.inverse().translation_mm).norm(),
        standard_deviations: std::array::from_fn(|i| fit.sigma[i]),
        views: fits.collect(),
        observations: views.to_vec(),
    })
}

/// fx fy cx cy k1 k2 p1 p2, rotation vector, translation.
fn unpack(x: &[f64], [width, height]: [usize; 2]) -> (CameraModel, Pose) {
    let model = CameraModel {
        width,
        height,
        fx: x[0],
        fy: x[1],
        cx: x[2],
        cy: x[3],
        distortion: [x[4], x[5], x[6], x[7], 0.0],
    };
    (model, Pose::from_rotation_vector([x[8], x[9], x[10]], [x[11], x[12], x[13]]))
}

/// Direct linear transformation (Hartley & Zisserman 7.1) of points (mm) to pixels, split into
/// intrinsics and pose; no distortion.
fn resect(points: &[([f64; 3], [f64; 2])]) -> Result<Vec<f64>> {
    let failed = |reason: &str| CalibrationError::NotConverged {
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
    let size = spread(
        points.iter().map(|(p, _)| (0..3).map(|a| (p[a] - centre[a]).powi(2)).sum::<f64>()).sum(),
    );
    let extent = spread(
        points.iter().map(|(_, q)| (0..2).map(|a| (q[a] - middle[a]).powi(2)).sum::<f64>()).sum(),
    );
    let mut normal = DMatrix::<f64>::zeros(12, 12);
    for (p, q) in points {
        let x: [f64; 3] = std::array::from_fn(|a| (p[a] - centre[a]) / size);
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
        return Err(failed("all views lie in one plane: tilt and move the board between them"));
    }
    let p = eigen.eigenvectors.column(order[0]);
    let mut left = Matrix3::from_fn(|i, j| p[4 * i + j]);
    let mut right = Vector3::new(p[3], p[7], p[11]);
    // Undo both scalings: pixel = extent · seen + middle, X = (p − centre) / size.
    let undo = Matrix3::new(extent, 0.0, middle[0], 0.0, extent, middle[1], 0.0, 0.0, 1.0);
    left = undo * left / size;
    right = undo * right - left * Vector3::from(centre);
    let (k, mut rotation) = upper_and_rotation(&left).ok_or_else(|| failed("degenerate views"))?;
    let mut translation = k.try_inverse().ok_or_else(|| failed("degenerate views"))? * right;
    // The sign of the whole is free; a rotation and points in front of the lens fix it.
    if rotation.determinant() < 0.0 {
        rotation = -rotation;
        translation = -translation;
    }
    let pose = Pose::from_parts(&rotation, &translation);
    let scale = k[(2, 2)];
    let intrinsics = [k[(0, 0)], k[(1, 1)], k[(0, 2)], k[(1, 2)]].map(|v| v / scale);
    let mut start = intrinsics.to_vec();
    start.extend([0.0; 4]);
    start.extend(pose.rotation_vector());
    start.extend(pose.translation_mm);
    Ok(start)
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
