//! Pinhole camera with lens distortion, rigid poses, and Zhang's calibration.
//!
//! Pixel coordinates have pixel centres at integers (the first pixel's centre is (0, 0)).
//! Frames are right-handed, millimetres, x right, y down, z away from the viewer.

use serde::{Deserialize, Serialize};

use crate::cv;
use crate::error::{CalibrationError, Result};
use crate::geometry::pose::Pose;

/// A camera, or a projector seen as an inverse camera.
///
/// A point (x, y, 1) on the ray goes to pixel (fx·x' + cx, fy·y' + cy), where with r² = x² + y²
/// x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2x²) and
/// y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2y²) + 2 p2 x y (Brown 1966).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraModel {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels; may lie outside the picture (lens-shifted projectors).
    pub cx: f64,
    /// Principal point y, pixels.
    pub cy: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
}

impl CameraModel {
    /// The pixel that a point in the camera frame (mm) is seen at.
    ///
    /// A point behind the camera (z ≤ 0) has none: NaN.
    pub fn project(&self, point_mm: [f64; 3]) -> [f64; 2] {
        let [x, y, z] = point_mm;
        if z <= 0.0 {
            return [f64::NAN; 2];
        }
        let [x, y] = self.distort([x / z, y / z]);
        [self.fx * x + self.cx, self.fy * y + self.cy]
    }

    /// The undistorted ray (x, y) of (x, y, 1) that a pixel looks along.
    ///
    /// None where the distortion cannot be inverted (far outside the calibrated field).
    pub fn undistort(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let target = [(pixel[0] - self.cx) / self.fx, (pixel[1] - self.cy) / self.fy];
        let mut ray = target;
        // Newton's iteration doubles its digits each time: 20 rounds mean it never arrives.
        for _ in 0..20 {
            let [x, y] = self.distort(ray);
            let miss = [x - target[0], y - target[1]];
            if miss[0].hypot(miss[1]) < 1e-13 * (1.0 + target[0].hypot(target[1])) {
                return Some(ray);
            }
            let [a, b, c, d] = self.distortion_jacobian(ray);
            let determinant = a * d - b * c;
            // A fold of the distortion: the radius no longer grows with the angle.
            if determinant.is_nan() || determinant <= 1e-6 {
                return None;
            }
            ray[0] -= (d * miss[0] - b * miss[1]) / determinant;
            ray[1] -= (a * miss[1] - c * miss[0]) / determinant;
        }
        let [x, y] = self.distort(ray);
        ((x - target[0]).hypot(y - target[1]) < 1e-9).then_some(ray)
    }

    /// Whether every pixel of the picture has one ray.
    pub fn is_invertible(&self) -> bool {
        let (w, h) = (self.width as f64 - 0.5, self.height as f64 - 0.5);
        let steps = 16;
        (0..=steps).all(|i| {
            let s = f64::from(i) / f64::from(steps);
            let (x, y) = (-0.5 + s * (w + 0.5), -0.5 + s * (h + 0.5));
            [[x, -0.5], [x, h], [-0.5, y], [w, y]].iter().all(|&px| self.undistort(px).is_some())
        })
    }

    fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (r2, xy) = (x * x + y * y, 2.0 * x * y);
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        [
            x * radial + p1 * xy + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + p2 * xy,
        ]
    }

    /// ∂(x', y')/∂(x, y) as [xx, xy, yx, yy].
    fn distortion_jacobian(&self, [x, y]: [f64; 2]) -> [f64; 4] {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3));
        let mixed = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        [
            radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
            mixed,
            mixed,
            radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
        ]
    }
}

/// One picture's worth of known points and where they were seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// The picture's name.
    pub name: String,
    /// Where the points were seen, pixels.
    pub image_points: Vec<[f64; 2]>,
    /// The points in the board's frame, mm.
    pub object_points: Vec<[f64; 3]>,
}

/// How well one view is explained, and where its board was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewFit {
    /// The picture's name.
    pub name: String,
    /// sqrt(Σ(dx² + dy²)/N) over this view's points, pixels.
    pub rms_px: f64,
    /// Board frame to camera frame.
    pub pose: Pose,
}

/// A calibrated camera with the evidence that it was solved from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraCalibration {
    /// The camera.
    pub model: CameraModel,
    /// sqrt(Σ(dx² + dy²)/N) over all points of all views, pixels.
    pub rms_px: f64,
    /// 1-sigma of fx, fy, cx, cy, k1, k2, p1, p2, k3 from the residuals, in their own units;
    /// 0 for coefficients that the views do not determine and that are held at 0.
    pub standard_deviations: [f64; 9],
    /// Fit of each view, in the order given.
    pub views: Vec<ViewFit>,
    /// The observations.
    pub observations: Vec<View>,
}

