//! Camera and projector from a session's pictures of boards, printed and projected.

use super::all::go_on;
use super::coded::coded_corners;
use super::frames::frame_photo;
use crate::Failure;
use crate::session::Session;
use calibration::{
    Board, CalibrationError, Choice, Geometry, Photo, ProjectedPoint, RigView, SeenCorner, View,
    calibrate_geometry, detect_board,
};
use material::Face;
use rig::Chessboard;

/// Calibrates camera and projector; and says for each picture without a board why it has none.
pub(super) fn session_geometry(
    session: &Session,
    board: &Board,
) -> Result<(Geometry, Vec<String>), Failure> {
    let plan = &session.config.plan;
    let (printed, mut missed) = printed_boards(session, board)?;
    let size = printed.first().map_or(Ok([0, 0]), |v| {
        let photo = frame_photo(session, &v.name, 0)?;
        Ok::<_, Failure>([photo.width, photo.height])
    })?;
    let mirrored = session.config.sample.lit_face == Face::Back;
    let mut views = Vec::new();
    for board in printed {
        go_on()?;
        views.push(match plan.projector_method.code(plan.projector_px) {
            Some(code) => RigView {
                coded: coded_corners(session, &code, &board)?,
                projected: Vec::new(),
                board,
            },
            None => {
                let name = board.name.replace("board", "projected");
                let photo = frame_photo(session, &name, 0)?;
                let projected = match projected_points(&photo, &plan.projector_board, mirrored) {
                    Err(error @ CalibrationError::BoardNotFound { .. }) => {
                        eprintln!("warning: {error}");
                        missed.push(error.to_string());
                        Vec::new()
                    }
                    found => found?,
                };
                RigView { board, coded: Vec::new(), projected }
            }
        });
    }
    let lit = plan.projector_px.map(|n| n as usize);
    go_on()?;
    let geometry = calibrate_geometry(&views, size, Some(lit), Choice::default())?;
    Ok((geometry, missed))
}

/// The printed board in every pose, and why it was not found where it was not.
fn printed_boards(session: &Session, board: &Board) -> Result<(Vec<View>, Vec<String>), Failure> {
    let (mut out, mut missed) = (Vec::new(), Vec::new());
    for pose in 0..session.config.plan.board_poses {
        go_on()?;
        match board.view(&frame_photo(session, &format!("board-{:02}", pose + 1), 0)?) {
            Ok(view) => out.push(view),
            Err(error @ CalibrationError::BoardNotFound { .. }) => {
                eprintln!("warning: {error}");
                missed.push(error.to_string());
            }
            Err(error) => return Err(error.into()),
        }
    }
    Ok((out, missed))
}

/// The corners of the projected board in one pose of the plane.
///
/// Seen from behind, through the sheet, the projected board is mirrored: it is looked for in the
/// mirrored picture.
pub(super) fn projected_points(
    photo: &Photo,
    shown: &Chessboard,
    mirrored: bool,
) -> Result<Vec<ProjectedPoint>, CalibrationError> {
    let board = Board::chessboard(shown.columns, shown.rows, 1.0);
    let edge = photo.width as f64 - 1.0;
    let found =
        if mirrored { detect_board(&flipped(photo), &board) } else { detect_board(photo, &board) }?;
    let shown = shown.corners_px();
    let point = |corner: &SeenCorner| {
        let [x, y] = corner.pixel;
        let camera_px = if mirrored { [edge - x, y] } else { [x, y] };
        Some(ProjectedPoint { camera_px, projector_px: *shown.get(corner.index)? })
    };
    Ok(found.corners.iter().filter_map(point).collect())
}

fn flipped(photo: &Photo) -> Photo {
    let mut out = photo.clone();
    let row = photo.width * photo.channels;
    for (to, from) in out.data.chunks_exact_mut(row).zip(photo.data.chunks_exact(row)) {
        let pixels = from.chunks_exact(photo.channels).rev();
        for (t, f) in to.chunks_exact_mut(photo.channels).zip(pixels) {
            t.copy_from_slice(f);
        }
    }
    out
}
