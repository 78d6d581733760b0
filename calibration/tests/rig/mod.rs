//! A camera and a projector whose truth is known, and what they see of a board.

use calibration::{
    CameraModel, Choice, CodedCorner, Distortion, Pose, ProjectedPoint, RigView, View,
};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub const CAMERA_PX: [usize; 2] = [1280, 1024];
pub const PROJECTOR_PX: [usize; 2] = [1024, 768];

pub fn camera() -> CameraModel {
    let mut out = CameraModel::pinhole(CAMERA_PX, [1500.0, 1506.0], [632.0, 520.0]);
    out.distortion = [-0.18, 0.11, 8e-4, -5e-4, 0.0, 0.0, 0.0, 0.0];
    out
}

/// Lens-shifted: the principal point lies below the picture.
pub fn projector() -> CameraModel {
    let mut out = CameraModel::pinhole(PROJECTOR_PX, [1890.0, 1895.0], [505.0, 850.0]);
    out.distortion = [-0.06, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    out
}

/// Camera frame to projector frame.
pub fn to_projector() -> Pose {
    Pose::from_rotation_vector([0.2, 0.22, 0.01], [-300.0, 90.0, 60.0])
}

/// Boards of 9x7 corners, 25 mm apart, tilted about another axis and elsewhere in each view.
pub fn poses(count: usize) -> Vec<Pose> {
    (0..count)
        .map(|i| {
            let turn = 2.4 * i as f64;
            let tilt = 0.35 + 0.25 * (1.7 * i as f64).sin();
            let middle = Pose::from_rotation_vector(
                [tilt * turn.cos(), tilt * turn.sin(), 0.2 * (0.9 * i as f64).cos()],
                [110.0 * (3.1 * turn).sin(), 80.0 * (2.3 * turn).cos(), 620.0 + 90.0 * turn.sin()],
            );
            Pose::from_rotation_vector([0.0; 3], [-100.0, -75.0, 0.0]).then(&middle)
        })
        .collect()
}

#[derive(Clone, Copy, PartialEq)]
pub enum Light {
    Coded,
    Projected,
}

pub struct Noise {
    pub rng: ChaCha8Rng,
    pub camera_px: f64,
    pub code_px: f64,
}

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self { rng: ChaCha8Rng::seed_from_u64(seed), camera_px: 0.1, code_px: 0.05 }
    }

    fn off(&mut self, p: [f64; 2], sigma: f64) -> [f64; 2] {
        let mut draw = || -> f64 { StandardNormal.sample(&mut self.rng) };
        [p[0] + sigma * draw(), p[1] + sigma * draw()]
    }
}

/// ∂(projector pixel)/∂(camera pixel) around a point of the board.
fn slope(pose: &Pose, p: [f64; 3]) -> [[f64; 2]; 2] {
    let both = |x: f64, y: f64| {
        let point = pose.apply([p[0] + x, p[1] + y, 0.0]);
        (camera().project(point), projector().project(to_projector().apply(point)))
    };
    let step = 1e-3;
    let along = |x: f64, y: f64| {
        let ((c1, p1), (c0, p0)) = (both(x, y), both(-x, -y));
        ([c1[0] - c0[0], c1[1] - c0[1]], [p1[0] - p0[0], p1[1] - p0[1]])
    };
    let ((cx, px), (cy, py)) = (along(step, 0.0), along(0.0, step));
    let determinant = cx[0] * cy[1] - cy[0] * cx[1];
    [0, 1].map(|a| {
        [
            (px[a] * cy[1] - py[a] * cx[1]) / determinant,
            (py[a] * cx[0] - px[a] * cy[0]) / determinant,
        ]
    })
}

/// What is seen of a board. The code is read where the corner was found: an error of finding the
/// corner moves the projector pixel that is read there.
pub fn observe(pose: &Pose, name: String, light: Light, noise: &mut Noise) -> RigView {
    let object_points: Vec<[f64; 3]> =
        (0..63).map(|i| [25.0 * f64::from(i % 9), 25.0 * f64::from(i / 9), 0.0]).collect();
    let (camera, projector) = (camera(), projector());
    let lit = |p: [f64; 3]| projector.project(to_projector().apply(pose.apply(p)));
    let mut image_points = Vec::new();
    let (mut coded, mut projected) = (Vec::new(), Vec::new());
    for (corner, &p) in object_points.iter().enumerate() {
        let exact = camera.project(pose.apply(p));
        let seen = noise.off(exact, noise.camera_px);
        image_points.push(seen);
        let slope = slope(pose, p);
        let moved = [seen[0] - exact[0], seen[1] - exact[1]];
        let read = lit(p);
        let read = [0, 1].map(|a| read[a] + slope[a][0] * moved[0] + slope[a][1] * moved[1]);
        if light == Light::Coded {
            let projector_px = noise.off(read, noise.code_px);
            coded.push(CodedCorner { corner, projector_px, slope });
        }
    }
    if light == Light::Projected {
        for i in 0..48 {
            let p = [10.0 + 25.0 * f64::from(i % 8), 12.0 + 25.0 * f64::from(i / 8), 0.0];
            let camera_px = noise.off(camera.project(pose.apply(p)), noise.camera_px);
            projected.push(ProjectedPoint { camera_px, projector_px: lit(p) });
        }
    }
    RigView { board: View { name, image_points, object_points }, coded, projected }
}

pub fn rig(count: usize, light: Light, noise: &mut Noise) -> Vec<RigView> {
    let poses = poses(count);
    poses.iter().enumerate().map(|(i, p)| observe(p, format!("pose{i}"), light, noise)).collect()
}

pub const CHOICE: Choice = Choice {
    camera: Some(Distortion::K1K2P1P2),
    projector: Some(Distortion::K1K2),
    skew: false,
    warp: false,
};