/// Zhang's calibration (2000) from views of a plane, `size` = [width, height] pixels.
///
/// Minimises the reprojection error over fx, fy, cx, cy, k1, k2, p1, p2, k3 and all poses by
/// OpenCV's Levenberg–Marquardt, run until the step vanishes rather than for its default
/// 30 rounds. k2 and k3 stay 0 unless the views call for them: boards that never reach the
/// picture's corners leave them free to run away and fold the picture where nobody looked.
///
/// # Errors
/// Fewer than three views, a view with too few or unmatched points, points outside the picture
/// (which betrays views of another size), or a distortion that folds the picture onto itself.
pub fn calibrate_camera(views: &[View], size: [usize; 2]) -> Result<CameraCalibration> {
    check_views(views, size)?;
    let (model, sigmas, poses) = solve(views, size)?;
    let fits: Vec<ViewFit> = views
        .iter()
        .zip(poses)
        .map(|(view, pose)| ViewFit {
            name: view.name.clone(),
            rms_px: reprojection_rms(&model, &pose, view),
            pose,
        })
        .collect();
    let (mut total, mut count) = (0.0, 0.0);
    for (fit, view) in fits.iter().zip(views) {
        total += fit.rms_px.powi(2) * view.image_points.len() as f64;
        count += view.image_points.len() as f64;
    }
    Ok(CameraCalibration {
        model,
        rms_px: (total / count).sqrt(),
        standard_deviations: sigmas,
        views: fits,
        observations: views.to_vec(),
    })
}

/// Where a known object is, seen by a calibrated camera: object frame to camera frame.
///
/// With a board laid on the sample's front face this is the face's pose.
///
/// # Errors
/// Fewer than four points, or OpenCV's solver fails.
pub fn pose_from_points(model: &CameraModel, view: &View) -> Result<Pose> {
    check_points(view, 4)?;
    cv::solve_pnp(model, view)
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

/// The number of radial coefficients that the views can bear: of the solutions under which the
/// whole picture keeps an inverse, the one with the least Bayesian information criterion
/// n ln(rms²) + k ln n (Schwarz 1978).
fn solve(views: &[View], size: [usize; 2]) -> Result<(CameraModel, [f64; 9], Vec<Pose>)> {
    let n = 2.0 * views.iter().map(|v| v.image_points.len()).sum::<usize>() as f64;
    let mut best = None;
    let mut least = f64::INFINITY;
    for radial in 1..=3 {
        let solution = cv::zhang(views, size, radial)?;
        let (model, _, poses) = &solution;
        if !model.is_invertible() {
            continue;
        }
        let squares: f64 = views
            .iter()
            .zip(poses)
            .map(|(v, p)| reprojection_rms(model, p, v).powi(2) * v.image_points.len() as f64)
            .sum();
        let criterion = n * squares.ln() + radial as f64 * n.ln();
        if criterion < least {
            (best, least) = (Some(solution), criterion);
        }
    }
    best.ok_or_else(|| CalibrationError::NotConverged {
        what: "camera calibration",
        reason: "every distortion that fits folds the picture onto itself; use more views that \
                 reach into the corners"
            .into(),
    })
}

fn check_views(views: &[View], size: [usize; 2]) -> Result<()> {
    if views.len() < 3 {
        return Err(CalibrationError::TooFewViews {
            what: "camera calibration",
            needed: 3,
            found: views.len(),
        });
    }
    for view in views {
        check_points(view, 6)?;
        let outside = view.image_points.iter().find(|p| {
            !(p[0] >= -1.0 && p[1] >= -1.0 && p[0] <= size[0] as f64 && p[1] <= size[1] as f64)
        });
        if let Some(point) = outside {
            return Err(CalibrationError::Mismatch {
                picture: view.name.clone(),
                expected: format!("points inside a picture of {}x{} pixels", size[0], size[1]),
                found: format!("a point at ({:.1}, {:.1})", point[0], point[1]),
            });
        }
    }
    Ok(())
}

fn check_points(view: &View, needed: usize) -> Result<()> {
    let (seen, known) = (view.image_points.len(), view.object_points.len());
    if seen == known && seen >= needed {
        return Ok(());
    }
    Err(CalibrationError::Mismatch {
        picture: view.name.clone(),
        expected: format!("at least {needed} points, each with its place on the board"),
        found: format!("{seen} points seen, {known} known"),
    })
}
