//! Plain chessboards: two of OpenCV's detectors, from quick to thorough.

use opencv::core::{Mat, Size, Vector};
use opencv::prelude::*;
use opencv::{calib3d, imgproc};

use crate::cv;
use crate::detection::board::Board;
use crate::detection::found::SeenCorner;
use crate::detection::missing::{Look, NoBoard};
use crate::detection::neighbours::{Grid, drop_outliers};
use crate::detection::refine::{refine, soften};
use crate::detection::squares::Squares;
use crate::error::{CalibrationError, Result};

/// Half the refinement's window over the distance to the nearest corner.
const WINDOW_SHARE: f64 = 0.25;

/// Longest side of the pictures that are looked at first: the detectors' time grows faster than
/// the picture, their finds do not.
pub(crate) const QUICK_PX: f64 = 900.0;

/// Longest side of the pictures that are looked at next.
const THOROUGH_PX: f64 = 1600.0;

/// One way of looking.
enum Detector {
    /// Fits the sectors' symmetry (Duda & Frese 2018).
    Sectors { flags: i32 },
    /// Follows the edges of the dark squares.
    Edges,
}

/// All inner corners of a plain chessboard, in the promised order.
///
/// The first way of looking whose corners all stand in line is believed; otherwise the one with
/// the fewest that do not.
pub(crate) fn find(grey: &[u8], width: usize, board: &Board) -> Result<Look> {
    let look = || -> opencv::Result<Option<Vec<SeenCorner>>> {
        let full = cv::grey_mat(grey, width)?;
        let soft = soften(&full)?;
        let longest = width.max(grey.len() / width.max(1)) as f64;
        let [quick, thorough] = [QUICK_PX, THOROUGH_PX].map(|px| (px / longest).min(1.0));
        let plain = calib3d::CALIB_CB_NORMALIZE_IMAGE;
        let exhaustive = plain + calib3d::CALIB_CB_EXHAUSTIVE;
        let mut ways = vec![(quick, Detector::Sectors { flags: plain })];
        if thorough > quick {
            ways.push((thorough, Detector::Sectors { flags: plain }));
        }
        // A defocused board is sharp enough in a smaller picture.
        ways.extend([
            (quick, Detector::Edges),
            (quick, Detector::Sectors { flags: exhaustive }),
            (quick / 2.0, Detector::Sectors { flags: exhaustive }),
        ]);
        let mut best: Option<(usize, Vec<SeenCorner>)> = None;
        for (scale, detector) in ways {
            let Some(rough) = detector.look(&full, scale, board)? else { continue };
            let corners = refined(&soft, &rough, board)?;
            // In a larger board the detectors find patterns that skip corners.
            if !Squares::new(board, &corners, grey, width).are_a_board() {
                continue;
            }
            let strangers = drop_outliers(board, &mut corners.clone()).len();
            if best.as_ref().is_none_or(|(least, _)| strangers < *least) {
                best = Some((strangers, corners));
            }
            if strangers == 0 {
                break;
            }
        }
        Ok(best.map(|(_, corners)| corners))
    };
    let found = look().map_err(CalibrationError::opencv("looking for a chessboard"))?;
    Ok(found.map(|corners| orient(corners, grey, width, board)).ok_or(NoBoard::NotSeen))
}

/// Whether a board is in the picture and does not go on beyond its corners, by the quickest look.
pub(crate) fn is_there(grey: &[u8], width: usize, board: &Board) -> Result<bool> {
    let look = || -> opencv::Result<bool> {
        let full = cv::grey_mat(grey, width)?;
        let longest = width.max(grey.len() / width.max(1)) as f64;
        let flags = calib3d::CALIB_CB_NORMALIZE_IMAGE;
        let rough =
            Detector::Sectors { flags }.look(&full, (QUICK_PX / longest).min(1.0), board)?;
        let Some(rough) = rough else { return Ok(false) };
        let corners: Vec<SeenCorner> =
            rough.iter().enumerate().map(|(index, &pixel)| SeenCorner { index, pixel }).collect();
        let squares = Squares::new(board, &corners, grey, width);
        Ok(squares.are_a_board() && !squares.go_on())
    };
    look().map_err(CalibrationError::opencv("looking for a chessboard"))
}

