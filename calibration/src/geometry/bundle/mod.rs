//! Bundle adjustment: camera, projector, every pose of the board and its warp, all at once.
//!
//! The unknowns that all views share (intrinsics of both devices, the projector's place, the
//! board's warp) are the globals; each view adds six of its own. Views touch each other through
//! the globals only, so the normal equations are reduced to the globals by a Schur complement
//! over the poses (Triggs et al. 2000, section 6), and cost grows with the number of views and
//! not with its cube. Derivatives are analytic.
//!
//! Three kinds of things are seen, each with its own noise:
//! - a printed corner by the camera: r = c − π_c(X), camera pixels;
//! - the projector pixel that lights a printed corner, read off the picture around the corner:
//!   r = p − S (c − π_c(X)) − π_p(X), projector pixels. S = ∂p/∂c takes out what an error in
//!   finding the corner does to the projector pixel read there, so that the error of one printed
//!   corner counts once;
//! - a projected point somewhere on the board's plane, its projector pixel exactly known:
//!   r = c − π_c(Y), camera pixels, Y being where the projector's ray meets the plane.

mod covariance;
mod scatter;
mod solve;
mod terms;
#[cfg(test)]
mod tests;

use crate::error::Result;
use crate::geometry::camera::View;
use crate::geometry::camera_model::{CameraModel, INTRINSICS};
use crate::geometry::pose::Pose;
use crate::geometry::rig_view::{RigView, Sight};

pub(crate) use covariance::uncertainty;
pub(crate) use scatter::{far_residuals, robust_sigma};
pub(crate) use solve::solve;
pub(crate) use terms::residuals;

/// What is to be explained and what may move.
#[derive(Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub views: &'a [RigView],
    /// What is left out of each view.
    pub left_out: &'a [LeftOut],
    pub free: &'a Free,
    /// 1-sigma of each kind of residual, in its pixels.
    pub sigma: [f64; KINDS],
    /// Residuals beyond this many sigmas pull with constant force (Huber 1964); infinity for
    /// plain least squares.
    pub huber: f64,
    /// Middle and half extent of the board, mm: where the warp is 1 and 0.
    pub extent: Extent,
}

/// Kinds of residuals.
pub(crate) const KINDS: usize = 3;

/// Points of one view that do not take part, by kind and number.
pub(crate) type LeftOut = std::collections::HashSet<(Sight, usize)>;

/// One residual.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Residual {
    pub sight: Sight,
    /// Number of the point within its kind.
    pub index: usize,
    /// Seen − explained, pixels of the camera, of the projector for coded corners.
    pub px: [f64; 2],
}

/// The globals that may move.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Free {
    /// Places in [`CameraModel::parameters`] of the camera.
    pub camera: Vec<usize>,
    /// And of the projector, if there is one; its pose moves with it.
    pub projector: Option<Vec<usize>>,
    /// Whether the board may be bent.
    pub warp: bool,
}

impl Free {
    /// Number of globals.
    pub fn len(&self) -> usize {
        self.camera.len() + self.projector_len() + if self.warp { 2 } else { 0 }
    }

    fn projector_len(&self) -> usize {
        self.projector.as_ref().map_or(0, |p| p.len() + 6)
    }

    /// Where the warp stands among the globals.
    fn warp_at(&self) -> usize {
        self.camera.len() + self.projector_len()
    }
}

/// The board's middle and half its width and height, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extent {
    middle: [f64; 2],
    half: [f64; 2],
}

impl Extent {
    pub fn of(views: &[RigView]) -> Self {
        let points = || views.iter().flat_map(|v| &v.board.object_points);
        let side = |a: usize, pick: fn(f64, f64) -> f64, from: f64| {
            points().map(|p| p[a]).fold(from, pick)
        };
        let mut out = Self { middle: [0.0; 2], half: [1.0; 2] };
        for a in 0..2 {
            let (least, most) = (side(a, f64::min, f64::MAX), side(a, f64::max, f64::MIN));
            if most > least {
                out.middle[a] = (least + most) / 2.0;
                out.half[a] = (most - least) / 2.0;
            }
        }
        out
    }

    /// How much of the two warps there is at a point: 1 in the middle, 0 on the outer corners.
    pub fn bulge(&self, p: [f64; 3]) -> [f64; 2] {
        std::array::from_fn(|a| 1.0 - ((p[a] - self.middle[a]) / self.half[a]).powi(2))
    }
}

/// Values of all unknowns.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct State {
    pub camera: CameraModel,
    /// The projector and its pose: camera frame to projector frame.
    pub projector: Option<(CameraModel, Pose)>,
    /// How far the board's middle stands out of its plane, mm, from bending along x and along y.
    pub warp_mm: [f64; 2],
    /// Board frame to camera frame, for each view.
    pub poses: Vec<Pose>,
}

impl State {
    /// The state after a step in globals and poses.
    fn moved(&self, free: &Free, globals: &[f64], poses: &[[f64; 6]]) -> Self {
        let mut out = self.clone();
        let bend = |model: &CameraModel, places: &[usize], step: &[f64]| {
            let mut all: [f64; INTRINSICS] = model.parameters();
            places.iter().zip(step).for_each(|(&at, s)| all[at] += s);
            CameraModel::from_parameters([model.width, model.height], &all)
        };
        out.camera = bend(&self.camera, &free.camera, globals);
        if let (Some(places), Some((model, pose))) = (&free.projector, &self.projector) {
            let at = free.camera.len();
            let moved = bend(model, places, &globals[at..]);
            let at = at + places.len();
            let step: [f64; 6] = std::array::from_fn(|i| globals[at + i]);
            out.projector = Some((moved, pose.nudged(&step)));
        }
        if free.warp {
            let at = free.warp_at();
            out.warp_mm = [self.warp_mm[0] + globals[at], self.warp_mm[1] + globals[at + 1]];
        }
        for (pose, step) in out.poses.iter_mut().zip(poses) {
            *pose = pose.nudged(step);
        }
        out
    }
}

/// The pose of one board under a camera that is known.
pub(crate) fn locate(camera: &CameraModel, board: &View, start: Pose) -> Result<Pose> {
    let views = [RigView::camera_only(board.clone())];
    let free = Free { camera: Vec::new(), projector: None, warp: false };
    let problem = Problem {
        views: &views,
        left_out: &[LeftOut::new()],
        free: &free,
        sigma: [1.0; KINDS],
        huber: f64::INFINITY,
        extent: Extent::of(&views),
    };
    let poses = vec![start];
    let start = State { camera: *camera, projector: None, warp_mm: [0.0; 2], poses };
    let solved = solve("locating a board", &problem, start)?;
    Ok(solved.poses[0])
}
