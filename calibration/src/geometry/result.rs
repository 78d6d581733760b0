//! What comes out of a calibration, with everything that it was solved from.

use std::collections::HashSet;

use nalgebra::{DMatrix, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::error::Result;
use crate::geometry::bundle::{self, Free};
use crate::geometry::calibrate::Adjustment;
use crate::geometry::camera_model::{CameraModel, INTRINSIC_NAMES, INTRINSICS};
use crate::geometry::face::intersect;
use crate::geometry::pose::Pose;
use crate::geometry::rig_view::{RigView, Sight};
use crate::geometry::selection::Selection;

/// A calibrated camera and, where there was one, the projector beside it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// sqrt(Σ(dx² + dy²)/N) over everything that was used, camera and projector pixels together.
    pub rms_px: f64,
    /// How far the board's middle stands out of its plane, mm, by bending along x and along y;
    /// None where it was taken for flat.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warp_mm: Option<[f64; 2]>,
    /// The camera.
    pub camera: Device,
    /// The projector.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<ProjectorGeometry>,
    /// Covariance of everything that the views share.
    pub covariance: Covariance,
    /// Fit and pose of each view, in the order of the observations.
    pub views: Vec<ViewFit>,
    /// Points whose residual is beyond the others' scatter; they were left out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outliers: Vec<Outlier>,
    /// The observations, outliers included.
    pub observations: Vec<RigView>,
}

/// One calibrated device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Device {
    /// sqrt(Σ(dx² + dy²)/N) over its points, in its own pixels.
    pub rms_px: f64,
    /// 1-sigma of one coordinate of one point, in its own pixels, from the residuals' redundancy.
    pub noise_px: f64,
    /// How its distortion was chosen.
    pub selection: Selection,
    /// 1-sigma of the intrinsics, in the order of [`CameraModel::parameters`]; 0 where held.
    pub standard_deviations: [f64; INTRINSICS],
    /// The device.
    pub model: CameraModel,
}

/// A calibrated projector and where it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectorGeometry {
    /// Distance between the centres of projection of camera and projector, mm.
    pub baseline_mm: f64,
    /// Its 1-sigma, mm.
    pub baseline_standard_deviation_mm: f64,
    /// The projector as a camera.
    pub device: Device,
    /// Camera frame to projector frame.
    pub pose: Pose,
    /// 1-sigma of the pose: turn about x, y, z of the projector's frame (radians), shift (mm).
    pub pose_standard_deviations: [f64; 6],
}

/// Covariance with the names of its rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Covariance {
    /// `camera.fx` …, `projector.fx` …, `projector.turn_x` … (radians), `projector.shift_x` …
    /// (mm), `warp.x`, `warp.y` (mm): only what was fitted.
    pub parameters: Vec<String>,
    /// Row by row.
    pub matrix: Vec<Vec<f64>>,
}

/// How well one view is explained, and where its board was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewFit {
    /// The picture's name.
    pub name: String,
    /// sqrt(Σ(dx² + dy²)/N) over its printed corners, camera pixels.
    pub camera_rms_px: f64,
    /// The same over its lit points, projector pixels; None where there are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector_rms_px: Option<f64>,
    /// Board frame to camera frame.
    pub pose: Pose,
    /// 1-sigma of the pose: turn about x, y, z of the camera's frame (radians), shift (mm).
    pub pose_standard_deviations: [f64; 6],
}

/// A point that does not go with the others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outlier {
    /// The picture's name.
    pub view: String,
    /// What kind of point.
    pub sight: Sight,
    /// Its number within its kind.
    pub point: usize,
    /// Seen − explained by the final solution, pixels.
    pub residual_px: [f64; 2],
}

impl Covariance {
    /// The covariance of one pair, 0 where either is not fitted.
    pub fn of(&self, a: &str, b: &str) -> f64 {
        let place = |name: &str| self.parameters.iter().position(|p| p == name);
        let pair = place(a).zip(place(b));
        pair.and_then(|(i, j)| self.matrix.get(i)?.get(j).copied()).unwrap_or(0.0)
    }
}

