//! A folder of photographs of one board.

use std::path::PathBuf;

use rayon::prelude::*;

use crate::detection::board::Board;
use crate::detection::found::{FoundBoard, detect_board};
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
/// No pictures, one that cannot be read, or one of another size than the first; a picture
/// without a board is not an error but listed in `missed`.
pub fn find_views(pictures: &[PathBuf], board: &Board) -> Result<BoardViews> {
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
