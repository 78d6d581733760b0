//! Residuals of one view and their derivatives.

use super::{KINDS, Problem, Residual, State};
use crate::geometry::camera_model::{INTRINSICS, Projection};
use crate::geometry::face::intersect;
use crate::geometry::pose::Pose;
use crate::geometry::rig_view::{ProjectedPoint, Sight};
use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

/// Derivatives of one residual by the view's pose and by the globals.
pub(super) struct Row {
    pub pose: [f64; 6],
    pub globals: [f64; MOST_GLOBALS],
}

/// Intrinsics of both devices, the projector's pose, the warp.
const MOST_GLOBALS: usize = 2 * INTRINSICS + 6 + 2;

/// One residual pair with its derivatives.
struct Pair {
    sight: Sight,
    residual: [f64; 2],
    rows: [Row; 2],
}

/// One view's share of the normal equations Jᵀ W J and Jᵀ W r.
pub(super) struct Normal {
    pub pose: Matrix6<f64>,
    /// 6 rows, a column for each global.
    pub mixed: DMatrix<f64>,
    pub globals: DMatrix<f64>,
    pub pose_right: Vector6<f64>,
    pub globals_right: DVector<f64>,
}

impl Normal {
    pub fn zeros(n: usize) -> Self {
        Self {
            pose: Matrix6::zeros(),
            mixed: DMatrix::zeros(6, n),
            globals: DMatrix::zeros(n, n),
            pose_right: Vector6::zeros(),
            globals_right: DVector::zeros(n),
        }
    }

    fn add(&mut self, pair: &Pair, weight: f64) {
        let n = self.globals.ncols();
        let [first, second] = &pair.rows;
        // A corner seen by the camera does not depend on the projector: most entries are zero.
        let mut active = [0; MOST_GLOBALS];
        let mut count = 0;
        for j in 0..n {
            if first.globals[j] != 0.0 || second.globals[j] != 0.0 {
                active[count] = j;
                count += 1;
            }
        }
        let active = &active[..count];
        let [r, s] = pair.residual.map(|r| weight * r);
        for a in 0..6 {
            let (p, q) = (weight * first.pose[a], weight * second.pose[a]);
            for b in 0..6 {
                self.pose[(a, b)] += p * first.pose[b] + q * second.pose[b];
            }
            for &j in active {
                self.mixed[(a, j)] += p * first.globals[j] + q * second.globals[j];
            }
            self.pose_right[a] += r * first.pose[a] + s * second.pose[a];
        }
        let square = self.globals.as_mut_slice();
        for (k, &i) in active.iter().enumerate() {
            let (p, q) = (weight * first.globals[i], weight * second.globals[i]);
            let column = &mut square[i * n..(i + 1) * n];
            // The lower triangle; the solver mirrors it once.
            for &j in &active[k..] {
                column[j] += p * first.globals[j] + q * second.globals[j];
            }
            self.globals_right[i] += r * first.globals[i] + s * second.globals[i];
        }
    }
}

/// Huber's cost of a residual of squared length `squared` (in sigmas) and the weight under which
/// a least-squares step descends it.
fn huber(squared: f64, limit: f64) -> (f64, f64) {
    let size = squared.sqrt();
    if size <= limit { (squared, 1.0) } else { (limit * (2.0 * size - limit), limit / size) }
}

/// Cost of one view, half of −log likelihood up to a constant; infinite where a point has no
/// picture.
pub(super) fn cost(problem: &Problem<'_>, state: &State, view: usize) -> f64 {
    residuals(problem, state, view).map_or(f64::INFINITY, |all| {
        all.iter()
            .map(|Residual { sight, px: [a, b], .. }| {
                let squared = (a * a + b * b) / problem.sigma[*sight as usize].powi(2);
                huber(squared, problem.huber).0
            })
            .sum()
    })
}

