//! What is the matter with a picture in which no board was found.

use opencv::calib3d;
use opencv::core::{Mat, Size, Vector};
use opencv::prelude::*;

use crate::cv;
use crate::detection::board::Board;
use crate::detection::chessboard::{self, QUICK_PX, full_scale, scaled};
use crate::detection::found::SeenCorner;
use crate::detection::missing::NoBoard;
use crate::detection::quality::{BoardQuality, CLIPPED, useless};
use crate::detection::squares::Squares;
use crate::error::{CalibrationError, Result};
use crate::photo::Photo;

/// A picture whose brightest percent stays below this share of full scale shows little.
const DARK: f64 = 0.1;

/// Share of the pixels at full scale that leaves little to see.
const CLIPPED_SHARE: f64 = 0.4;

/// Fewer corners may be anything with corners.
const FEWEST_CORNERS: usize = 12;

/// A picture whose best edge is wider than this is out of focus.
const WIDE_EDGE_PX: f64 = 12.0;

/// The likeliest reason for not seeing a board.
///
/// A grid of another size or scale that is seen after all, well exposed, is evidence and comes
/// first; then the picture's histogram; then a doubtful grid; then the picture's sharpest edge.
pub(crate) fn why_not(photo: &Photo, grey: &[u8], board: &Board) -> Result<NoBoard> {
    let evidence = match board.markers {
        None => largest_grid(photo, grey)?.and_then(|grid| grid.says(photo, grey, board)),
        Some(_) => None,
    };
    let exposure = exposure(photo);
    Ok(match (evidence, exposure) {
        (Some((reason, true)), _) => reason,
        (_, Some(reason)) => reason,
        (Some((reason, false)), None) => reason,
        (None, None) => out_of_focus(grey, photo.width).unwrap_or(NoBoard::NotSeen),
    })
}

/// Why a chessboard cannot be `board` though that many corners were found: the squares go on
/// beyond its outer corners.
pub(crate) fn larger_than(
    photo: &Photo,
    grey: &[u8],
    board: &Board,
    corners: &[SeenCorner],
) -> Result<Option<NoBoard>> {
    if !Squares::new(board, corners, grey, photo.width).go_on() {
        return Ok(None);
    }
    let seen = largest_grid(photo, grey)?
        .map(|found| long_and_short(found.board.columns, found.board.rows))
        .filter(|seen| seen.iter().product::<usize>() > board.corners());
    Ok(Some(NoBoard::OtherBoard { seen, asked: long_and_short(board.columns, board.rows) }))
}

/// The size of the chessboard that a picture shows in place of `board`, longer side first, by a
/// quick look; None where `board` itself is seen, or nothing that is surely a board.
pub(crate) fn other_size(photo: &Photo, board: &Board) -> Result<Option<[usize; 2]>> {
    let grey = photo.detector_grey();
    if chessboard::is_there(&grey, photo.width, board)? {
        return Ok(None);
    }
    let failed = CalibrationError::opencv("looking for other chessboards");
    let full = cv::grey_mat(&grey, photo.width).map_err(&failed)?;
    let scale = (QUICK_PX / photo.width.max(photo.height) as f64).min(1.0);
    let asked = long_and_short(board.columns, board.rows);
    let Some(grid) = grid_at(&full, scale).map_err(&failed)? else { return Ok(None) };
    let squares = Squares::new(&grid.board, &grid.corners, &grey, photo.width);
    // A part of the board is no other board.
    let whole = !squares.cut_off() && !squares.go_on();
    let sure = grid.corners.len() >= FEWEST_CORNERS && whole && squares.are_a_board();
    let seen = long_and_short(grid.board.columns, grid.board.rows);
    Ok((sure && seen != asked).then_some(seen))
}

/// A chessboard of whatever size.
struct FoundGrid {
    board: Board,
    corners: Vec<SeenCorner>,
    /// The picture had to be enlarged.
    enlarged: bool,
}

/// The largest chessboard to be seen in the picture, in copies of several sizes.
fn largest_grid(photo: &Photo, grey: &[u8]) -> Result<Option<FoundGrid>> {
    let failed = CalibrationError::opencv("looking for other chessboards");
    let full = cv::grey_mat(grey, photo.width).map_err(&failed)?;
    let longest = photo.width.max(photo.height) as f64;
    let normal = (QUICK_PX / longest).min(1.0);
    let mut best: Option<FoundGrid> = None;
    for scale in [normal, normal / 2.0, (2.0 * normal).min(4.0)] {
        let Some(grid) = grid_at(&full, scale).map_err(&failed)? else { continue };
        let corners = grid.corners.len();
        let squares = Squares::new(&grid.board, &grid.corners, grey, photo.width);
        let sure = corners >= FEWEST_CORNERS && squares.are_a_board();
        if sure && best.as_ref().is_none_or(|b| b.corners.len() < corners) {
            best = Some(grid);
        }
    }
    Ok(best)
}

