//! ChArUco boards: markers say which corners are in view.

use opencv::aruco;
use opencv::core::{Point2f, Ptr, Vector};
use opencv::prelude::*;

use crate::cv;
use crate::detection::board::{Board, Markers};
use crate::detection::found::SeenCorner;
use crate::detection::missing::{Look, NoBoard};
use crate::detection::refine::{refine, soften};
use crate::error::{CalibrationError, Result};

/// A plane map has eight unknowns; six corners leave something to judge it by.
const FEWEST_CORNERS: usize = 6;

/// Half the refinement's window, pixels, below which it holds too little of the corner.
const SMALLEST_WINDOW_PX: f64 = 1.5;

/// Markers farther off their place than this share of their edge are somebody else's: lens
/// distortion bends a board by less.
const MISPLACED: f64 = 0.25;

/// Corners from a marker's to the next but one square's help to place a corner.
const NEAR_SQUARES: f64 = 1.6;

/// A marker that was read: its number and its corners, clockwise from its own top left, pixels.
struct Marker {
    id: usize,
    corners: [[f64; 2]; 4],
}

/// A marker where the board has one: the middle of its square, in squares from corner 0.
struct Placed<'a> {
    middle: [f64; 2],
    marker: &'a Marker,
}

/// The corners of a ChArUco board that lie between two markers that were read.
pub(crate) fn find(grey: &[u8], width: usize, board: &Board, markers: &Markers) -> Result<Look> {
    let failed = CalibrationError::opencv("looking for a ChArUco board");
    let full = cv::grey_mat(grey, width).map_err(&failed)?;
    let read = read_markers(&full, markers).map_err(&failed)?;
    if read.is_empty() {
        return Ok(Err(NoBoard::NotSeen));
    }
    let edge = markers.edge_mm / board.square_mm;
    // Printers differ in the colour of the first square (OpenCV before 4.6 with an even number of
    // rows): the layout that more markers agree with is the one.
    let [dark_first, light_first] = [1, 0].map(|parity| place(&read, board, edge, parity));
    let (dark_first, light_first) = (dark_first?, light_first?);
    let (placed, parity) =
        if light_first.len() > dark_first.len() { (light_first, 0) } else { (dark_first, 1) };
    if placed.len() < 2 || placed.len() * 2 < read.len() {
        return Ok(Err(NoBoard::OtherMarkers { read: read.len(), fitting: placed.len() }));
    }
    let soft = soften(&full).map_err(&failed)?;
    let mut corners = Vec::new();
    let mut smallest = f64::INFINITY;
    for index in 0..board.corners() {
        let (c, r) = (index % board.columns, index / board.columns);
        let corner = [c as f64, r as f64];
        // The two light squares that meet here: the pair with the layout's colour.
        let across = if (c + r) % 2 == parity {
            [[-0.5, -0.5], [0.5, 0.5]]
        } else {
            [[0.5, -0.5], [-0.5, 0.5]]
        };
        let whole = across.iter().all(|off| {
            placed.iter().any(|p| (0..2).all(|a| (p.middle[a] - corner[a] - off[a]).abs() < 0.1))
        });
        if !whole {
            continue;
        }
        let near = placed
            .iter()
            .filter(|p| (p.middle[0] - corner[0]).hypot(p.middle[1] - corner[1]) < NEAR_SQUARES);
        let near: Vec<&Placed> = near.collect();
        let (from, to) = pairs(near.iter().copied(), edge);
        let map = cv::homography(&from, &to)?;
        let rough = cv::apply_homography(&map, corner);
        let square_px =
            near.iter().map(|p| p.marker.shortest_side()).fold(f64::INFINITY, f64::min) / edge;
        smallest = smallest.min(square_px);
        // The window ends before the markers begin.
        let half = 0.9 * board.free_squares() * square_px;
        let inside = |v: f64, size: usize| v >= 0.0 && v < size as f64;
        let in_picture = inside(rough[0], width) && inside(rough[1], grey.len() / width.max(1));
        if half < SMALLEST_WINDOW_PX || !in_picture {
            continue;
        }
        let half = half.floor().clamp(2.0, 25.0) as i32;
        if let Some(pixel) = refine(&soft, rough, half).map_err(&failed)? {
            corners.push(SeenCorner { index, pixel });
        }
    }
    let distinct = |axis: fn(usize, usize) -> usize| {
        let mut seen: Vec<usize> = corners.iter().map(|c| axis(c.index, board.columns)).collect();
        seen.sort_unstable();
        seen.dedup();
        seen.len()
    };
    let spread = distinct(|i, n| i % n).min(distinct(|i, n| i / n)) >= 2;
    if spread && corners.len() >= FEWEST_CORNERS {
        return Ok(Ok(corners));
    }
    let too_small = 0.9 * board.free_squares() * smallest < SMALLEST_WINDOW_PX;
    Ok(Err(if too_small {
        NoBoard::TooSmall { square_px: smallest }
    } else {
        NoBoard::Incomplete { seen: corners.len(), corners: FEWEST_CORNERS }
    }))
}