/// Residuals of a view; None where a point lies behind a device.
pub(crate) fn residuals(
    problem: &Problem<'_>,
    state: &State,
    view: usize,
) -> Option<Vec<Residual>> {
    let (seen, pose) = (&problem.views[view], &state.poses[view]);
    let board = &seen.board;
    let minus = |a: [f64; 2], b: [f64; 2]| [a[0] - b[0], a[1] - b[1]];
    let place = |object: [f64; 3]| pose.apply(warped(problem, state, object));
    let mut out =
        Vec::with_capacity(board.image_points.len() + seen.coded.len() + seen.projected.len());
    let mut push = |sight, index, px: [f64; 2]| {
        out.push(Residual { sight, index, px });
        px[0].is_finite() && px[1].is_finite()
    };
    let used = |sight, index| !problem.left_out[view].contains(&(sight, index));
    for (i, (&object, &pixel)) in board.object_points.iter().zip(&board.image_points).enumerate() {
        if used(Sight::Printed, i) {
            let px = minus(pixel, state.camera.project(place(object)));
            push(Sight::Printed, i, px).then_some(())?;
        }
    }
    if let Some((projector, to_projector)) = &state.projector {
        for (i, corner) in seen.coded.iter().enumerate() {
            if used(Sight::Coded, i) {
                let point = place(board.object_points[corner.corner]);
                let lit = projector.project(to_projector.apply(point));
                let missed = minus(board.image_points[corner.corner], state.camera.project(point));
                let carried = corner.slope.map(|s| s[0] * missed[0] + s[1] * missed[1]);
                let px = minus(minus(corner.projector_px, carried), lit);
                push(Sight::Coded, i, px).then_some(())?;
            }
        }
        let to_board = pose.then(to_projector);
        for (i, point) in seen.projected.iter().enumerate() {
            if used(Sight::Projected, i) {
                let on_board = intersect(projector, &to_board, 0.0, point.projector_px)?;
                let px = minus(point.camera_px, state.camera.project(pose.apply(on_board)));
                push(Sight::Projected, i, px).then_some(())?;
            }
        }
    }
    Some(out)
}

/// The view's share of the normal equations, for each kind of residual where `apart`, else all
/// in the first.
pub(super) fn normal(
    problem: &Problem<'_>,
    state: &State,
    view: usize,
    apart: bool,
) -> [Normal; KINDS] {
    let n = problem.free.len();
    let mut out = [n, if apart { n } else { 0 }, if apart { n } else { 0 }].map(Normal::zeros);
    for_each_pair(problem, state, view, |pair| {
        let [a, b] = pair.residual;
        let inverse = problem.sigma[pair.sight as usize].powi(-2);
        let (_, weight) = huber((a * a + b * b) * inverse, problem.huber);
        out[if apart { pair.sight as usize } else { 0 }].add(&pair, weight * inverse);
    });
    out
}

fn warped(problem: &Problem<'_>, state: &State, object: [f64; 3]) -> [f64; 3] {
    let [a, b] = problem.extent.bulge(object);
    [object[0], object[1], object[2] + a * state.warp_mm[0] + b * state.warp_mm[1]]
}

/// d(pixel)/d(point) · m, m holding one column a parameter.
fn chain<const N: usize>(by_point: &[[f64; 3]; 2], m: &[[f64; N]; 3]) -> [[f64; N]; 2] {
    by_point
        .map(|row| std::array::from_fn(|k| row[0] * m[0][k] + row[1] * m[1][k] + row[2] * m[2][k]))
}

/// ∂(moved point)/∂(turn, shift) where the pose is nudged: turn × (p − t), and the shift itself.
fn by_nudge(point: [f64; 3], pose: &Pose) -> [[f64; 6]; 3] {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| point[i] - pose.translation_mm[i]);
    [[0.0, z, -y, 1.0, 0.0, 0.0], [-z, 0.0, x, 0.0, 1.0, 0.0], [y, -x, 0.0, 0.0, 0.0, 1.0]]
}

fn times(rotation: &[[f64; 3]; 3], m: &[[f64; 6]; 3]) -> [[f64; 6]; 3] {
    rotation
        .map(|row| std::array::from_fn(|k| row[0] * m[0][k] + row[1] * m[1][k] + row[2] * m[2][k]))
}

fn multiply<const N: usize>(s: &[[f64; 2]; 2], m: &[[f64; N]; 2]) -> [[f64; N]; 2] {
    s.map(|row| std::array::from_fn(|k| row[0] * m[0][k] + row[1] * m[1][k]))
}