impl Detector {
    /// Corners in the picture's own pixels, looked for in a copy of another scale.
    fn look(&self, full: &Mat, scale: f64, board: &Board) -> opencv::Result<Option<Vec<[f64; 2]>>> {
        let picture = scaled(full, scale)?;
        let pattern = Size::new(board.columns as i32, board.rows as i32);
        let mut found = Vector::new();
        let seen = match self {
            Self::Sectors { flags } => {
                calib3d::find_chessboard_corners_sb(&picture, pattern, &mut found, *flags)?
            }
            Self::Edges => {
                let flags = calib3d::CALIB_CB_ADAPTIVE_THRESH + calib3d::CALIB_CB_NORMALIZE_IMAGE;
                calib3d::find_chessboard_corners(&picture, pattern, &mut found, flags)?
            }
        };
        let whole = seen && found.len() == board.corners();
        Ok(whole.then(|| full_scale(&found, scale)))
    }
}

/// A copy of another size.
pub(crate) fn scaled(full: &Mat, scale: f64) -> opencv::Result<Mat> {
    if scale == 1.0 {
        return full.try_clone();
    }
    let mut out = Mat::default();
    let way = if scale < 1.0 { imgproc::INTER_AREA } else { imgproc::INTER_CUBIC };
    imgproc::resize(full, &mut out, Size::default(), scale, scale, way)?;
    Ok(out)
}

/// Points of a scaled copy in the picture's own pixels.
pub(crate) fn full_scale(points: &Vector<opencv::core::Point2f>, scale: f64) -> Vec<[f64; 2]> {
    cv::points_from(points).iter().map(|p| p.map(|v| (v + 0.5) / scale - 0.5)).collect()
}

/// The corners refined at full resolution; one that the refinement lost stays where it was.
fn refined(soft: &Mat, rough: &[[f64; 2]], board: &Board) -> opencv::Result<Vec<SeenCorner>> {
    let mut corners: Vec<SeenCorner> =
        rough.iter().enumerate().map(|(index, &pixel)| SeenCorner { index, pixel }).collect();
    let grid = Grid::new(board, &corners);
    for corner in &mut corners {
        let half = (WINDOW_SHARE * grid.nearest(corner.index)).round().clamp(2.0, 25.0) as i32;
        if let Some(pixel) = refine(soft, corner.pixel, half)? {
            corner.pixel = pixel;
        }
    }
    Ok(corners)
}

/// Puts the corners in the promised order.
fn orient(corners: Vec<SeenCorner>, grey: &[u8], width: usize, board: &Board) -> Vec<SeenCorner> {
    let mut pixels: Vec<[f64; 2]> = corners.iter().map(|c| c.pixel).collect();
    let (columns, last) = (board.columns, pixels.len() - 1);
    let edge = |from: usize, to: usize, set: &[[f64; 2]]| {
        [set[to][0] - set[from][0], set[to][1] - set[from][1]]
    };
    let (along, down) = (edge(0, columns - 1, &pixels), edge(0, last + 1 - columns, &pixels));
    if along[0] * down[1] - along[1] * down[0] < 0.0 {
        pixels.chunks_mut(columns).for_each(<[_]>::reverse);
    }
    let turned = if board.has_one_orientation() {
        dark_minus_light(&pixels, grey, width, board) > 0.0
    } else {
        let [x, y] = edge(0, columns - 1, &pixels);
        x + y < 0.0
    };
    if turned {
        pixels.reverse();
    }
    pixels.into_iter().enumerate().map(|(index, pixel)| SeenCorner { index, pixel }).collect()
}

/// Sum of the greys of the squares with the first square's colour minus the others', so
/// negative where the first square is dark.
fn dark_minus_light(corners: &[[f64; 2]], grey: &[u8], width: usize, board: &Board) -> f64 {
    let mut sum = 0.0;
    for r in 0..board.rows - 1 {
        for c in 0..board.columns - 1 {
            let i = r * board.columns + c;
            let square = [i, i + 1, i + board.columns, i + board.columns + 1];
            let middle: [f64; 2] =
                std::array::from_fn(|a| square.iter().map(|&j| corners[j][a]).sum::<f64>() / 4.0);
            let at = middle[1].round().max(0.0) as usize * width + middle[0].round() as usize;
            let value = f64::from(grey.get(at).copied().unwrap_or(0));
            sum += if (r + c) % 2 == 0 { value } else { -value };
        }
    }
    sum
}
