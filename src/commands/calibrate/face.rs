//! Where the faces of the block are, from a board that lay in their planes.

use super::frames::frame_photo;
use crate::Failure;
use crate::session::Session;
use calibration::{Board, CameraModel, Pose, pose_from_points, reprojection_rms};

/// Depth of the board that lay in the back face's plane, in the frame of the front face; a warning
/// where the session says otherwise.
pub(super) fn thickness(
    session: &Session,
    camera: &CameraModel,
    board: &Board,
    front: &Pose,
) -> Result<f64, Failure> {
    let (back, _) = face_pose(session, camera, board, "face-board-back")?;
    let [width, height, said] = session.config.sample.grid.size_mm();
    let middle = back.apply([width / 2.0, height / 2.0, 0.0]);
    let found = front.inverse().apply(middle)[2];
    // A pose from one board is good to about a thousandth of its distance, seven blocks away.
    if (found - said).abs() > 0.02 * width.max(height) {
        eprintln!(
            "warning: the board lay {found:.2} mm behind the front face, session.toml says that \
             the block is {said:.2} mm thick"
        );
    }
    Ok(found)
}

/// Sample frame to camera frame, from a board that lay in the plane of a face, centred.
pub(super) fn face_pose(
    session: &Session,
    camera: &CameraModel,
    board: &Board,
    shot: &str,
) -> Result<(Pose, f64), Failure> {
    let photo = frame_photo(session, shot, 0)?;
    let [width, height, _] = session.config.sample.grid.size_mm();
    let half = |n: usize| (n as f64 - 1.0) * board.square_mm / 2.0;
    let (x0, y0) = (width / 2.0 - half(board.columns), height / 2.0 - half(board.rows));
    let mut view = board.view(&photo)?;
    for point in &mut view.object_points {
        *point = [point[0] + x0, point[1] + y0, point[2]];
    }
    let pose = pose_from_points(camera, &view)?;
    Ok((pose, reprojection_rms(camera, &pose, &view)))
}
