//! Projector pixels of a printed board's corners.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::geometry::rig_view::CodedCorner;
use crate::structured_light::decode::{CodeMap, Decoded};
use crate::structured_light::homography::{Equation, LocalFit, fit};
use crate::structured_light::steps::StepMap;

/// A corner of the board as the projector "sees" it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LitCorner {
    /// Projector pixel, the centre of the first at (0, 0).
    pub pixel: [f64; 2],
    /// ∂(projector pixel)/∂(camera pixel) there, row by row.
    pub slope: [[f64; 2]; 2],
    /// 1-sigma of either coordinate, projector pixels, without the corner's own error in the
    /// camera's picture.
    pub sigma_px: f64,
    /// Places in the window whose code agrees with the map.
    pub pixels_used: usize,
    /// RMS of what they differ from it by, projector pixels.
    pub rms_px: f64,
}

/// Half a window over the distance to the nearest corner: what is fitted is one square around it.
const WINDOW_SHARE: f64 = 0.5;
/// Half windows, camera pixels: enough to determine a map, little enough for one map to hold.
const HALF_WINDOW_PX: std::ops::RangeInclusive<f64> = 6.0..=60.0;
/// Places that an axis needs.
const LEAST_PLACES: usize = 40;
/// Share of the places that must agree with one map.
const LEAST_AGREEMENT: f64 = 0.6;

/// Projector pixels of points in the camera's picture, by a projective map of the window around
/// each (Moreno & Taubin 2012): pixels are blurred and codes are whole numbers, the map around a
/// corner is neither.
///
/// The window follows from the distance to the nearest other corner. From Gray code alone the map
/// is fitted to the stripes' edges, which lie half-way between projector pixels and are known to a
/// fraction of a camera pixel; where the camera is too coarse for them, to the pixels' codes; with
/// phase shift to the pixels' positions.
///
/// `None` for a corner around which too little was decided, or whose surroundings are no plane.
pub fn light_corners(decoded: &Decoded, corners: &[[f64; 2]]) -> Vec<Option<LitCorner>> {
    corners.par_iter().map(|&corner| light_corner(decoded, corner, corners)).collect()
}

/// [`light_corners`] of a board as a calibration takes them: those that have a projector pixel, by
/// their number.
pub fn coded_corners(decoded: &Decoded, corners: &[[f64; 2]]) -> Vec<CodedCorner> {
    let lit = light_corners(decoded, corners);
    let coded = lit.iter().enumerate().filter_map(|(corner, lit)| {
        let LitCorner { pixel: projector_px, slope, .. } = (*lit)?;
        Some(CodedCorner { corner, projector_px, slope })
    });
    coded.collect()
}

fn light_corner(decoded: &Decoded, corner: [f64; 2], all: &[[f64; 2]]) -> Option<LitCorner> {
    let distance = |other: &[f64; 2]| (other[0] - corner[0]).hypot(other[1] - corner[1]);
    let nearest = all.iter().map(distance).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let half = (WINDOW_SHARE * nearest).clamp(*HALF_WINDOW_PX.start(), *HALF_WINDOW_PX.end());
    if !corner.iter().all(|c| c.is_finite()) {
        return None;
    }
    let window = Window { decoded, corner, half };
    let mut equations = Vec::new();
    for (axis, map) in [&decoded.columns, &decoded.rows].into_iter().enumerate() {
        let own = window.equations(axis, map);
        if own.len() < LEAST_PLACES {
            return None;
        }
        equations.extend(own);
    }
    let found = fit(&equations)?;
    let agree = found.used as f64 >= LEAST_AGREEMENT * equations.len() as f64;
    let sigma_px = (0.5 * found.sigma.iter().map(|s| s * s).sum::<f64>()).sqrt();
    let slope = found.slope.map(|row| row.map(|s| s / half));
    let LocalFit { image: pixel, used: pixels_used, rms: rms_px, .. } = found;
    let finite = pixel.iter().chain(slope.as_flattened()).all(|v| v.is_finite());
    (agree && finite && sigma_px.is_finite()).then_some(LitCorner {
        pixel,
        slope,
        sigma_px,
        pixels_used,
        rms_px,
    })
}

struct Window<'a> {
    decoded: &'a Decoded,
    corner: [f64; 2],
    half: f64,
}

impl Window<'_> {
    fn equations(&self, axis: usize, map: &CodeMap) -> Vec<Equation> {
        let equation = |x: f64, y: f64, value: f64| Equation {
            at: [(x - self.corner[0]) / self.half, (y - self.corner[1]) / self.half],
            axis,
            value,
        };
        let width = self.decoded.width;
        let [rows, columns] = [(1, self.decoded.height), (0, width)].map(|(axis, size)| {
            let edge = |v: f64| v.round().clamp(0.0, size.saturating_sub(1) as f64) as usize;
            edge(self.corner[axis] - self.half)..=edge(self.corner[axis] + self.half)
        });
        let mut steps = Vec::new();
        let mut pixels = Vec::new();
        for y in rows {
            for x in columns.clone() {
                let at = y * width + x;
                let here = f64::from(map.position[at]);
                if !here.is_finite() {
                    continue;
                }
                let (u, v) = (x as f64, y as f64);
                pixels.push(equation(u, v, here));
                // Without a phase, neighbours of whole numbers: the step is half-way between them.
                let half_way = |other: usize| (here + f64::from(map.position[other])) / 2.0;
                if let Some(way) = StepMap::way(map.steps.right[at]) {
                    steps.push(equation(u + way, v, half_way(at + 1)));
                }
                if let Some(way) = StepMap::way(map.steps.down[at]) {
                    steps.push(equation(u, v + way, half_way(at + width)));
                }
            }
        }
        if steps.len() < LEAST_PLACES { pixels } else { steps }
    }
}
