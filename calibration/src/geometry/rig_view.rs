//! One pose of the board, as the camera sees it and the projector lights it.

use serde::{Deserialize, Serialize};

use crate::geometry::camera::View;

/// What kind of thing was seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sight {
    /// A printed corner in the camera's picture.
    Printed,
    /// The projector pixel that lights a printed corner.
    Coded,
    /// A projected point in the camera's picture.
    Projected,
}

/// One pose of the board with everything that was observed in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigView {
    /// The printed board in the camera's picture.
    pub board: View,
    /// Printed corners whose projector pixels were read from coded light.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub coded: Vec<CodedCorner>,
    /// Points that the projector lit on the board's plane, away from the printed corners.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub projected: Vec<ProjectedPoint>,
}

/// A printed corner and the projector pixel that lights it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CodedCorner {
    /// Which of the board's points.
    pub corner: usize,
    /// The projector pixel read at the place where the corner was seen.
    pub projector_px: [f64; 2],
    /// ∂(projector pixel)/∂(camera pixel) around the corner, row by row; zero where it is not
    /// known, which takes errors of finding the corner for errors of reading the code.
    #[serde(default)]
    pub slope: [[f64; 2]; 2],
}

/// A point on the board's plane that one projector pixel lights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectedPoint {
    /// Where the camera sees it.
    pub camera_px: [f64; 2],
    /// The projector pixel that was lit there: known, since it was shown on purpose.
    pub projector_px: [f64; 2],
}

impl RigView {
    /// Number of things seen in it.
    pub(crate) fn sights(&self) -> usize {
        self.board.image_points.len() + self.coded.len() + self.projected.len()
    }

    /// A view without a projector.
    pub fn camera_only(board: View) -> Self {
        Self { board, coded: Vec::new(), projected: Vec::new() }
    }
}
