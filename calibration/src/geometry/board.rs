//! Chessboards: what they are, and finding their inner corners in a picture.

use std::str::FromStr;

use opencv::core::{Size, Vector};
use opencv::prelude::*;
use opencv::{calib3d, imgproc};
use serde::{Deserialize, Serialize};

use crate::cv;
use crate::error::{CalibrationError, Result};
use crate::geometry::camera::View;
use crate::photo::Photo;

/// A chessboard by its inner corners.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Board {
    /// Inner corners along a row.
    pub columns: usize,
    /// Inner corners along a column.
    pub rows: usize,
    /// Edge of a square, mm.
    pub square_mm: f64,
}

impl Board {
    /// A board from its inner corners, written `9x6`, and the edge of a square in mm.
    ///
    /// # Errors
    /// Not two whole numbers of at least 3, or an edge that is not positive.
    pub fn parse(corners: &str, square_mm: f64) -> Result<Self> {
        let bad = |what: &str, expected: &str, found: String| CalibrationError::BadInput {
            what: what.into(),
            expected: expected.into(),
            found,
        };
        let sides = corners.trim().to_ascii_lowercase();
        let sides = sides
            .split_once(['x', '×'])
            .and_then(|(c, r)| Some((usize::from_str(c).ok()?, usize::from_str(r).ok()?)));
        match sides {
            Some((columns, rows)) if (3..=200).contains(&columns) && (3..=200).contains(&rows) => {
                if square_mm.is_finite() && square_mm > 0.0 {
                    return Ok(Self { columns, rows, square_mm });
                }
                Err(bad("square size", "a positive number of millimetres", square_mm.to_string()))
            }
            _ => Err(bad(
                "board",
                "inner corners as COLUMNSxROWS, each from 3 to 200, for instance 9x6",
                corners.to_owned(),
            )),
        }
    }

    /// The inner corners in the board's frame (z = 0), mm, row by row.
    pub fn object_points(&self) -> Vec<[f64; 3]> {
        let place = |i: usize| [(i % self.columns) as f64, (i / self.columns) as f64];
        (0..self.columns * self.rows)
            .map(|i| place(i).map(|s| s * self.square_mm))
            .map(|[x, y]| [x, y, 0.0])
            .collect()
    }

    /// Looks for the board in a picture and pairs its corners with their places on it.
    ///
    /// # Errors
    /// As [`find_board`].
    pub fn view(&self, photo: &Photo) -> Result<View> {
        Ok(View {
            name: photo.name.clone(),
            image_points: find_board(photo, self)?,
            object_points: self.object_points(),
        })
    }

    /// Whether a half turn changes the board: only if its colours swap.
    pub(crate) fn has_one_orientation(&self) -> bool {
        (self.columns + self.rows) % 2 == 1
    }
}

/// The inner corners of a board in a picture, pixels, row by row.
///
/// Rows run so that the board is not mirrored. Where a half turn swaps the colours (one side odd,
/// one even) the square between the first four corners is the dark one; otherwise the rows run to
/// the right.
///
/// Two detectors are asked, one that fits the sectors' symmetry (Duda & Frese 2018) and one that
/// follows the edges; each result is refined by the gradient's orthogonality in a window sized
/// by the local squares, and the set that lies best on a plane map of the board is kept.
///
/// # Errors
/// [`CalibrationError::BoardNotFound`] with the likeliest reason.
pub fn find_board(photo: &Photo, board: &Board) -> Result<Vec<[f64; 2]>> {
    photo.check()?;
    find_in_grey(&photo.detector_grey(), photo.width, board, &photo.name)
}

