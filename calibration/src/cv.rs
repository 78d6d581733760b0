//! The only door to OpenCV's geometry: our types in, our types out.

use opencv::calib3d;
use opencv::core::{
    Mat, Point2d, Point2f, Point3d, Point3f, Size, TermCriteria, TermCriteria_EPS,
    TermCriteria_MAX_ITER, Vector,
};
use opencv::prelude::*;

use crate::error::{CalibrationError, Result};
use crate::geometry::camera::{CameraModel, View};
use crate::geometry::pose::Pose;

/// Version of the OpenCV library that the program runs with.
pub fn opencv_version() -> String {
    opencv::core::get_version_string().unwrap_or_else(|_| "version not told".into())
}

/// Until nothing moves any more; the count only stops a solver that runs in circles.
pub(crate) fn until_settled() -> opencv::Result<TermCriteria> {
    TermCriteria::new(TermCriteria_EPS + TermCriteria_MAX_ITER, 2000, 1e-14)
}

/// A grey picture of `width` pixels a row as a matrix.
pub(crate) fn grey_mat(grey: &[u8], width: usize) -> opencv::Result<Mat> {
    let rows = i32::try_from(grey.len() / width.max(1)).unwrap_or(i32::MAX);
    Mat::from_slice(grey)?.reshape(1, rows)?.try_clone()
}

pub(crate) fn points_f32(points: &[[f64; 2]]) -> Vector<Point2f> {
    points.iter().map(|p| Point2f::new(p[0] as f32, p[1] as f32)).collect()
}

pub(crate) fn points_from(points: &Vector<Point2f>) -> Vec<[f64; 2]> {
    points.iter().map(|p| [f64::from(p.x), f64::from(p.y)]).collect()
}

/// Model with `radial` (1 to 3) radial coefficients, 1-sigma of its nine parameters, and the pose
/// of each view.
pub(crate) fn zhang(
    views: &[View],
    size: [usize; 2],
    radial: usize,
) -> Result<(CameraModel, [f64; 9], Vec<Pose>)> {
    let fixed = match radial {
        1 => calib3d::CALIB_FIX_K2 | calib3d::CALIB_FIX_K3,
        2 => calib3d::CALIB_FIX_K3,
        _ => 0,
    };
    let run = || -> opencv::Result<_> {
        let objects: Vector<Vector<Point3f>> = views
            .iter()
            .map(|v| -> Vector<Point3f> {
                v.object_points
                    .iter()
                    .map(|p| Point3f::new(p[0] as f32, p[1] as f32, p[2] as f32))
                    .collect()
            })
            .collect();
        let images: Vector<Vector<Point2f>> =
            views.iter().map(|v| points_f32(&v.image_points)).collect();
        let (mut k, mut distortion) = (Mat::default(), Mat::default());
        let (mut rotations, mut translations) = (Vector::<Mat>::new(), Vector::<Mat>::new());
        let (mut sigma_in, mut sigma_out, mut errors) =
            (Mat::default(), Mat::default(), Mat::default());
        calib3d::calibrate_camera_extended(
            &objects,
            &images,
            Size::new(size[0] as i32, size[1] as i32),
            &mut k,
            &mut distortion,
            &mut rotations,
            &mut translations,
            &mut sigma_in,
            &mut sigma_out,
            &mut errors,
            fixed,
            until_settled()?,
        )?;
        let model = CameraModel {
            width: size[0],
            height: size[1],
            fx: *k.at_2d::<f64>(0, 0)?,
            fy: *k.at_2d::<f64>(1, 1)?,
            cx: *k.at_2d::<f64>(0, 2)?,
            cy: *k.at_2d::<f64>(1, 2)?,
            distortion: numbers(&distortion)?,
        };
        let poses = rotations
            .iter()
            .zip(translations.iter())
            .map(|(r, t)| Ok(Pose::from_rotation_vector(numbers(&r)?, numbers(&t)?)))
            .collect::<opencv::Result<Vec<_>>>()?;
        Ok((model, numbers(&sigma_in)?, poses))
    };
    run().map_err(CalibrationError::opencv("calibrating the camera"))
}

/// Object frame to camera frame, refined to the least reprojection error.
pub(crate) fn solve_pnp(model: &CameraModel, view: &View) -> Result<Pose> {
    let run = || -> opencv::Result<_> {
        let object: Vector<Point3d> =
            view.object_points.iter().map(|p| Point3d::new(p[0], p[1], p[2])).collect();
        let image: Vector<Point2d> =
            view.image_points.iter().map(|p| Point2d::new(p[0], p[1])).collect();
        let k =
            [[model.fx, 0.0, model.cx], [0.0, model.fy, model.cy], [0.0, 0.0, 1.0]].map(Vec::from);
        let k = Mat::from_slice_2d(&k)?;
        let distortion = Mat::from_slice(&model.distortion)?;
        let (mut r, mut t) = (Mat::default(), Mat::default());
        calib3d::solve_pnp(
            &object,
            &image,
            &k,
            &distortion,
            &mut r,
            &mut t,
            false,
            calib3d::SOLVEPNP_ITERATIVE,
        )?;
        calib3d::solve_pnp_refine_lm(
            &object,
            &image,
            &k,
            &distortion,
            &mut r,
            &mut t,
            until_settled()?,
        )?;
        Ok(Pose::from_rotation_vector(numbers(&r)?, numbers(&t)?))
    };
    run().map_err(CalibrationError::opencv("locating the board"))
}

/// The plane projective map that takes `from` to `to` with the least squares, row by row.
pub(crate) fn homography(from: &[[f64; 2]], to: &[[f64; 2]]) -> Result<[f64; 9]> {
    let run = || -> opencv::Result<_> {
        let h = calib3d::find_homography(
            &points_f32(from),
            &points_f32(to),
            &mut Mat::default(),
            0,
            3.0,
        )?;
        numbers(&h)
    };
    run().map_err(CalibrationError::opencv("fitting a plane map"))
}

/// The plane projective map that takes most of `from` to within `tolerance` of `to`; None if no
/// map takes even four.
pub(crate) fn homography_of_most(
    from: &[[f64; 2]],
    to: &[[f64; 2]],
    tolerance: f64,
) -> Result<Option<[f64; 9]>> {
    let run = || -> opencv::Result<_> {
        let (from, to) = (points_f32(from), points_f32(to));
        let mut inliers = Mat::default();
        let h = calib3d::find_homography(&from, &to, &mut inliers, calib3d::RANSAC, tolerance)?;
        if h.empty() { Ok(None) } else { numbers(&h).map(Some) }
    };
    run().map_err(CalibrationError::opencv("fitting a plane map"))
}

/// Where a plane map takes a point.
pub(crate) fn apply_homography(h: &[f64; 9], [x, y]: [f64; 2]) -> [f64; 2] {
    let w = h[6] * x + h[7] * y + h[8];
    [(h[0] * x + h[1] * y + h[2]) / w, (h[3] * x + h[4] * y + h[5]) / w]
}

/// The first N doubles of a matrix; an error where it holds fewer.
fn numbers<const N: usize>(mat: &Mat) -> opencv::Result<[f64; N]> {
    let data = mat.data_typed::<f64>()?;
    data.get(..N).and_then(|slice| slice.try_into().ok()).ok_or_else(|| {
        opencv::Error::new(
            opencv::core::StsOutOfRange,
            format!("expected {N} numbers, found {}", data.len()),
        )
    })
}
