//! How good a picture of a board is, from the corners found in it.

use serde::{Deserialize, Serialize};

use crate::detection::board::Board;
use crate::detection::found::SeenCorner;
use crate::detection::missing::NoBoard;
use crate::detection::neighbours::Grid;
use crate::median::median;
use crate::photo::Photo;

/// How good the picture of a board is: cheap enough to tell while the technician still stands
/// there. NaN where too few corners are seen to measure.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoardQuality {
    /// Width of the squares' edges from 10 to 90 % of their step, median, pixels: 0.8 for a
    /// perfect lens, 2.56 σ under a Gaussian blur of σ. On a ChArUco board edges can only be
    /// followed as far as the next marker, so that a large blur reads smaller.
    pub edge_width_px: f64,
    /// Shortest edge of a square, pixels.
    pub square_px: f64,
    /// Light minus dark squares, medians, over full scale.
    pub contrast: f64,
    /// Share of the light squares' samples at full scale in some channel.
    pub clipped_share: f64,
    /// Left, top, right and bottom of the corners, pixels.
    pub bounds_px: [f64; 4],
    /// Area of the corners' convex hull over the picture's.
    pub frame_share: f64,
    /// Angle between the board's normal and the line of sight, radians, from the foreshortening
    /// at the board's middle; exact for a board far away on the optical axis.
    pub tilt_rad: f64,
}

/// Edges wider than this share of a square reach out of the windows that corners are refined in:
/// on real views, blurred, corners move by 0.06 px at 0.28, 0.25 px at 0.36 and 0.6 px at 0.47.
const WIDEST_EDGE: f64 = 0.4;

/// Light squares at full scale with less contrast than this have eaten into the dark ones: at 0.6
/// corners move by 0.3 px, at 0.2 by 3 px.
const CLIPPED_CONTRAST: f64 = 0.4;

/// Squares below this are smaller than the smallest window of five pixels and its neighbours.
const SMALLEST_SQUARE_PX: f64 = 6.0;

/// With fewer codes between light and dark, rounding to whole codes moves the corners.
const FEWEST_CODES: f64 = 8.0;

/// Why corners that were found are worth nothing all the same.
pub(crate) fn useless(quality: &BoardQuality, max_value: u16) -> Option<NoBoard> {
    let contrast_codes = quality.contrast * f64::from(max_value);
    let &BoardQuality { edge_width_px: edge_px, square_px, clipped_share, .. } = quality;
    if contrast_codes < FEWEST_CODES {
        Some(NoBoard::TooFaint { contrast_codes })
    } else if square_px < SMALLEST_SQUARE_PX {
        Some(NoBoard::TooSmall { square_px })
    } else if clipped_share > 0.5 && quality.contrast < CLIPPED_CONTRAST {
        Some(NoBoard::Clipped { share: clipped_share })
    } else if edge_px > WIDEST_EDGE * square_px {
        Some(NoBoard::Blurred { edge_px, square_px: Some(square_px) })
    } else {
        None
    }
}

impl BoardQuality {
    pub(crate) fn measure(photo: &Photo, board: &Board, corners: &[SeenCorner]) -> Self {
        let grid = Grid::new(board, corners);
        let edges = Edges::measure(photo, board, &grid, corners);
        let middle = |mut values: Vec<f64>| median(&mut values).unwrap_or(f64::NAN);
        let pixels: Vec<[f64; 2]> = corners.iter().map(|c| c.pixel).collect();
        let extreme = |axis: usize, start: f64, pick: fn(f64, f64) -> f64| {
            pixels.iter().map(|p| p[axis]).fold(start, pick)
        };
        let square_px = corners.iter().map(|c| grid.nearest(c.index)).fold(f64::INFINITY, f64::min);
        Self {
            edge_width_px: middle(edges.widths),
            square_px: if square_px.is_finite() { square_px } else { f64::NAN },
            contrast: middle(edges.light) - middle(edges.dark),
            clipped_share: edges.clipped as f64 / edges.samples.max(1) as f64,
            bounds_px: [
                extreme(0, f64::INFINITY, f64::min),
                extreme(1, f64::INFINITY, f64::min),
                extreme(0, f64::NEG_INFINITY, f64::max),
                extreme(1, f64::NEG_INFINITY, f64::max),
            ],
            frame_share: hull_area(pixels) / (photo.width * photo.height).max(1) as f64,
            tilt_rad: tilt(board, corners),
        }
    }
}

/// What the profiles across the squares' edges say.
#[derive(Default)]
struct Edges {
    widths: Vec<f64>,
    light: Vec<f64>,
    dark: Vec<f64>,
    clipped: usize,
    samples: usize,
}

impl Edges {
    fn measure(photo: &Photo, board: &Board, grid: &Grid, corners: &[SeenCorner]) -> Self {
        let mut edges = Self::default();
        let reach = (0.9 * board.free_squares()).min(0.45);
        for corner in corners {
            let (c, r) = grid.place(corner.index);
            // Along the row with the square below it, and along the column with the one beside.
            for [along, across] in [[(1, 0), (0, 1)], [(0, 1), (1, 0)]] {
                let next = |(dc, dr): (isize, isize), times: isize| {
                    grid.at(c + times * dc, r + times * dr)
                };
                let end = next(along, 1);
                let beside = next(across, 1).or_else(|| {
                    let back = next(across, -1)?;
                    Some(std::array::from_fn(|a| 2.0 * corner.pixel[a] - back[a]))
                });
                if let (Some(end), Some(beside)) = (end, beside) {
                    edges.follow(photo, corner.pixel, end, beside, reach);
                }
            }
        }
        edges
    }