impl Marker {
    fn shortest_side(&self) -> f64 {
        let [a, b, c, d] = self.corners;
        [[a, b], [b, c], [c, d], [d, a]]
            .map(|[p, q]| (q[0] - p[0]).hypot(q[1] - p[1]))
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    }
}

fn read_markers(full: &Mat, markers: &Markers) -> opencv::Result<Vec<Marker>> {
    let set = aruco::get_predefined_dictionary_i32(markers.dictionary.opencv_number())?;
    let parameters: Ptr<aruco::DetectorParameters> = aruco::DetectorParameters::create()?;
    let mut corners = Vector::<Vector<Point2f>>::new();
    let mut rejected = Vector::<Vector<Point2f>>::new();
    let mut ids = Vector::<i32>::new();
    aruco::detect_markers(full, &set, &mut corners, &mut ids, &parameters, &mut rejected)?;
    let read = ids.iter().zip(corners.iter()).filter_map(|(id, ring)| {
        let corners = cv::points_from(&ring).try_into().ok()?;
        Some(Marker { id: usize::try_from(id).ok()?, corners })
    });
    Ok(read.collect())
}

/// The markers that stand where a board has them whose light squares are those with
/// (column + row) mod 2 = `parity`.
fn place<'a>(
    read: &'a [Marker],
    board: &Board,
    edge: f64,
    parity: usize,
) -> Result<Vec<Placed<'a>>> {
    let across = board.columns + 1;
    let light = (0..across * (board.rows + 1)).filter(|i| (i % across + i / across) % 2 == parity);
    let middles: Vec<[f64; 2]> =
        light.map(|i| [(i % across) as f64 - 0.5, (i / across) as f64 - 0.5]).collect();
    let on_board: Vec<Placed> = read
        .iter()
        .filter_map(|marker| Some(Placed { middle: *middles.get(marker.id)?, marker }))
        .collect();
    if on_board.is_empty() {
        return Ok(on_board);
    }
    let (from, to) = pairs(on_board.iter(), edge);
    let mut sides: Vec<f64> = read.iter().map(Marker::shortest_side).collect();
    sides.sort_unstable_by(f64::total_cmp);
    let tolerance = MISPLACED * sides[sides.len() / 2];
    let Some(map) = cv::homography_of_most(&from, &to, tolerance)? else { return Ok(Vec::new()) };
    let fits = |p: &Placed| {
        let (from, to) = pairs(std::iter::once(p), edge);
        from.iter().zip(&to).all(|(from, to)| {
            let at = cv::apply_homography(&map, *from);
            (at[0] - to[0]).hypot(at[1] - to[1]) <= tolerance
        })
    };
    Ok(on_board.into_iter().filter(fits).collect())
}

/// Corners of markers: on the board, in squares from corner 0, and in the picture.
fn pairs<'a>(
    placed: impl Iterator<Item = &'a Placed<'a>>,
    edge: f64,
) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let half = edge / 2.0;
    placed
        .flat_map(|p| {
            let [x, y] = p.middle;
            [[-half, -half], [half, -half], [half, half], [-half, half]]
                .map(|[dx, dy]| [x + dx, y + dy])
                .into_iter()
                .zip(p.marker.corners)
        })
        .unzip()
}
