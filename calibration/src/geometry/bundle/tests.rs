//! Analytic derivatives against central differences, on every kind of residual at once.

use super::*;
use crate::geometry::camera::View;
use crate::geometry::distortion::Distortion;
use crate::geometry::rig_view::{CodedCorner, ProjectedPoint};

/// A rig with everything that can move, at residuals of some pixels.
fn rig() -> (Vec<RigView>, State, Free) {
    let intrinsics = |f: f64, cy: f64| {
        let distortion = [-0.2, 0.08, 0.002, -0.001, 0.03, 0.02, -0.01, 0.004];
        let (fx, fy) = (f, 1.01 * f);
        let (width, height) = (640, 480);
        CameraModel { width, height, fx, fy, cx: 310.0, cy, skew: 0.7, distortion }
    };
    let state = State {
        camera: intrinsics(700.0, 245.0),
        projector: Some((
            intrinsics(900.0, 600.0),
            Pose::from_rotation_vector([0.2, 0.25, -0.04], [-150.0, 30.0, 25.0]),
        )),
        warp_mm: [0.4, -0.3],
        poses: vec![
            Pose::from_rotation_vector([0.3, -0.2, 0.1], [-60.0, -40.0, 500.0]),
            Pose::from_rotation_vector([-0.25, 0.35, 1.0], [30.0, -70.0, 600.0]),
        ],
    };
    let object_points: Vec<[f64; 3]> =
        (0..20).map(|i| [25.0 * f64::from(i % 5), 25.0 * f64::from(i / 5), 0.0]).collect();
    let (projector, to_projector) = state.projector.unwrap();
    let views = state.poses.iter().enumerate().map(|(v, pose)| {
        // Off by a different half pixel or so everywhere.
        let off = |i: usize, p: [f64; 2]| {
            let phase = (7 * i + 3 * v) as f64;
            [p[0] + 0.6 * phase.sin(), p[1] + 0.6 * phase.cos()]
        };
        let lit = |p| projector.project(to_projector.apply(pose.apply(p)));
        let image_points: Vec<[f64; 2]> = object_points
            .iter()
            .enumerate()
            .map(|(i, &p)| off(i, state.camera.project(pose.apply(p))))
            .collect();
        RigView {
            coded: (0..20)
                .step_by(3)
                .map(|corner| CodedCorner {
                    corner,
                    projector_px: off(corner + 1, lit(object_points[corner])),
                    slope: [[1.3, 0.2], [-0.1, 1.2]],
                })
                .collect(),
            projected: (0..6)
                .map(|i| [120.0 + 10.0 * f64::from(i), 20.0 * f64::from(i % 3), 0.0])
                .enumerate()
                .map(|(i, p)| ProjectedPoint {
                    camera_px: off(i + 2, state.camera.project(pose.apply(p))),
                    projector_px: lit(p),
                })
                .collect(),
            board: View {
                name: format!("view{v}"),
                image_points,
                object_points: object_points.clone(),
            },
        }
    });
    let all = Distortion::Rational.free(true);
    let free = Free { camera: all.clone(), projector: Some(all), warp: true };
    (views.collect(), state, free)
}

/// The gradient JᵀWr and the diagonal of JᵀWJ, unknown by unknown.
#[test]
fn derivatives_agree_with_central_differences() {
    let (views, state, free) = rig();
    let left_out = vec![LeftOut::new(); views.len()];
    let problem = Problem {
        views: &views,
        left_out: &left_out,
        free: &free,
        sigma: [0.5, 0.8, 0.6],
        huber: f64::INFINITY,
        extent: Extent::of(&views),
    };
    let n = free.len();
    let moved = |at: usize, by: f64| {
        let mut globals = vec![0.0; n];
        let mut poses = vec![[0.0; 6]; 2];
        if at < n {
            globals[at] = by
        } else {
            poses[(at - n) / 6][(at - n) % 6] = by
        }
        let state = state.moved(&free, &globals, &poses);
        let each = |v| terms::residuals(&problem, &state, v).unwrap();
        (0..2).flat_map(each).collect::<Vec<_>>()
    };
    let parts: Vec<_> = (0..2).map(|v| terms::normal(&problem, &state, v, false)).collect();
    let here = moved(0, 0.0);
    assert_eq!(here.len(), 2 * (20 + 7 + 6));
    let mut worst = 0.0_f64;
    for at in 0..n + 12 {
        // Turns in radians need smaller steps than shifts in mm and focal lengths in pixels.
        let by = 1e-6 * if at < n { 10.0 } else { 1.0 };
        let (up, down) = (moved(at, by), moved(at, -by));
        let (mut gradient, mut square) = (0.0, 0.0);
        for ((u, d), r) in up.iter().zip(&down).zip(&here) {
            let weight = problem.sigma[r.sight as usize].powi(-2);
            for a in 0..2 {
                let slope = (u.px[a] - d.px[a]) / (2.0 * by);
                gradient += weight * slope * r.px[a];
                square += weight * slope * slope;
            }
        }
        let (found, found_square) = if at < n {
            let sum = |f: &dyn Fn(&terms::Normal) -> f64| parts.iter().map(|p| f(&p[0])).sum();
            (sum(&|p| p.globals_right[at]), sum(&|p| p.globals[(at, at)]))
        } else {
            let (view, k): (usize, usize) = ((at - n) / 6, (at - n) % 6);
            (parts[view][0].pose_right[k], parts[view][0].pose[(k, k)])
        };
        // Differences of residuals of 1e3 px with 1e-13 rounding over a step of 1e-6 or 1e-5.
        let scale = square.sqrt() * here.len() as f64;
        worst = worst.max((gradient - found).abs() / scale);
        assert!((gradient - found).abs() < 1e-6 * scale, "{at}: {gradient} {found}");
        assert!((square / found_square - 1.0).abs() < 1e-4, "{at}: {square} {found_square}");
    }
    eprintln!("largest difference of a gradient {worst:.1e} of its scale");
}

/// What is left out takes no part: neither in the cost nor in the system.
#[test]
fn points_that_are_left_out_do_not_count() {
    let (mut views, state, free) = rig();
    let mut left_out = vec![LeftOut::new(); 2];
    left_out[0].insert((Sight::Printed, 4));
    left_out[1].insert((Sight::Coded, 2));
    left_out[1].insert((Sight::Projected, 0));
    let cost = |views: &[RigView]| {
        let problem = Problem {
            views,
            left_out: &left_out,
            free: &free,
            sigma: [1.0; KINDS],
            huber: f64::INFINITY,
            extent: Extent::of(views),
        };
        let right: f64 =
            (0..2).map(|v| terms::normal(&problem, &state, v, false)[0].globals_right.norm()).sum();
        (terms::cost(&problem, &state, 0) + terms::cost(&problem, &state, 1), right)
    };
    let before = cost(&views);
    // Corner 4 has no coded twin; any error there must go unnoticed.
    views[0].board.image_points[4][0] += 50.0;
    views[1].coded[2].projector_px[1] += 50.0;
    views[1].projected[0].camera_px[0] += 5.0;
    assert_eq!(cost(&views), before);
    views[0].board.image_points[5][0] += 50.0;
    assert_ne!(cost(&views), before);
}