    /// One profile across the edge from `a` to `b`, `reach` squares to each side.
    fn follow(&mut self, photo: &Photo, a: [f64; 2], b: [f64; 2], beside: [f64; 2], reach: f64) {
        let edge = [b[0] - a[0], b[1] - a[1]];
        let across = [beside[0] - a[0], beside[1] - a[1]];
        let length = across[0].hypot(across[1]);
        // Seen at a slant an edge is narrower than the way across it.
        let slant = (edge[0] * across[1] - edge[1] * across[0]).abs()
            / (edge[0].hypot(edge[1]) * length).max(f64::MIN_POSITIVE);
        let steps = (8.0 * reach * length).ceil().clamp(8.0, 400.0) as usize;
        let mut profile = Vec::with_capacity(steps + 1);
        for step in 0..=steps {
            let t = reach * (2.0 * step as f64 / steps as f64 - 1.0);
            // The mean of three ways across, away from the corners at both ends.
            let mut sum = 0.0;
            for s in [0.4, 0.5, 0.6] {
                let at = std::array::from_fn(|k| a[k] + s * edge[k] + t * across[k]);
                let Some(value) = light_at(photo, at) else { return };
                sum += value / 3.0;
            }
            profile.push(sum);
        }
        if profile.first() > profile.last() {
            profile.reverse();
        }
        let plateau = (steps / 6).max(1);
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let (dark, light) = (mean(&profile[..plateau]), mean(&profile[steps + 1 - plateau..]));
        let crossing = |share: f64| {
            let level = dark + share * (light - dark);
            let after = profile.iter().position(|v| *v >= level)?;
            let before = after.checked_sub(1)?;
            let part = (level - profile[before]) / (profile[after] - profile[before]);
            Some(before as f64 + part)
        };
        if let (Some(low), Some(high)) = (crossing(0.1), crossing(0.9)) {
            let step_px = 2.0 * reach * length / steps as f64;
            self.widths.push((high - low).max(0.0) * step_px * slant);
        }
        self.dark.push(dark);
        self.light.push(light);
        self.samples += plateau;
        self.clipped += profile[steps + 1 - plateau..].iter().filter(|v| **v >= CLIPPED).count();
    }
}

/// Of full scale: rounding and JPEG keep clipped squares a little below it.
pub(crate) const CLIPPED: f64 = 0.985;

/// The brightest channel at a place between pixels, over full scale; None outside.
fn light_at(photo: &Photo, [x, y]: [f64; 2]) -> Option<f64> {
    let inside = x >= 0.0 && y >= 0.0;
    if !inside || x + 1.0 >= photo.width as f64 || y + 1.0 >= photo.height as f64 {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (fx, fy) = (x - column as f64, y - row as f64);
    let mut brightest = 0.0_f64;
    for channel in 0..photo.channels {
        let value = |dx: usize, dy: usize| {
            let at = ((row + dy) * photo.width + column + dx) * photo.channels + channel;
            photo.data.get(at).map_or(0.0, |v| f64::from(*v))
        };
        let top = value(0, 0) + fx * (value(1, 0) - value(0, 0));
        let bottom = value(0, 1) + fx * (value(1, 1) - value(0, 1));
        brightest = brightest.max(top + fy * (bottom - top));
    }
    Some(brightest / f64::from(photo.max_value))
}

/// From the plane map's linear part: a tilted square is shorter one way than the other, by the
/// cosine of the tilt.
fn tilt(board: &Board, corners: &[SeenCorner]) -> f64 {
    let n = corners.len() as f64;
    let places: Vec<[f64; 2]> = corners
        .iter()
        .map(|c| board.object_point(c.index))
        .map(|p| [p[0] / board.square_mm, p[1] / board.square_mm])
        .collect();
    let middle = |f: &dyn Fn(usize) -> f64| (0..corners.len()).map(f).sum::<f64>() / n;
    let [x, y, u, v] = [
        middle(&|i| places[i][0]),
        middle(&|i| places[i][1]),
        middle(&|i| corners[i].pixel[0]),
        middle(&|i| corners[i].pixel[1]),
    ];
    let sum = |f: &dyn Fn([f64; 2], [f64; 2]) -> f64| -> f64 {
        let each = places
            .iter()
            .zip(corners)
            .map(|(p, c)| f([p[0] - x, p[1] - y], [c.pixel[0] - u, c.pixel[1] - v]));
        each.sum()
    };
    let (xx, xy, yy) =
        (sum(&|p, _| p[0] * p[0]), sum(&|p, _| p[0] * p[1]), sum(&|p, _| p[1] * p[1]));
    let determinant = xx * yy - xy * xy;
    let row = |axis: usize| {
        let (a, b) = (sum(&|p, q| p[0] * q[axis]), sum(&|p, q| p[1] * q[axis]));
        [(a * yy - b * xy) / determinant, (b * xx - a * xy) / determinant]
    };
    let ([a, b], [c, d]) = (row(0), row(1));
    // Singular values of [[a, b], [c, d]]: sum and difference of two lengths.
    let (p, q) = ((a + d).hypot(b - c) / 2.0, (a - d).hypot(b + c) / 2.0);
    ((p - q).abs() / (p + q)).acos()
}

/// Area of the convex hull (Andrew's chains), square pixels.
fn hull_area(mut points: Vec<[f64; 2]>) -> f64 {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut hull: Vec<[f64; 2]> = Vec::new();
        for p in points {
            while let [.., a, b] = hull[..]
                && (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0
            {
                hull.pop();
            }
            hull.push(p);
        }
        hull.pop();
        hull
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    let next = |i: usize| hull[(i + 1) % hull.len()];
    let twice: f64 =
        (0..hull.len()).map(|i| hull[i][0] * next(i)[1] - hull[i][1] * next(i)[0]).sum();
    twice.abs() / 2.0
}
