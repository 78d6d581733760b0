//! From observed boards to camera and projector: start, adjust, weed out, adjust again.

use crate::error::{CalibrationError, Result};
use crate::geometry::bundle::{self, Extent, Free, KINDS, LeftOut, Problem, State};
use crate::geometry::distortion::Distortion;
use crate::geometry::face::intersect;
use crate::geometry::resection::resect;
use crate::geometry::result::{Geometry, assemble};
use crate::geometry::rig_view::RigView;
use crate::geometry::selection;
use crate::geometry::zhang;

/// Fewest views of a calibration: two leave the principal point open.
const FEWEST_VIEWS: usize = 3;

/// A residual longer than this many robust sigmas is an outlier. Of normal residuals in the plane
/// exp(−6²/2), one in 65 million, is as long; real corners have longer tails (the longest of
/// Zhang's 1280 are 5.2 robust sigmas), while a corner found in the wrong place is off by tens.
const OUTLIER_SIGMAS: f64 = 6.0;

/// Boards must be turned against each other by this much at least, degrees: what a board parallel
/// to another says about the focal length comes from the lens's distortion alone.
const LEAST_TURN_DEG: f64 = 5.0;

/// 1-sigma of the focal length over itself beyond which there is no calibration to speak of.
const WIDEST_FOCAL_LENGTH: f64 = 0.05;

/// Huber's limit while outliers are sought, in sigmas.
const HUBER_SIGMAS: f64 = 2.5;

/// What a calibration is to solve for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Choice {
    /// The camera's distortion; the simplest that cross-validation supports where None.
    pub camera: Option<Distortion>,
    /// The projector's, likewise.
    pub projector: Option<Distortion>,
    /// Whether the camera's rows and columns may stand at other than right angles.
    pub skew: bool,
    /// Whether the board may be bent.
    pub warp: bool,
}

/// Calibrates a camera of `camera_px` = [width, height] pixels and, where its size is given, a
/// projector, from views of a board in at least three poses.
///
/// Zhang's closed form and the direct linear transformation give a start; one bundle adjustment
/// over everything follows. Where some residuals are far beyond the scatter of the others it is
/// done with a robust loss, they are named and left out, and what remains is adjusted by plain
/// least squares, to convergence. The noise of camera and projector is estimated from the
/// residuals and weighs them against each other.
///
/// # Errors
/// Fewer than three views, unmatched points, points outside of the picture (which betrays views of
/// another size), views that leave something undetermined (all boards parallel), or a distortion
/// that folds the picture.
pub fn calibrate_geometry(
    views: &[RigView],
    camera_px: [usize; 2],
    projector_px: Option<[usize; 2]>,
    choice: Choice,
) -> Result<Geometry> {
    check(views, camera_px, projector_px)?;
    let boards: Vec<_> = views.iter().map(|v| v.board.clone()).collect();
    let (model, poses) = zhang::closed_form(&boards, camera_px)?;
    let mut fit = Adjustment {
        what: "camera calibration",
        views,
        left_out: vec![LeftOut::new(); views.len()],
        free: Free { camera: Vec::new(), projector: None, warp: choice.warp },
        sigma: [1.0; KINDS],
        extent: Extent::of(views),
        state: State { camera: model, projector: None, warp_mm: [0.0; 2], poses },
    };
    let camera = selection::choose(
        &mut fit,
        choice.camera,
        &Distortion::ALL,
        |free, d| free.camera = d.free(choice.skew),
        |state| &state.camera,
    )?;
    fit.weed()?;
    fit.refuse_open_focal_length()?;
    let mut projector = None;
    if let Some(size) = projector_px {
        fit.what = "projector calibration";
        fit.state.projector = Some(resect(&fit.lit_points(), size)?);
        // Projectors distort little and views are few: no denominators.
        projector = Some(selection::choose(
            &mut fit,
            choice.projector,
            &Distortion::ALL[..5],
            |free, d| free.projector = Some(d.free(false)),
            |state| state.projector.as_ref().map_or(&state.camera, |(model, _)| model),
        )?);
        fit.weed()?;
    }
    assemble(&fit, camera, projector)
}

/// A problem together with where its solution stands.
#[derive(Clone)]
pub(crate) struct Adjustment<'a> {
    pub what: &'static str,
    pub views: &'a [RigView],
    pub left_out: Vec<LeftOut>,
    pub free: Free,
    pub sigma: [f64; KINDS],
    pub extent: Extent,
    pub state: State,
}

