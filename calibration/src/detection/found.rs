//! A board that was found, and the two ways of looking for one.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::detection::board::Board;
use crate::detection::missing::NoBoard;
use crate::detection::neighbours::drop_outliers;
use crate::detection::quality::{BoardQuality, useless};
use crate::detection::{charuco, chessboard, diagnosis};
use crate::error::{CalibrationError, Result};
use crate::geometry::camera::View;
use crate::photo::Photo;

/// One inner corner of a board and where it was seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenCorner {
    /// Its number on the board, row by row.
    pub index: usize,
    /// Where it was seen, pixels.
    pub pixel: [f64; 2],
}

/// A corner that was seen where its neighbours say that it cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DroppedCorner {
    /// Its number on the board, row by row.
    pub index: usize,
    /// Where it seemed to be, pixels.
    pub pixel: [f64; 2],
    /// Distance to where the corners around it say that it is, pixels.
    pub residual_px: f64,
}

impl fmt::Display for DroppedCorner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y] = self.pixel;
        write!(
            f,
            "corner {} at ({x:.1}, {y:.1}) is {:.1} px from where the corners around it say, and \
             left out",
            self.index + 1,
            self.residual_px
        )
    }
}

/// A board in a picture: the corners that were seen and stand in line with their neighbours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FoundBoard {
    /// The picture's name.
    pub name: String,
    /// In the order of their index. All of them for a plain chessboard, less those dropped; of a
    /// ChArUco board those in view.
    pub corners: Vec<SeenCorner>,
    /// Corners left out, the worst first: a reflection, a finger, a stain.
    pub dropped: Vec<DroppedCorner>,
    /// How good the picture of the board is.
    pub quality: BoardQuality,
}

impl FoundBoard {
    /// The corners paired with their places on the board, for a calibration.
    pub fn view(&self, board: &Board) -> View {
        View {
            name: self.name.clone(),
            image_points: self.corners.iter().map(|c| c.pixel).collect(),
            object_points: self.corners.iter().map(|c| board.object_point(c.index)).collect(),
        }
    }
}

impl Board {
    /// Looks for the board in a picture and pairs its corners with their places on it.
    ///
    /// # Errors
    /// As [`detect_board`].
    pub fn view(&self, photo: &Photo) -> Result<View> {
        Ok(detect_board(photo, self)?.view(self))
    }
}

/// Looks for a board in a picture.
///
/// Rows run so that the board is not mirrored. A plain chessboard has to be in view whole. Where
/// a half turn swaps its colours (one side odd, one even) the square between its first four
/// corners is the dark one; otherwise the rows run to the right. A ChArUco board may be seen in
/// part and has one orientation. Corners are refined by the gradient's orthogonality in windows
/// sized by the local squares; those that disagree with the plane map of the corners around them
/// are left out and named.
///
/// # Errors
/// [`CalibrationError::BoardNotFound`] with the likeliest reason; a picture whose samples do not
/// match its size; a board that cannot exist.
pub fn detect_board(photo: &Photo, board: &Board) -> Result<FoundBoard> {
    photo.check()?;
    board.check()?;
    let grey = photo.detector_grey();
    let missing = |reason| CalibrationError::BoardNotFound {
        picture: photo.name.clone(),
        board: board.to_string(),
        reason,
    };
    let look = match &board.markers {
        None => chessboard::find(&grey, photo.width, board)?,
        Some(markers) => charuco::find(&grey, photo.width, board, markers)?,
    };
    let mut corners = match look {
        Ok(corners) => corners,
        Err(NoBoard::NotSeen) => return Err(missing(diagnosis::why_not(photo, &grey, board)?)),
        Err(reason) => return Err(missing(reason)),
    };
    let dropped = drop_outliers(board, &mut corners);
    if dropped.len() * 5 > corners.len() {
        return Err(missing(NoBoard::OutOfLine { corners: dropped.len() }));
    }
    let quality = BoardQuality::measure(photo, board, &corners);
    let larger = match board.markers {
        None => diagnosis::larger_than(photo, &grey, board, &corners)?,
        Some(_) => None,
    };
    if let Some(reason) = larger.or(useless(&quality, photo.max_value)) {
        return Err(missing(reason));
    }
    Ok(FoundBoard { name: photo.name.clone(), corners, dropped, quality })
}

/// Every inner corner of a board that is in view whole, pixels, row by row, in the order that
/// [`detect_board`] promises; those that it would leave out included.
///
/// # Errors
/// As [`detect_board`], and a ChArUco board of which some corners are not seen.
pub fn find_board(photo: &Photo, board: &Board) -> Result<Vec<[f64; 2]>> {
    let found = detect_board(photo, board)?;
    let mut pixels = vec![None; board.corners()];
    let dropped = found.dropped.iter().map(|c| (c.index, c.pixel));
    for (index, pixel) in found.corners.iter().map(|c| (c.index, c.pixel)).chain(dropped) {
        if let Some(slot) = pixels.get_mut(index) {
            *slot = Some(pixel);
        }
    }
    let seen = pixels.iter().flatten().count();
    pixels.into_iter().collect::<Option<Vec<_>>>().ok_or_else(|| CalibrationError::BoardNotFound {
        picture: photo.name.clone(),
        board: board.to_string(),
        reason: NoBoard::Incomplete { seen, corners: board.corners() },
    })
}