/// Derivatives of a pixel by everything that moves it.
struct Slopes {
    pose: [[f64; 6]; 2],
    camera: Option<Projection>,
    projector: Option<Projection>,
    place: Option<[[f64; 6]; 2]>,
    warp: [[f64; 2]; 2],
}

/// Turns slopes of π into rows of ∂r/∂unknowns, r = seen − π.
fn rows(problem: &Problem<'_>, slopes: &Slopes) -> [Row; 2] {
    let free = problem.free;
    [0, 1].map(|a| {
        let mut globals = [0.0; MOST_GLOBALS];
        if let Some(camera) = &slopes.camera {
            free.camera.iter().enumerate().for_each(|(j, &at)| {
                globals[j] = -camera.by_intrinsics[a][at];
            });
        }
        if let Some(places) = &free.projector {
            let first = free.camera.len();
            if let Some(projector) = &slopes.projector {
                places.iter().enumerate().for_each(|(j, &at)| {
                    globals[first + j] = -projector.by_intrinsics[a][at];
                });
            }
            if let Some(place) = &slopes.place {
                let first = first + places.len();
                (0..6).for_each(|k| globals[first + k] = -place[a][k]);
            }
        }
        if free.warp {
            let first = free.warp_at();
            (0..2).for_each(|k| globals[first + k] = -slopes.warp[a][k]);
        }
        Row { pose: slopes.pose[a].map(|v| -v), globals }
    })
}

/// Calls `each` for every residual pair of a view; points without a picture are skipped (a state
/// that has any is refused by [`cost`]).
fn for_each_pair(problem: &Problem<'_>, state: &State, view: usize, mut each: impl FnMut(Pair)) {
    let (seen, pose) = (&problem.views[view], &state.poses[view]);
    let out_of_board = pose.rotation.map(|row| row[2]);
    let mut printed = Vec::with_capacity(seen.board.object_points.len());
    let used = |sight, index| !problem.left_out[view].contains(&(sight, index));
    let board = seen.board.object_points.iter().zip(&seen.board.image_points);
    for (i, (&object, &pixel)) in board.enumerate() {
        let point = pose.apply(warped(problem, state, object));
        let projection = state.camera.project_with_slopes(point);
        printed.push((point, object, projection));
        let Some(camera) = projection.filter(|_| used(Sight::Printed, i)) else { continue };
        let slopes = Slopes {
            pose: chain(&camera.by_point, &by_nudge(point, pose)),
            warp: warp_slopes(problem, &camera.by_point, &out_of_board, object),
            camera: Some(camera),
            projector: None,
            place: None,
        };
        let residual = [pixel[0] - camera.pixel[0], pixel[1] - camera.pixel[1]];
        each(Pair { sight: Sight::Printed, residual, rows: rows(problem, &slopes) });
    }
    let Some((projector, to_projector)) = &state.projector else { return };
    for (_, corner) in seen.coded.iter().enumerate().filter(|(i, _)| used(Sight::Coded, *i)) {
        let (point, object, Some(camera)) = printed[corner.corner] else { continue };
        let lit = to_projector.apply(point);
        let Some(mut light) = projector.project_with_slopes(lit) else { continue };
        let pixel = seen.board.image_points[corner.corner];
        let missed = [pixel[0] - camera.pixel[0], pixel[1] - camera.pixel[1]];
        let residual = [0, 1].map(|a| {
            let carried = corner.slope[a][0] * missed[0] + corner.slope[a][1] * missed[1];
            corner.projector_px[a] - carried - light.pixel[a]
        });
        // r = p − S c + S π_c − π_p: the slopes of π are those of π_p − S π_c.
        let by_camera_point: [[f64; 3]; 2] = multiply(&corner.slope, &camera.by_point);
        let turned: [[f64; 3]; 2] = light.by_point.map(|row| back(&to_projector.rotation, row));
        let by_point: [[f64; 3]; 2] =
            [0, 1].map(|a| [0, 1, 2].map(|k| turned[a][k] - by_camera_point[a][k]));
        let place = chain(&light.by_point, &by_nudge(lit, to_projector));
        let mut of_camera = camera;
        of_camera.by_intrinsics =
            multiply(&corner.slope, &camera.by_intrinsics).map(|row| row.map(|v| -v));
        light.by_point = by_point;
        let slopes = Slopes {
            pose: chain(&by_point, &by_nudge(point, pose)),
            warp: warp_slopes(problem, &by_point, &out_of_board, object),
            camera: Some(of_camera),
            projector: Some(light),
            place: Some(place),
        };
        each(Pair { sight: Sight::Coded, residual, rows: rows(problem, &slopes) });
    }
    let to_board = pose.then(to_projector);
    let shown = seen.projected.iter().enumerate().filter(|(i, _)| used(Sight::Projected, *i));
    for (_, shown) in shown {
        let pair = projected(problem, state, pose, &to_board, shown);
        pair.into_iter().for_each(&mut each);
    }
}