pub(crate) fn find_in_grey(
    grey: &[u8],
    width: usize,
    board: &Board,
    picture: &str,
) -> Result<Vec<[f64; 2]>> {
    let candidates =
        detect(grey, width, board).map_err(CalibrationError::opencv("looking for a chessboard"))?;
    let mut best: Option<(f64, Vec<[f64; 2]>)> = None;
    for corners in candidates {
        let score = smoothness(&corners, board)?;
        if best.as_ref().is_none_or(|(least, _)| score < *least) {
            best = Some((score, corners));
        }
    }
    let missing = |reason: String| CalibrationError::BoardNotFound {
        picture: picture.to_owned(),
        board: format!("{}x{}", board.columns, board.rows),
        reason,
    };
    match best {
        Some((_, corners)) => Ok(orient(corners, grey, width, board)),
        None => Err(missing(why_not(grey, width))),
    }
}

/// Every set of corners worth considering, refined at full resolution.
fn detect(grey: &[u8], width: usize, board: &Board) -> opencv::Result<Vec<Vec<[f64; 2]>>> {
    let full = cv::grey_mat(grey, width)?;
    let mut soft = Mat::default();
    let (sigma, border) = (SOFTENING_PX, opencv::core::BORDER_REPLICATE);
    imgproc::gaussian_blur(&full, &mut soft, Size::default(), sigma, sigma, border)?;
    let height = grey.len() / width.max(1);
    // The detectors' time grows faster than the picture, their finds do not.
    let shrink = (1600.0 / width.max(height) as f64).min(1.0);
    let mut small = full.try_clone()?;
    if shrink < 1.0 {
        imgproc::resize(&full, &mut small, Size::default(), shrink, shrink, imgproc::INTER_AREA)?;
    }
    let pattern = Size::new(board.columns as i32, board.rows as i32);
    let enlarge = |found: &Vector<_>| -> Vec<[f64; 2]> {
        cv::points_from(found).iter().map(|p| p.map(|v| (v + 0.5) / shrink - 0.5)).collect()
    };
    let mut sets = Vec::new();
    let mut found = Vector::new();
    let flags = calib3d::CALIB_CB_NORMALIZE_IMAGE + calib3d::CALIB_CB_ACCURACY;
    let thorough = flags + calib3d::CALIB_CB_EXHAUSTIVE;
    for flags in [flags, thorough] {
        if calib3d::find_chessboard_corners_sb(&small, pattern, &mut found, flags)? {
            sets.push(refine(&soft, &enlarge(&found), board)?);
            break;
        }
    }
    let flags = calib3d::CALIB_CB_ADAPTIVE_THRESH + calib3d::CALIB_CB_NORMALIZE_IMAGE;
    if calib3d::find_chessboard_corners(&small, pattern, &mut found, flags)? {
        sets.push(refine(&soft, &enlarge(&found), board)?);
    }
    sets.retain(|set| set.len() == board.columns * board.rows);
    Ok(sets)
}

/// Gradient-orthogonality refinement (Förstner), each corner in a window of its own: large
/// enough to average noise, small enough never to see the neighbouring corner.
fn refine(grey: &Mat, corners: &[[f64; 2]], board: &Board) -> opencv::Result<Vec<[f64; 2]>> {
    let mut refined = Vec::with_capacity(corners.len());
    for (i, corner) in corners.iter().enumerate() {
        let square = nearest_neighbour(corners, board, i);
        let half = (WINDOW_SHARE * square).round().clamp(2.0, 25.0) as i32;
        let mut point = cv::points_f32(std::slice::from_ref(corner));
        imgproc::corner_sub_pix(
            grey,
            &mut point,
            Size::new(half, half),
            Size::new(-1, -1),
            opencv::core::TermCriteria::new(3, 100, 1e-4)?,
        )?;
        // A refinement that leaves its window has followed something else.
        let moved = cv::points_from(&point).first().copied().unwrap_or(*corner);
        let kept = (moved[0] - corner[0]).hypot(moved[1] - corner[1]) <= f64::from(half);
        refined.push(if kept { moved } else { *corner });
    }
    Ok(refined)
}

/// Blur before refinement, pixels: edges sharper than the pixels are aliased, and the refinement
/// takes the jags for the edge (0.178 px against 0.174 px on real views, 0.099 against 0.072 on
/// rendered ones, which no lens has softened).
const SOFTENING_PX: f64 = 1.0;

