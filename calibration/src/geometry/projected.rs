//! The chessboard that the projector shows, and reading it back from the camera's pictures.

use serde::{Deserialize, Serialize};

use crate::detection::board::Board;
use crate::detection::found::find_in_grey;
use crate::error::{CalibrationError, Result};
use crate::geometry::camera::{CameraModel, pose_from_points};
use crate::geometry::face::intersect;
use crate::geometry::pose::Pose;
use crate::geometry::projector::ProjectorView;
use crate::photo::Photo;

/// A chessboard in the projector's picture; the top left square is dark.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ProjectedBoard {
    /// Inner corners along a row.
    pub columns: usize,
    /// Inner corners along a column.
    pub rows: usize,
    /// Edge of a square, projector pixels.
    pub square_px: f64,
    /// Projector pixel of the first inner corner (top left).
    pub first_corner_px: [f64; 2],
}

impl ProjectedBoard {
    /// Projector pixels of the inner corners, row by row.
    pub fn corner_pixels(&self) -> Vec<[f64; 2]> {
        let [u, v] = self.first_corner_px;
        (0..self.columns * self.rows)
            .map(|i| [(i % self.columns) as f64, (i / self.columns) as f64])
            .map(|[x, y]| [u + x * self.square_px, v + y * self.square_px])
            .collect()
    }

    /// The light (0..1) at a projector pixel, which may be fractional: dark squares, white around.
    pub fn light_at(&self, pixel: [f64; 2]) -> f64 {
        let square =
            |a: usize| ((pixel[a] - self.first_corner_px[a]) / self.square_px).floor() + 1.0;
        let (column, row) = (square(0), square(1));
        let on_board = (0.0..=self.columns as f64).contains(&column)
            && (0.0..=self.rows as f64).contains(&row);
        if on_board && (column + row) % 2.0 == 0.0 { 0.0 } else { 1.0 }
    }

    /// The picture to project, `size` = [width, height], row by row in 0..1, with pixels that a
    /// corner cuts averaged so that corners fall where [`Self::corner_pixels`] says.
    pub fn picture(&self, size: [usize; 2]) -> Vec<f32> {
        const PARTS: usize = 8;
        let offset = |i: usize| (i as f64 + 0.5) / PARTS as f64 - 0.5;
        let mean = |u: usize, v: usize| {
            let parts = 0..PARTS * PARTS;
            let light = parts.map(|i| {
                self.light_at([u as f64 + offset(i % PARTS), v as f64 + offset(i / PARTS)])
            });
            (light.sum::<f64>() / (PARTS * PARTS) as f64) as f32
        };
        (0..size[1]).flat_map(|v| (0..size[0]).map(move |u| mean(u, v))).collect()
    }
}

/// Reads one pose of the plane from two pictures: `white` shows the printed board under plain
/// projector light, `pattern` the projected board beside it.
///
/// The printed board is painted over in `pattern` before the projected one is looked for.
///
/// # Errors
/// Either board is not found, or the projected board looks the same after a half turn (one side
/// must be odd and one even), so that its corners could not be told apart.
pub fn observe_projected_board(
    camera: &CameraModel,
    printed: &Board,
    projected: &ProjectedBoard,
    white: &Photo,
    pattern: &Photo,
) -> Result<ProjectorView> {
    let shape = Board::chessboard(projected.columns, projected.rows, 1.0);
    if !shape.has_one_orientation() {
        return Err(CalibrationError::BadInput {
            what: "projected board".into(),
            expected: "an odd and an even number of inner corners, so that it has one top".into(),
            found: format!("{}x{}", projected.columns, projected.rows),
        });
    }
    for photo in [white, pattern] {
        if (photo.width, photo.height) != (camera.width, camera.height) {
            return Err(CalibrationError::Mismatch {
                picture: photo.name.clone(),
                expected: format!("{}x{} pixels as calibrated", camera.width, camera.height),
                found: photo.shape(),
            });
        }
        photo.check()?;
    }
    let board_pose = pose_from_points(camera, &printed.view(white)?)?;
    let mut grey = pattern.detector_grey();
    paint_over(&mut grey, camera, printed, &board_pose);
    let corners = find_in_grey(&grey, camera.width, &shape, &pattern.name)?;
    let on_plane = corners.iter().map(|&pixel| intersect(camera, &board_pose, 0.0, pixel));
    let board_points: Vec<_> = on_plane.flatten().collect();
    if board_points.len() != corners.len() {
        return Err(CalibrationError::BoardNotFound {
            picture: pattern.name.clone(),
            board: shape.to_string(),
            reason: "its corners do not lie on the printed board's plane".into(),
        });
    }
    Ok(ProjectorView {
        name: pattern.name.clone(),
        board_pose,
        board_points,
        projector_pixels: projected.corner_pixels(),
    })
}

/// Fills the printed board, its outer squares included, with the light around it.
fn paint_over(grey: &mut [u8], camera: &CameraModel, board: &Board, pose: &Pose) {
    let (right, bottom) = (board.columns as f64, board.rows as f64);
    // In squares from the first inner corner; the board ends at -1 and at its number of columns.
    let inside = |x: f64, y: f64, rim: f64| {
        x > -1.0 - rim && y > -1.0 - rim && x < right + rim && y < bottom + rim
    };
    let mut covered = Vec::new();
    let mut around = Vec::new();
    for v in 0..camera.height {
        for u in 0..camera.width {
            let Some([x, y, _]) = intersect(camera, pose, 0.0, [u as f64, v as f64]) else {
                continue;
            };
            let (x, y) = (x / board.square_mm, y / board.square_mm);
            let at = v * camera.width + u;
            if inside(x, y, 0.15) {
                covered.push(at);
            } else if inside(x, y, 0.5) {
                around.extend(grey.get(at));
            }
        }
    }
    around.sort_unstable();
    let fill = around.get(around.len() / 2).copied().unwrap_or(128);
    for at in covered {
        if let Some(value) = grey.get_mut(at) {
            *value = fill;
        }
    }
}