/// A projected point: with Y on the plane fixed by the projector,
/// dc = ∂c − (∂c/∂Y) (∂p/∂Y)⁻¹ ∂p, where ∂ leaves Y's two plane coordinates alone.
fn projected(
    problem: &Problem<'_>,
    state: &State,
    pose: &Pose,
    to_board: &Pose,
    shown: &ProjectedPoint,
) -> Option<Pair> {
    let (projector, to_projector) = state.projector.as_ref()?;
    let on_board = intersect(projector, to_board, 0.0, shown.projector_px)?;
    let point = pose.apply(on_board);
    let lit = to_projector.apply(point);
    let camera = state.camera.project_with_slopes(point)?;
    let light = projector.project_with_slopes(lit)?;
    let light_by_point = light.by_point.map(|row| back(&to_projector.rotation, row));
    // Columns: the board's x and y axes.
    let along = |by_point: &[[f64; 3]; 2]| -> [[f64; 2]; 2] {
        by_point
            .map(|row| [0, 1].map(|k| (0..3).map(|i| row[i] * pose.rotation[i][k]).sum::<f64>()))
    };
    let c = along(&camera.by_point);
    let [[p, q], [r, s]] = along(&light_by_point);
    let determinant = p * s - q * r;
    if determinant == 0.0 {
        return None;
    }
    let inverse = [[s / determinant, -q / determinant], [-r / determinant, p / determinant]];
    let gain = multiply(&c, &inverse);
    let nudge = by_nudge(point, pose);
    let less = |a: [[f64; 6]; 2], b: [[f64; 6]; 2]| {
        [0, 1].map(|i| std::array::from_fn(|k| a[i][k] - b[i][k]))
    };
    let by_pose = less(
        chain(&camera.by_point, &nudge),
        multiply(&gain, &chain(&light.by_point, &times(&to_projector.rotation, &nudge))),
    );
    let place = multiply(&gain, &chain(&light.by_point, &by_nudge(lit, to_projector)))
        .map(|r| r.map(|v| -v));
    let mut of_projector = light;
    of_projector.by_intrinsics = multiply(&gain, &light.by_intrinsics).map(|r| r.map(|v| -v));
    let slopes = Slopes {
        pose: by_pose,
        camera: Some(camera),
        projector: Some(of_projector),
        place: Some(place),
        warp: [[0.0; 2]; 2],
    };
    let residual = [shown.camera_px[0] - camera.pixel[0], shown.camera_px[1] - camera.pixel[1]];
    Some(Pair { sight: Sight::Projected, residual, rows: rows(problem, &slopes) })
}

/// row · R: a slope by a turned point as a slope by the point before turning.
fn back(rotation: &[[f64; 3]; 3], row: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| (0..3).map(|i| row[i] * rotation[i][k]).sum())
}

fn warp_slopes(
    problem: &Problem<'_>,
    by_point: &[[f64; 3]; 2],
    out_of_board: &[f64; 3],
    object: [f64; 3],
) -> [[f64; 2]; 2] {
    let bulge = problem.extent.bulge(object);
    by_point.map(|row| {
        let lift: f64 = (0..3).map(|i| row[i] * out_of_board[i]).sum();
        bulge.map(|b| lift * b)
    })
}
