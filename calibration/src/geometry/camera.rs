//! Views of a board, and where a calibrated camera sees one.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};
use crate::geometry::camera_model::CameraModel;
use crate::geometry::pose::Pose;
use crate::geometry::{bundle, zhang};

/// One picture's worth of known points and where they were seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct View {
    /// The picture's name.
    pub name: String,
    /// Where the points were seen, pixels.
    pub image_points: Vec<[f64; 2]>,
    /// The points in the board's frame, mm.
    pub object_points: Vec<[f64; 3]>,
}

impl View {
    /// Checks that every point has its place and that there are at least `fewest`.
    pub(crate) fn check(&self, fewest: usize) -> Result<()> {
        let (seen, known) = (self.image_points.len(), self.object_points.len());
        if seen != known || seen < fewest {
            return Err(CalibrationError::Mismatch {
                picture: self.name.clone(),
                expected: format!("at least {fewest} points, each with its place on the board"),
                found: format!("{seen} seen and {known} on the board"),
            });
        }
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        let all = self.image_points.iter().all(|p| finite(p))
            && self.object_points.iter().all(|p| finite(p));
        if !all {
            return Err(CalibrationError::Mismatch {
                picture: self.name.clone(),
                expected: "finite coordinates".into(),
                found: "one that is not a number".into(),
            });
        }
        Ok(())
    }
}

/// Where a plane with known points is, seen by a calibrated camera: its frame to camera frame, with
/// the least squared reprojection error.
///
/// With a board laid on the sample's front face this is the face's pose.
///
/// # Errors
/// Fewer than four points, points off the plane z = 0 or on one line, or a pixel without a ray.
pub fn pose_from_points(model: &CameraModel, view: &View) -> Result<Pose> {
    view.check(4)?;
    let refuse = |reason: &str| CalibrationError::Degenerate {
        what: "locating a board",
        reason: format!("{}: {reason}", view.name),
    };
    if view.object_points.iter().any(|p| p[2] != 0.0) {
        return Err(refuse("its points do not lie on the plane z = 0"));
    }
    let rays = view.image_points.iter().map(|&pixel| model.undistort(pixel));
    let rays: Option<Vec<[f64; 2]>> = rays.collect();
    let rays = rays.ok_or_else(|| refuse("a point lies beyond the calibrated field"))?;
    let flat: Vec<[f64; 2]> = view.object_points.iter().map(|p| [p[0], p[1]]).collect();
    let start = zhang::plane_map(&flat, &rays)
        .and_then(|map| zhang::pose(&Matrix3::identity(), &map))
        .ok_or_else(|| refuse("its points lie on one line"))?;
    bundle::locate(model, view, start)
}

/// sqrt(Σ(dx² + dy²)/N) of a view under a camera and a pose, pixels.
pub fn reprojection_rms(model: &CameraModel, pose: &Pose, view: &View) -> f64 {
    let squares: f64 = view
        .object_points
        .iter()
        .zip(&view.image_points)
        .map(|(&object, seen)| {
            let [u, v] = model.project(pose.apply(object));
            (u - seen[0]).powi(2) + (v - seen[1]).powi(2)
        })
        .sum();
    (squares / view.image_points.len() as f64).sqrt()
}
