//! Projector pixels of the printed board's corners, from the code shown on a sheet over it.

use super::frames::frame_photo;
use crate::Failure;
use crate::session::Session;
use calibration::{CodeLayout, CodedCorner, Photo, View, decode};
use material::Face;
use rig::CodeSequence;

/// Decodes the pictures of the pose of `board`, whose name ends with the pose's number.
pub(super) fn coded_corners(
    session: &Session,
    code: &CodeSequence,
    board: &View,
) -> Result<Vec<CodedCorner>, Failure> {
    let number = board.name.rsplit('-').next().unwrap_or_default();
    let photo = |i: usize| frame_photo(session, &format!("code-{number}-{i:02}"), 0);
    let pictures: Vec<Photo> = (0..code.patterns().len()).map(photo).collect::<Result<_, _>>()?;
    let decoded = decode(&layout(code, session.config.sample.lit_face)?, &pictures)?;
    Ok(calibration::coded_corners(&decoded, &board.image_points))
}

fn layout(code: &CodeSequence, lit_face: Face) -> Result<CodeLayout, Failure> {
    let projector = code.projector.map(|n| n as usize);
    let layout = match code.phase {
        None => CodeLayout::gray_code(projector),
        Some(p) => CodeLayout::phase_shift(projector, p.period_px as usize, p.steps as usize)?,
    };
    // A sheet that is lit from behind is seen through.
    Ok(match lit_face {
        Face::Front => layout,
        Face::Back => layout.lit_from_behind(),
    })
}
