//! Printed things: the chessboard, blank sheets and the colour chart, as flat Lambertian targets.

use crate::OpticalSetup;
use glam::{DMat3, DVec2, DVec3};
use material::Face;
use rig::{HeldBoard, Target};

/// Inner corners a row of the printed chessboard.
pub const BOARD_COLUMNS: usize = 9;
/// Inner corners a column of the printed chessboard.
pub const BOARD_ROWS: usize = 6;

/// Albedo of the board's ink and paper.
const INK: f64 = 0.05;
const PAPER: f64 = 0.85;
/// Width of the paper around the printed squares, in squares. What the projector shows on the
/// sheet must fall on it.
const MARGIN: f64 = 4.0;

/// A patch of the colour chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChartPatch {
    /// Linear reflectance of red, green and blue.
    pub reflectance: [f64; 3],
}

/// The 24 patches of a ColorChecker Classic, row by row from dark skin to black.
///
/// The chart's published 8-bit sRGB values, decoded by the sRGB transfer function.
pub fn chart_patches() -> [ChartPatch; 24] {
    const SRGB: [[u8; 3]; 24] = [
        [115, 82, 68],
        [194, 150, 130],
        [98, 122, 157],
        [87, 108, 67],
        [133, 128, 177],
        [103, 189, 170],
        [214, 126, 44],
        [80, 91, 166],
        [193, 90, 99],
        [94, 60, 108],
        [157, 188, 64],
        [224, 163, 46],
        [56, 61, 150],
        [70, 148, 73],
        [175, 54, 60],
        [231, 199, 31],
        [187, 86, 149],
        [8, 133, 161],
        [243, 243, 242],
        [200, 200, 200],
        [160, 160, 160],
        [122, 122, 121],
        [85, 85, 85],
        [52, 52, 52],
    ];
    let linear = |v: u8| {
        let s = f64::from(v) / 255.0;
        if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
    };
    SRGB.map(|rgb| ChartPatch { reflectance: rgb.map(linear) })
}

/// Something flat that a picture is taken of.
pub(crate) struct FlatTarget {
    /// The plane's origin: the board's first inner corner, or the middle of a sheet or chart.
    pub origin: DVec3,
    /// Unit vectors along the target's x and y, sample frame.
    pub axes: [DVec3; 2],
    print: Print,
}

enum Print {
    Board { square: f64 },
    Sheet { half_width: f64 },
    Chart { pitch: f64, patches: Box<[ChartPatch; 24]> },
}

impl FlatTarget {
    /// The target in its place; None for what is no flat thing on the bench.
    pub fn new(target: &Target, setup: &OpticalSetup) -> Option<Self> {
        let [w, h, d] = setup.block_mm;
        let unit = w.max(h);
        let square = square_mm(setup);
        let face_z = |face: &Face| match face {
            Face::Front => 0.0,
            Face::Back => d,
        };
        let middle = |z: f64| DVec3::new(w / 2.0, h / 2.0, z);
        let upright = [DVec3::X, DVec3::Y];
        let to_corner =
            square * DVec2::new(BOARD_COLUMNS as f64 - 1.0, BOARD_ROWS as f64 - 1.0) / 2.0;
        let paper = Print::Sheet { half_width: 1.2 * unit };
        Some(match target {
            Target::Sample | Target::Dark | Target::Flat => return None,
            Target::Board { pose } | Target::Sheet { pose } => {
                let (centre, axes) = held(*pose, unit);
                let origin = middle(0.0) + centre - axes[0] * to_corner.x - axes[1] * to_corner.y;
                let print = match target {
                    Target::Board { .. } => Print::Board { square },
                    _ => paper,
                };
                Self { origin, axes, print }
            }
            Target::FaceBoard { face } => {
                let origin = middle(face_z(face)) - to_corner.extend(0.0);
                Self { origin, axes: upright, print: Print::Board { square } }
            }
            Target::FaceSheet { face } => {
                let print = Print::Sheet { half_width: 1.2 * unit };
                Self { origin: middle(face_z(face)), axes: upright, print }
            }
            Target::Chart => {
                let print = Print::Chart { pitch: unit / 6.6, patches: Box::new(chart_patches()) };
                Self { origin: middle(0.0), axes: upright, print }
            }
        })
    }

    /// Where a ray from `from` meets the plane, and the place in the target's own coordinates.
    pub fn hit(&self, from: DVec3, direction: DVec3) -> Option<(DVec3, DVec2)> {
        let normal = self.normal();
        let distance = normal.dot(self.origin - from) / normal.dot(direction);
        (distance.is_finite() && distance > 0.0).then(|| {
            let point = from + distance * direction;
            let local = point - self.origin;
            (point, DVec2::new(local.dot(self.axes[0]), local.dot(self.axes[1])))
        })
    }

    pub fn normal(&self) -> DVec3 {
        self.axes[0].cross(self.axes[1])
    }

    /// Albedo of red, green and blue at a place.
    pub fn albedo(&self, at: DVec2) -> [f64; 3] {
        match &self.print {
            Print::Board { square } => {
                let cell = at / *square + 1.0;
                let (columns, rows) = (BOARD_COLUMNS as f64 + 1.0, BOARD_ROWS as f64 + 1.0);
                let beyond = (-cell).max(cell - DVec2::new(columns, rows)).max(DVec2::ZERO);
                let on_board = beyond == DVec2::ZERO;
                let dark = on_board && (cell.x.floor() + cell.y.floor()) % 2.0 == 0.0;
                let value = match (dark, beyond.max_element() < MARGIN) {
                    (true, _) => INK,
                    (false, true) => PAPER,
                    (false, false) => 0.0,
                };
                [value; 3]
            }
            Print::Sheet { half_width } => {
                [if at.abs().max_element() < *half_width { 1.0 } else { 0.0 }; 3]
            }
            Print::Chart { pitch, patches } => {
                let cell = at / *pitch + DVec2::new(3.0, 2.0);
                let within = cell.cmpge(DVec2::ZERO).all() && cell.x < 6.0 && cell.y < 4.0;
                let from_edge = (cell - cell.floor() - 0.5).abs().max_element();
                if within && from_edge < 0.42 {
                    patches[cell.y as usize * 6 + cell.x as usize].reflectance
                } else if (cell - DVec2::new(3.0, 2.0)).abs().cmplt(DVec2::new(3.15, 2.15)).all() {
                    [0.03; 3]
                } else {
                    [0.9; 3]
                }
            }
        }
    }
}

/// Edge of a square of the printed board that fits this rig, mm.
pub(crate) fn square_mm(setup: &OpticalSetup) -> f64 {
    // Whole tenths of a millimetre, as a print shop would be asked for.
    (setup.block_mm[0].max(setup.block_mm[1]) * 0.8).round() / 10.0
}

/// A board held up in front of the camera: its middle relative to the face's, and its axes.
fn held(pose: usize, unit: f64) -> (DVec3, [DVec3; 2]) {
    let held = HeldBoard::pose(pose);
    let [about_x, about_y] = held.tilt_deg.map(f64::to_radians);
    let roll = held.roll_deg.to_radians();
    let turn = DMat3::from_rotation_x(about_x)
        * DMat3::from_rotation_y(about_y)
        * DMat3::from_rotation_z(roll);
    let place = held.place.map(|p| p * unit);
    (DVec3::from_array(place), [turn * DVec3::X, turn * DVec3::Y])
}