impl Adjustment<'_> {
    pub fn problem(&self, huber: f64) -> Problem<'_> {
        let (views, left_out, free) = (self.views, &self.left_out, &self.free);
        Problem { views, left_out, free, sigma: self.sigma, huber, extent: self.extent }
    }

    /// Plain least squares; the noise of each kind of residual follows from the residuals.
    pub fn settle(&mut self) -> Result<()> {
        // With one kind alone its weight changes nothing.
        let rounds = if self.free.projector.is_some() { 3 } else { 1 };
        for _ in 0..rounds {
            let start = self.state.clone();
            self.state = bundle::solve(self.what, &self.problem(f64::INFINITY), start)?;
            let found = bundle::uncertainty(self.what, &self.problem(f64::INFINITY), &self.state);
            self.sigma = found?.sigma;
        }
        Ok(())
    }

    /// [`Self::settle`]; where some residuals are far beyond the scatter of the others, solves
    /// robustly, leaves them out, and settles again.
    pub fn weed(&mut self) -> Result<()> {
        self.settle()?;
        let plain = self.sigma;
        self.sigma = bundle::robust_sigma(&self.problem(f64::INFINITY), &self.state);
        if self.far().is_empty() {
            self.sigma = plain;
            return Ok(());
        }
        // The scatter of the good ones and the fit to them settle each other in a few rounds.
        for _ in 0..4 {
            let start = self.state.clone();
            self.state = bundle::solve(self.what, &self.problem(HUBER_SIGMAS), start)?;
            self.sigma = bundle::robust_sigma(&self.problem(HUBER_SIGMAS), &self.state);
        }
        for (view, r) in self.far() {
            self.left_out[view].insert((r.sight, r.index));
        }
        self.settle()
    }

    fn far(&self) -> Vec<(usize, bundle::Residual)> {
        bundle::far_residuals(&self.problem(f64::INFINITY), &self.state, OUTLIER_SIGMAS)
    }

    /// Views that differ in place only say next to nothing about the focal length.
    fn refuse_open_focal_length(&self) -> Result<()> {
        let problem = self.problem(f64::INFINITY);
        let found = bundle::uncertainty(self.what, &problem, &self.state)?;
        let share = found.globals[(0, 0)].max(0.0).sqrt() / self.state.camera.fx;
        let normals: Vec<[f64; 3]> =
            self.state.poses.iter().map(|p| p.rotate([0.0, 0.0, 1.0])).collect();
        let angle = |a: &[f64; 3], b: &[f64; 3]| {
            let dot: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
            dot.clamp(-1.0, 1.0).acos().to_degrees()
        };
        let widest = normals
            .iter()
            .flat_map(|a| normals.iter().map(move |b| angle(a, b)))
            .fold(0.0, f64::max);
        let reason = if widest < LEAST_TURN_DEG {
            format!("the boards are all parallel to each other to {widest:.1} degrees")
        } else if share > WIDEST_FOCAL_LENGTH {
            format!("the views leave the focal length open by {:.0} %", 100.0 * share)
        } else {
            return Ok(());
        };
        Err(CalibrationError::Degenerate { what: self.what, reason })
    }

    /// Every lit point in the camera's frame (mm) with its projector pixel.
    fn lit_points(&self) -> Vec<([f64; 3], [f64; 2])> {
        let mut out = Vec::new();
        for (view, pose) in self.views.iter().zip(&self.state.poses) {
            let corner = |c: usize| pose.apply(view.board.object_points[c]);
            out.extend(view.coded.iter().map(|c| (corner(c.corner), c.projector_px)));
            for point in &view.projected {
                let on_board = intersect(&self.state.camera, pose, 0.0, point.camera_px);
                out.extend(on_board.map(|p| (pose.apply(p), point.projector_px)));
            }
        }
        out
    }
}

fn check(views: &[RigView], camera: [usize; 2], projector: Option<[usize; 2]>) -> Result<()> {
    let enough = |what, found| {
        let needed = FEWEST_VIEWS;
        if found < needed {
            return Err(CalibrationError::TooFewViews { what, needed, found });
        }
        Ok(())
    };
    enough("camera calibration", views.len())?;
    for view in views {
        let board = &view.board;
        board.check(4)?;
        let outside = |p: &&[f64; 2]| {
            !(-0.5..camera[0] as f64 + 0.5).contains(&p[0])
                || !(-0.5..camera[1] as f64 + 0.5).contains(&p[1])
        };
        if let Some([x, y]) = board.image_points.iter().find(outside) {
            return Err(CalibrationError::Mismatch {
                picture: board.name.clone(),
                expected: format!("points within {}x{} pixels", camera[0], camera[1]),
                found: format!("one at ({x:.1}, {y:.1})"),
            });
        }
        let count = board.object_points.len();
        let finite = |p: &[f64]| p.iter().all(|v| v.is_finite());
        let sound =
            view.coded.iter().all(|c| {
                c.corner < count && finite(&c.projector_px) && finite(c.slope.as_flattened())
            }) && view.projected.iter().all(|p| finite(&p.camera_px) && finite(&p.projector_px));
        if !sound {
            return Err(CalibrationError::Mismatch {
                picture: board.name.clone(),
                expected: format!("lit points with finite pixels, on corners below {count}"),
                found: "one without".into(),
            });
        }
    }
    for (i, view) in views.iter().enumerate() {
        let same = |other: &&RigView| other.board.image_points == view.board.image_points;
        if let Some(other) = views[..i].iter().find(same) {
            return Err(CalibrationError::Mismatch {
                picture: view.board.name.clone(),
                expected: "another pose of the board in every picture".into(),
                found: format!("the very points of {}", other.board.name),
            });
        }
    }
    if projector.is_some() {
        let lit = views.iter().filter(|v| v.coded.len() + v.projected.len() >= 4);
        enough("projector calibration", lit.count())?;
    }
    Ok(())
}