/// What one point says about the solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointResidual {
    /// Number of its view.
    pub view: usize,
    /// What kind of point.
    pub sight: Sight,
    /// Its number within its kind.
    pub point: usize,
    /// Where it was seen (camera pixels) or lit from (projector pixels, for all but
    /// [`Sight::Printed`]).
    pub pixel: [f64; 2],
    /// Seen − explained, in the same pixels.
    pub residual_px: [f64; 2],
    /// Whether it took part; outliers did not.
    pub used: bool,
}

impl Geometry {
    /// Residuals of every point, view by view.
    pub fn residuals(&self) -> Vec<PointResidual> {
        let left_out: HashSet<(&str, Sight, usize)> =
            self.outliers.iter().map(|o| (o.view.as_str(), o.sight, o.point)).collect();
        let extent = bundle::Extent::of(&self.observations);
        let warp = self.warp_mm.unwrap_or_default();
        let camera = &self.camera.model;
        let mut out = Vec::new();
        for (i, (view, fit)) in self.observations.iter().zip(&self.views).enumerate() {
            let board = &view.board;
            let mut push = |sight, point, seen: [f64; 2], explained: [f64; 2]| {
                let used = !left_out.contains(&(board.name.as_str(), sight, point));
                let residual_px = [seen[0] - explained[0], seen[1] - explained[1]];
                out.push(PointResidual { view: i, sight, point, pixel: seen, residual_px, used });
            };
            let place = |object: [f64; 3]| {
                let [a, b] = extent.bulge(object);
                fit.pose.apply([object[0], object[1], object[2] + a * warp[0] + b * warp[1]])
            };
            for (j, (&p, &seen)) in board.object_points.iter().zip(&board.image_points).enumerate()
            {
                push(Sight::Printed, j, seen, camera.project(place(p)));
            }
            let Some(projector) = &self.projector else { continue };
            let lit = |p: [f64; 3]| projector.device.model.project(projector.pose.apply(p));
            for (j, corner) in view.coded.iter().enumerate() {
                if let Some(&p) = board.object_points.get(corner.corner) {
                    push(Sight::Coded, j, corner.projector_px, lit(place(p)));
                }
            }
            for (j, shown) in view.projected.iter().enumerate() {
                let on_board = intersect(camera, &fit.pose, 0.0, shown.camera_px);
                let explained = on_board.map_or([f64::NAN; 2], |p| lit(fit.pose.apply(p)));
                push(Sight::Projected, j, shown.projector_px, explained);
            }
        }
        out
    }
}

/// sqrt(Σ(dx² + dy²)/N), None for nothing.
fn rms<'a>(residuals: impl Iterator<Item = &'a PointResidual>) -> Option<f64> {
    let (sum, count) = residuals.fold((0.0, 0.0), |(sum, n), r| {
        let [x, y] = r.residual_px;
        (sum + x * x + y * y, n + 1.0)
    });
    (count > 0.0).then(|| (sum / count).sqrt())
}