fn grid_at(full: &Mat, scale: f64) -> opencv::Result<Option<FoundGrid>> {
    let picture = scaled(full, scale)?;
    let (mut found, mut meta) = (Vector::new(), Mat::default());
    let flags =
        calib3d::CALIB_CB_NORMALIZE_IMAGE + calib3d::CALIB_CB_LARGER + calib3d::CALIB_CB_EXHAUSTIVE;
    let least = Size::new(3, 3);
    let seen = calib3d::find_chessboard_corners_sb_with_meta(
        &picture, least, &mut found, flags, &mut meta,
    )?;
    let side = |n: i32| usize::try_from(n).unwrap_or(0);
    let board = Board::chessboard(side(meta.cols()), side(meta.rows()), 1.0);
    if !seen || board.corners() != found.len() {
        return Ok(None);
    }
    let pixels = full_scale(&found, scale).into_iter().enumerate();
    let corners = pixels.map(|(index, pixel)| SeenCorner { index, pixel }).collect();
    Ok(Some(FoundGrid { board, corners, enlarged: scale > 1.0 }))
}

impl FoundGrid {
    /// What this grid says about the board that was not found, and whether it is exposed well
    /// enough to be believed. None if it says nothing.
    fn says(&self, photo: &Photo, grey: &[u8], board: &Board) -> Option<(NoBoard, bool)> {
        let quality = BoardQuality::measure(photo, &self.board, &self.corners);
        let believed = quality.clipped_share < 0.5 && quality.contrast > 0.05;
        let seen = long_and_short(self.board.columns, self.board.rows);
        let asked = long_and_short(board.columns, board.rows);
        let reason = if let Some(reason) = useless(&quality, photo.max_value) {
            reason
        } else if seen == asked {
            if !self.enlarged {
                return None;
            }
            NoBoard::TooSmall { square_px: quality.square_px }
        } else if (0..2).all(|i| seen[i] <= asked[i])
            && Squares::new(&self.board, &self.corners, grey, photo.width).cut_off()
        {
            NoBoard::PartlyOutside { seen }
        } else {
            NoBoard::OtherBoard { seen: Some(seen), asked }
        };
        Some((reason, believed))
    }
}

fn long_and_short(columns: usize, rows: usize) -> [usize; 2] {
    [columns.max(rows), columns.min(rows)]
}

/// Too little or too much light in the picture as a whole.
fn exposure(photo: &Photo) -> Option<NoBoard> {
    let full = f64::from(photo.max_value);
    let mut codes = photo.data.clone();
    let place = codes.len().saturating_sub(1) * 99 / 100;
    if codes.is_empty() {
        return None;
    }
    let bright = f64::from(*codes.select_nth_unstable(place).1) / full;
    if bright < DARK {
        return Some(NoBoard::TooDark { bright });
    }
    let clipped = photo.data.iter().filter(|v| f64::from(**v) >= CLIPPED * full).count();
    let share = clipped as f64 / photo.data.len() as f64;
    (share > CLIPPED_SHARE).then_some(NoBoard::Clipped { share })
}

/// The contrast over the steepest slope is the width of the sharpest edges.
fn out_of_focus(grey: &[u8], width: usize) -> Option<NoBoard> {
    let mut values = grey.to_vec();
    let last = values.len().saturating_sub(1);
    if values.len() < 100 {
        return None;
    }
    let mut level = |share: usize| f64::from(*values.select_nth_unstable(last * share / 100).1);
    let contrast = level(99) - level(1);
    // Slopes over four pixels: sharp edges take all of the contrast on the way, noise little.
    let mut slopes: Vec<u8> = grey
        .chunks(width.max(1))
        .flat_map(|row| row.windows(5).map(|w| w[0].abs_diff(w[4])))
        .collect();
    let place = slopes.len().checked_sub(1)? * 999 / 1000;
    let steepest = f64::from(*slopes.select_nth_unstable(place).1) / 4.0;
    // From 10 to 90 %, a Gaussian's edge is 1.02 times its contrast over its steepest slope.
    let edge_px = contrast / steepest.max(0.25);
    (contrast > 16.0 && edge_px > WIDE_EDGE_PX)
        .then_some(NoBoard::Blurred { edge_px, square_px: None })
}