/// Half window over distance to the nearest corner.
const WINDOW_SHARE: f64 = 0.25;

/// Distance from a corner to its nearest neighbour along the board's rows and columns, pixels.
fn nearest_neighbour(corners: &[[f64; 2]], board: &Board, i: usize) -> f64 {
    let (c, r) = (i % board.columns, i / board.columns);
    let near = [
        (c > 0).then(|| i - 1),
        (c + 1 < board.columns).then_some(i + 1),
        (r > 0).then(|| i - board.columns),
        (r + 1 < board.rows).then_some(i + board.columns),
    ];
    near.into_iter()
        .flatten()
        .filter_map(|j| corners.get(j))
        .map(|q| (q[0] - corners[i][0]).hypot(q[1] - corners[i][1]))
        .fold(f64::INFINITY, f64::min)
}

/// RMS distance in pixels between the corners and the best plane projective map of the board.
///
/// Lens distortion adds the same to every set of corners of one picture, so sets compare fairly.
fn smoothness(corners: &[[f64; 2]], board: &Board) -> Result<f64> {
    let flat: Vec<[f64; 2]> = board.object_points().iter().map(|p| [p[0], p[1]]).collect();
    let h = cv::homography(&flat, corners)?;
    let squares: f64 = flat
        .iter()
        .zip(corners)
        .map(|(&p, seen)| {
            let q = cv::apply_homography(&h, p);
            (q[0] - seen[0]).powi(2) + (q[1] - seen[1]).powi(2)
        })
        .sum();
    Ok((squares / corners.len() as f64).sqrt())
}

/// Puts the corners in the promised order.
fn orient(mut corners: Vec<[f64; 2]>, grey: &[u8], width: usize, board: &Board) -> Vec<[f64; 2]> {
    let (columns, last) = (board.columns, corners.len() - 1);
    let edge = |from: usize, to: usize, set: &[[f64; 2]]| {
        [set[to][0] - set[from][0], set[to][1] - set[from][1]]
    };
    let (along, down) = (edge(0, columns - 1, &corners), edge(0, last + 1 - columns, &corners));
    if along[0] * down[1] - along[1] * down[0] < 0.0 {
        corners.chunks_mut(columns).for_each(<[_]>::reverse);
    }
    let turned = if board.has_one_orientation() {
        dark_minus_light(&corners, grey, width, board) > 0.0
    } else {
        let [x, y] = edge(0, columns - 1, &corners);
        x + y < 0.0
    };
    if turned {
        corners.reverse();
    }
    corners
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

/// The likeliest reason for not seeing a board.
fn why_not(grey: &[u8], width: usize) -> String {
    let mut histogram = [0_usize; 256];
    grey.iter().for_each(|&v| histogram[usize::from(v)] += 1);
    let total = grey.len().max(1);
    let share = |range: std::ops::RangeInclusive<usize>| {
        histogram[range].iter().sum::<usize>() as f64 / total as f64
    };
    if share(0..=31) > 0.97 {
        return format!(
            "too dark ({:.0} % of the pixels below 1/8 of full scale)",
            100.0 * share(0..=31)
        );
    }
    if share(250..=255) > 0.4 {
        return format!("clipped ({:.0} % of the pixels at full scale)", 100.0 * share(250..=255));
    }
    // The steepest step between pixels two apart: sharp edges take most of the contrast at once.
    let steepest = grey
        .chunks(width.max(1))
        .flat_map(|row| row.windows(3).map(|w| w[0].abs_diff(w[2])))
        .max()
        .unwrap_or(0);
    let used: Vec<usize> = (0..256).filter(|&v| histogram[v] * 1000 > total).collect();
    let contrast = used.last().zip(used.first()).map_or(0, |(high, low)| high - low);
    if contrast > 16 && usize::from(steepest) * 6 < contrast {
        return "blurred (no sharp edge anywhere)".into();
    }
    "not seen whole: is every inner corner in view, and is it this board?".into()
}