/// Puts a solved adjustment into its final form.
pub(crate) fn assemble(
    fit: &Adjustment<'_>,
    camera: Selection,
    projector: Option<Selection>,
) -> Result<Geometry> {
    let problem = fit.problem(f64::INFINITY);
    let found = bundle::uncertainty(fit.what, &problem, &fit.state)?;
    let sigma = |i: usize| found.globals[(i, i)].max(0.0).sqrt();
    let spread = |places: &[usize], first: usize| {
        let mut out = [0.0; INTRINSICS];
        places.iter().enumerate().for_each(|(j, &at)| out[at] = sigma(first + j));
        out
    };
    let device = |model, selection, noise_px, standard_deviations| Device {
        rms_px: 0.0,
        noise_px,
        selection,
        standard_deviations,
        model,
    };
    let free = &fit.free;
    let of_camera = spread(&free.camera, 0);
    let mut out = Geometry {
        rms_px: 0.0,
        warp_mm: free.warp.then_some(fit.state.warp_mm),
        camera: device(fit.state.camera, camera, found.sigma[0], of_camera),
        projector: None,
        covariance: Covariance {
            parameters: names(free),
            matrix: found.globals.row_iter().map(|r| r.iter().copied().collect()).collect(),
        },
        views: Vec::new(),
        outliers: Vec::new(),
        observations: fit.views.to_vec(),
    };
    if let (Some((model, pose)), Some(selection), Some(places)) =
        (fit.state.projector, projector, &free.projector)
    {
        let first = free.camera.len();
        let coded = fit.views.iter().any(|v| !v.coded.is_empty());
        let noise = found.sigma[if coded { 1 } else { 2 }];
        let at = first + places.len();
        let (baseline_mm, baseline_standard_deviation_mm) = baseline(&pose, &found.globals, at);
        out.projector = Some(ProjectorGeometry {
            baseline_mm,
            baseline_standard_deviation_mm,
            device: device(model, selection, noise, spread(places, first)),
            pose,
            pose_standard_deviations: std::array::from_fn(|i| sigma(at + i)),
        });
    }
    for (i, (view, pose)) in fit.views.iter().zip(&fit.state.poses).enumerate() {
        out.views.push(ViewFit {
            name: view.board.name.clone(),
            camera_rms_px: 0.0,
            projector_rms_px: None,
            pose: *pose,
            pose_standard_deviations: std::array::from_fn(|k| {
                found.poses[i][(k, k)].max(0.0).sqrt()
            }),
        });
    }
    name_outliers(&mut out, fit);
    fill_rms(&mut out);
    Ok(out)
}

/// The points that were left out, with their residuals under the final solution.
fn name_outliers(out: &mut Geometry, fit: &Adjustment<'_>) {
    out.outliers = out
        .residuals()
        .iter()
        .filter(|r| fit.left_out[r.view].contains(&(r.sight, r.point)))
        .map(|r| Outlier {
            view: fit.views[r.view].board.name.clone(),
            sight: r.sight,
            point: r.point,
            residual_px: r.residual_px,
        })
        .collect();
}

fn fill_rms(out: &mut Geometry) {
    let used: Vec<PointResidual> = out.residuals().into_iter().filter(|r| r.used).collect();
    let seen = |r: &&PointResidual| r.sight == Sight::Printed;
    let lit = |r: &&PointResidual| r.sight != Sight::Printed;
    out.rms_px = rms(used.iter()).unwrap_or(0.0);
    out.camera.rms_px = rms(used.iter().filter(seen)).unwrap_or(0.0);
    if let Some(projector) = &mut out.projector {
        projector.device.rms_px = rms(used.iter().filter(lit)).unwrap_or(0.0);
    }
    for (i, view) in out.views.iter_mut().enumerate() {
        let of_view = || used.iter().filter(|r| r.view == i);
        view.camera_rms_px = rms(of_view().filter(seen)).unwrap_or(0.0);
        view.projector_rms_px = rms(of_view().filter(lit));
    }
}

/// Length of the baseline and its 1-sigma; the pose's six stand at `at` among the globals.
///
/// The baseline is |t|: turning the projector about its own centre leaves it alone, so in the
/// projector's frame its variance is nᵀ C n over the shift alone, n = t/|t|.
fn baseline(pose: &Pose, covariance: &DMatrix<f64>, at: usize) -> (f64, f64) {
    let t = Vector3::from(pose.translation_mm);
    let length = t.norm();
    if length == 0.0 {
        return (0.0, 0.0);
    }
    let n = t / length;
    let shift = Matrix3::from_fn(|i, j| covariance[(at + 3 + i, at + 3 + j)]);
    (length, n.dot(&(shift * n)).max(0.0).sqrt())
}

/// Names of the globals, in their order.
fn names(free: &Free) -> Vec<String> {
    let of = |device: &str, places: &[usize]| -> Vec<String> {
        places.iter().map(|&at| format!("{device}.{}", INTRINSIC_NAMES[at])).collect()
    };
    let mut out = of("camera", &free.camera);
    if let Some(places) = &free.projector {
        out.extend(of("projector", places));
        for what in ["turn", "shift"] {
            out.extend(["x", "y", "z"].map(|axis| format!("projector.{what}_{axis}")));
        }
    }
    if free.warp {
        out.extend(["warp.x".to_owned(), "warp.y".to_owned()]);
    }
    out
}
