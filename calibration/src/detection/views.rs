//! A folder of photographs of one board.

use std::path::PathBuf;

use rayon::prelude::*;

use crate::detection::board::Board;
use crate::detection::diagnosis::other_size;
use crate::detection::found::{FoundBoard, detect_board};
use crate::detection::missing::NoBoard;
use crate::error::{CalibrationError, Result};
use crate::geometry::camera::View;
use crate::photo::Photo;

/// The board in every picture where it was found.
#[derive(Debug)]
pub struct BoardViews {
    /// Width and height of all pictures, pixels.
    pub size: [usize; 2],
    /// The views found, in the order of the pictures.
    pub views: Vec<View>,
    /// What was found in each: quality of the picture, and corners that were left out.
    pub boards: Vec<FoundBoard>,
    /// Why the board was not found in the others.
    pub missed: Vec<CalibrationError>,
}

/// Looks for a board in pictures that one camera took.
///
/// # Errors
/// No pictures, one that cannot be read, or one of another size than the first; a board of one
/// other number of corners in the first, the middle and the last picture, all three named. A
/// picture without a board is not an error but listed in `missed`.
pub fn find_views(pictures: &[PathBuf], board: &Board) -> Result<BoardViews> {
    refuse_other_size(pictures, board)?;
    let found: Vec<_> = pictures
        .par_iter()
        .map(|path| {
            let photo = Photo::load(path)?;
            Ok(([photo.width, photo.height], photo.name.clone(), detect_board(&photo, board)))
        })
        .collect::<Result<_>>()?;
    let Some(&(size, ref first, _)) = found.first() else {
        return Err(CalibrationError::TooFewViews {
            what: "camera calibration",
            needed: 3,
            found: 0,
        });
    };
    if let Some((other, name, _)) = found.iter().find(|(other, ..)| *other != size) {
        return Err(CalibrationError::Mismatch {
            picture: name.clone(),
            expected: format!("{}x{} pixels as {first}", size[0], size[1]),
            found: format!("{}x{} pixels", other[0], other[1]),
        });
    }
    let mut boards = Vec::new();
    let mut missed = Vec::new();
    for (_, _, board) in found {
        match board {
            Ok(board) => boards.push(board),
            Err(error @ CalibrationError::BoardNotFound { .. }) => missed.push(error),
            Err(error) => return Err(error),
        }
    }
    let views = boards.iter().map(|found| found.view(board)).collect();
    Ok(BoardViews { size, views, boards, missed })
}

/// Looks at three pictures quickly: a board whose corners were miscounted would else be looked for
/// in all of them, most thoroughly.
fn refuse_other_size(pictures: &[PathBuf], board: &Board) -> Result<()> {
    let [first, .., last] = pictures else { return Ok(()) };
    if board.markers.is_some() || pictures.len() < 3 {
        return Ok(());
    }
    let few = [first, &pictures[pictures.len() / 2], last];
    let look = |path: &&PathBuf| {
        let photo = Photo::load(path)?;
        Ok((other_size(&photo, board)?, photo.name))
    };
    let seen: Vec<_> = few.par_iter().map(look).collect::<Result<_>>()?;
    let Some((Some(size), _)) = seen.first() else { return Ok(()) };
    if seen.iter().any(|(other, _)| other != &Some(*size)) {
        return Ok(());
    }
    let names: Vec<&str> = seen.iter().map(|(_, name)| name.as_str()).collect();
    Err(CalibrationError::BoardNotFound {
        picture: names.join(", "),
        board: board.to_string(),
        reason: NoBoard::OtherBoard {
            seen: Some(*size),
            asked: [board.columns.max(board.rows), board.columns.min(board.rows)],
        },
    })
}
