//! Where in the picture there was something to learn from, and how the boards stood.

use serde::{Deserialize, Serialize};

use crate::geometry::result::{Geometry, ViewFit};
use crate::geometry::rig_view::RigView;

/// Cells across and down a picture: fine enough to show a gap, coarse enough that a dozen views of
/// a board a third as wide as the picture can fill them.
const CELLS: [usize; 2] = [6, 4];

/// A part of the picture: the outer quarters of width and height, and the middle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Zone {
    /// Upper left corner.
    UpperLeft,
    /// Upper edge.
    Upper,
    /// Upper right corner.
    UpperRight,
    /// Left edge.
    Left,
    /// Middle.
    Middle,
    /// Right edge.
    Right,
    /// Lower left corner.
    LowerLeft,
    /// Lower edge.
    Lower,
    /// Lower right corner.
    LowerRight,
}

impl Zone {
    const ALL: [Self; 9] = [
        Self::UpperLeft,
        Self::Upper,
        Self::UpperRight,
        Self::Left,
        Self::Middle,
        Self::Right,
        Self::LowerLeft,
        Self::Lower,
        Self::LowerRight,
    ];

    /// The zone of a pixel in a picture of `size` pixels.
    pub fn of(pixel: [f64; 2], size: [usize; 2]) -> Self {
        let third = |a: usize| {
            let share = (pixel[a] + 0.5) / size[a].max(1) as f64;
            usize::from(share >= 0.25) + usize::from(share > 0.75)
        };
        Self::ALL[3 * third(1) + third(0)]
    }

    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::UpperLeft => "upper left corner",
            Self::Upper => "upper edge",
            Self::UpperRight => "upper right corner",
            Self::Left => "left edge",
            Self::Middle => "middle",
            Self::Right => "right edge",
            Self::LowerLeft => "lower left corner",
            Self::Lower => "lower edge",
            Self::LowerRight => "lower right corner",
        }
    }
}

/// Where a device's points lie in its picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coverage {
    /// Cells across and down the picture.
    pub cells: [usize; 2],
    /// Points in each cell, row by row.
    pub points: Vec<usize>,
    /// Share of the cells that hold points.
    pub share: f64,
    /// Zones without any.
    pub empty: Vec<Zone>,
}

impl Coverage {
    /// Of points in a picture of `size` pixels.
    pub(crate) fn of(size: [usize; 2], pixels: impl Iterator<Item = [f64; 2]>) -> Self {
        let mut points = vec![0; CELLS[0] * CELLS[1]];
        let mut empty = Zone::ALL.to_vec();
        for pixel in pixels.filter(|p| p.iter().all(|v| v.is_finite())) {
            let cell = |a: usize| {
                let place = (pixel[a] + 0.5) / size[a].max(1) as f64;
                // Corners may lie half a pixel outside, lit points anywhere.
                (0.0..=1.0)
                    .contains(&place)
                    .then(|| ((place * CELLS[a] as f64) as usize).min(CELLS[a] - 1))
            };
            if let (Some(column), Some(row)) = (cell(0), cell(1)) {
                points[row * CELLS[0] + column] += 1;
                let zone = Zone::of(pixel, size);
                empty.retain(|z| *z != zone);
            }
        }
        let share = points.iter().filter(|n| **n > 0).count() as f64 / points.len() as f64;
        Self { cells: CELLS, points, share, empty }
    }
}

/// How the boards stood before the camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stance {
    /// Least and largest angle between a board's normal and the optical axis, radians.
    pub tilt_rad: [f64; 2],
    /// Largest angle between two boards, radians.
    pub between_rad: f64,
    /// Distance of the nearest and of the farthest board's middle from the camera, mm.
    pub distance_mm: [f64; 2],
}

/// How one board stood.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardStance {
    /// Angle between its normal and the optical axis, radians.
    pub tilt_rad: f64,
    /// Distance of its middle from the camera, mm.
    pub distance_mm: f64,
}

impl BoardStance {
    /// Of each view, in their order.
    pub(crate) fn all(geometry: &Geometry) -> Vec<Self> {
        let of = |(fit, seen): (&ViewFit, &RigView)| {
            let board = &seen.board.object_points;
            let n = board.len() as f64;
            let middle = [0, 1, 2].map(|a| board.iter().map(|p| p[a]).sum::<f64>() / n);
            let [x, y, z] = fit.pose.apply(middle);
            let normal = fit.pose.rotate([0.0, 0.0, 1.0]);
            Self {
                tilt_rad: normal[2].abs().min(1.0).acos(),
                distance_mm: (x * x + y * y + z * z).sqrt(),
            }
        };
        geometry.views.iter().zip(&geometry.observations).map(of).collect()
    }
}

impl Stance {
    pub(crate) fn of(geometry: &Geometry, boards: &[BoardStance]) -> Self {
        let range = |pick: fn(&BoardStance) -> f64| {
            let all = || boards.iter().map(pick);
            [all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max)]
        };
        let normals: Vec<[f64; 3]> =
            geometry.views.iter().map(|v| v.pose.rotate([0.0, 0.0, 1.0])).collect();
        let cosine = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let least = normals
            .iter()
            .flat_map(|a| normals.iter().map(move |b| cosine(a, b).abs()))
            .fold(1.0, f64::min);
        Self {
            tilt_rad: range(|b| b.tilt_rad),
            between_rad: least.clamp(0.0, 1.0).acos(),
            distance_mm: range(|b| b.distance_mm),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_without_points_are_named() {
        let size = [600, 400];
        // Everything but the lower left corner: x below 150 and y beyond 300.
        let points = (0..600).step_by(10).flat_map(|x| (0..400).step_by(10).map(move |y| (x, y)));
        let points = points.filter(|&(x, y)| x >= 150 || y <= 290);
        let coverage = Coverage::of(size, points.map(|(x, y)| [f64::from(x), f64::from(y)]));
        assert_eq!(coverage.empty, [Zone::LowerLeft]);
        assert_eq!(coverage.empty[0].name(), "lower left corner");
        // Of the lowest row's cells of 100 x 100 only the first is empty altogether.
        assert_eq!(coverage.points.iter().filter(|n| **n == 0).count(), 1);
        assert!((coverage.share - 23.0 / 24.0).abs() < 1e-12);
    }

    #[test]
    fn points_outside_of_the_picture_cover_nothing() {
        let outside = [[-30.0, 10.0], [10.0, 500.0], [f64::NAN, 1.0]];
        let coverage = Coverage::of([600, 400], outside.into_iter());
        assert_eq!((coverage.share, coverage.empty.len()), (0.0, 9));
    }
}
