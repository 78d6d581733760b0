//! How the chessboard is to be held for each picture of a calibration.

use std::fmt;

/// Tilt and place of the board in one pose.
///
/// Tilts look at the board from all sides, and places reach all corners of the picture; both
/// repeat, out of step, so that no two poses of a usual set are alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldBoard {
    /// Turns about the picture's x axis (positive: lower edge away from the camera) and, before
    /// that, about its y axis (positive: right edge towards the camera), degrees.
    pub tilt_deg: [f64; 2],
    /// Turn in the board's own plane, before both, degrees.
    pub roll_deg: f64,
    /// Right, down, and away from the camera, in widths of the sample, from the middle of its
    /// face.
    pub place: [f64; 3],
}

const TILTS_DEG: [[f64; 2]; 9] = [
    [4.0, -6.0],
    [28.0, 3.0],
    [-26.0, -4.0],
    [5.0, 30.0],
    [-3.0, -29.0],
    [21.0, 22.0],
    [-22.0, 20.0],
    [20.0, -23.0],
    [-19.0, -21.0],
];

const PLACES: [[f64; 3]; 7] = [
    [0.0, 0.0, 0.0],
    [-0.22, -0.14, 0.25],
    [0.2, 0.13, -0.3],
    [0.22, -0.13, 0.4],
    [-0.2, 0.14, -0.15],
    [0.05, -0.12, 0.5],
    [-0.08, 0.11, -0.4],
];

impl HeldBoard {
    /// How to hold the board in a pose; poses count from 0.
    pub fn pose(pose: usize) -> Self {
        Self {
            tilt_deg: TILTS_DEG[pose % TILTS_DEG.len()],
            roll_deg: 0.5 * (7.0 * ((pose * 5) % 7) as f64 - 20.0),
            place: PLACES[pose % PLACES.len()],
        }
    }
}

/// In words for the person who holds it: where in the picture, how far, and how it is tilted.
impl fmt::Display for HeldBoard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = |value: f64, limit: f64, low: &'static str, high: &'static str| match value {
            v if v < -limit => low,
            v if v > limit => high,
            _ => "",
        };
        let [x, y, z] = self.place;
        let (row, column) = (word(y, 0.1, "upper", "lower"), word(x, 0.1, "left", "right"));
        match (row, column) {
            ("", "") => write!(f, "in the middle of the picture")?,
            (row, "") => write!(f, "in the {row} middle of the picture")?,
            ("", column) => write!(f, "in the {column} of the picture")?,
            (row, column) => write!(f, "in the {row} {column} of the picture")?,
        }
        let depth = word(z, 0.1, ", nearer than the sample", ", farther than the sample");
        let [about_x, about_y] = self.tilt_deg;
        let vertical = word(about_x, 10.0, "upper edge", "lower edge");
        let sideways = word(about_y, 10.0, "right edge", "left edge");
        let largest = about_x.abs().max(about_y.abs());
        match (vertical, sideways) {
            ("", "") => write!(f, "{depth}, nearly facing the camera"),
            (one, "") | ("", one) => write!(f, "{depth}, its {one} {largest:.0} degrees away"),
            (a, b) => write!(f, "{depth}, its {a} and {b} {largest:.0} degrees away"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_differ_and_are_told_in_words() {
        let words: Vec<String> = (0..12).map(|p| HeldBoard::pose(p).to_string()).collect();
        for (i, a) in words.iter().enumerate() {
            assert!(!words[..i].contains(a), "{a}");
        }
        assert_eq!(words[0], "in the middle of the picture, nearly facing the camera");
        assert_eq!(
            words[1],
            "in the upper left of the picture, farther than the sample, its lower edge 28 degrees away"
        );
        assert_eq!(
            words[7],
            "in the middle of the picture, its lower edge and right edge 23 degrees away"
        );
    }
}
