//! The only door to OpenCV's geometry: our types in, our types out.

use opencv::calib3d;
use opencv::core::{Mat, Point2f, Vector};
use opencv::prelude::*;

use crate::error::{CalibrationError, Result};

/// Version of the OpenCV library that the program runs with.
pub fn opencv_version() -> String {
    opencv::core::get_version_string().unwrap_or_else(|_| "version not told".into())
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
