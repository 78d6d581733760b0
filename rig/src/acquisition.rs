//! The standard acquisition: which shots calibrate a rig and capture a sample.

use material::Face;

use crate::{Axis, Chessboard, Pattern, Plan, Purpose, Shot, Target};

/// What a standard acquisition is made of.
///
/// It comes as two plans, since patterns on the face can only be shown once the projector is
/// calibrated.
#[derive(Clone, Debug, PartialEq)]
pub struct Acquisition {
    /// The face that the projector lights.
    pub lit_face: Face,
    /// Columns and rows of regions on the lit face.
    pub regions: [usize; 2],
    /// Exposure times of every frame of the sample, seconds.
    pub bracket_s: Vec<f64>,
    /// Exposure times of the chart and of the white sheet, seconds.
    pub reference_bracket_s: Vec<f64>,
    /// Exposure times of the chart for the camera's response, seconds, in uneven steps.
    pub response_bracket_s: Vec<f64>,
    /// Exposure time of a chessboard, printed or projected, seconds.
    pub board_exposure_s: f64,
    /// Poses of the chessboard.
    pub poses: usize,
    /// The chessboard that the projector shows.
    pub projector_board: Chessboard,
    /// Frames at each exposure.
    pub repeats: u32,
}

/// `count` exposure times from `shortest_s` to `longest_s` seconds in equal steps of stops.
///
/// The standard bracket is `bracket(1.0 / 30.0, 8.0, 9)`, close to one stop a step.
pub fn bracket(shortest_s: f64, longest_s: f64, count: usize) -> Vec<f64> {
    let steps = count.saturating_sub(1).max(1) as f64;
    let exposure = |i| match i {
        // The ends as they were given, without rounding.
        0 => shortest_s,
        i if i + 1 == count => longest_s,
        i => shortest_s * (longest_s / shortest_s).powf(i as f64 / steps),
    };
    (0..count).map(exposure).collect()
}

/// `count` exposure times from `shortest_s` to `longest_s` seconds in uneven steps.
///
/// For recovering a camera's response: where all times are powers of one ratio, a curve with a
/// ripple of that period explains every picture as well as the true one does.
pub fn uneven_bracket(shortest_s: f64, longest_s: f64, count: usize) -> Vec<f64> {
    let steps = count.saturating_sub(1).max(1) as f64;
    let exposure = |i: usize| {
        // A third of a step to either side, by the sine of a square: no period, no order lost.
        let wobble = 0.33 * (2.4 * (i * i) as f64).sin();
        let place = ((i as f64 + wobble) / steps).clamp(0.0, 1.0);
        shortest_s * (longest_s / shortest_s).powf(place)
    };
    (0..count).map(exposure).collect()
}

impl Acquisition {
    /// Boards in every pose, boards in the planes of the faces, the chart, and the white
    /// sheet that defines irradiance 1.
    pub fn calibration_plan(&self) -> Plan {
        let shot = |name: String, purpose, target, pattern| Shot {
            name,
            purpose,
            exposures_s: match purpose {
                Purpose::Geometry => vec![self.board_exposure_s],
                Purpose::Response => self.response_bracket_s.clone(),
                _ => self.reference_bracket_s.clone(),
            },
            repeats: self.repeats,
            target,
            pattern,
        };
        let board = || Pattern::Chessboard(self.projector_board);
        let mut shots = Vec::new();
        for pose in 0..self.poses {
            let number = pose + 1;
            let target = Target::Board { pose };
            shots.push(shot(
                format!("board-{number:02}"),
                Purpose::Geometry,
                target,
                Pattern::White,
            ));
            let target = Target::Sheet { pose };
            shots.push(shot(format!("projected-{number:02}"), Purpose::Geometry, target, board()));
        }
        let planes: &[(Face, &str)] = match self.lit_face {
            Face::Front => &[(Face::Front, "front")],
            Face::Back => &[(Face::Front, "front"), (Face::Back, "back")],
        };
        for &(face, name) in planes {
            let target = Target::FaceBoard { face };
            shots.push(shot(
                format!("face-board-{name}"),
                Purpose::Geometry,
                target,
                Pattern::White,
            ));
        }
        shots.push(shot("response".into(), Purpose::Response, Target::Chart, Pattern::White));
        shots.push(shot("chart".into(), Purpose::Colour, Target::Chart, Pattern::White));
        shots.push(shot("chart-black".into(), Purpose::Colour, Target::Chart, Pattern::Black));
        let sheet = Target::FaceSheet { face: self.lit_face };
        shots.push(shot("sheet-black".into(), Purpose::Reference, sheet, Pattern::Black));
        shots.push(shot("sheet-white".into(), Purpose::Reference, sheet, Pattern::White));
        Plan { shots }
    }

    /// The sample: black, every region, and patterns that are kept out of the fit.
    pub fn capture_plan(&self) -> Plan {
        let [columns, rows] = self.regions;
        let shot = |name: String, purpose, pattern| Shot {
            name,
            purpose,
            exposures_s: self.bracket_s.clone(),
            repeats: self.repeats,
            target: Target::Sample,
            pattern,
        };
        let mut shots = vec![shot("black".into(), Purpose::Reference, Pattern::Black)];
        for index in 0..columns * rows {
            let name = format!("region-{:02}", index + 1);
            shots.push(shot(name, Purpose::Fit, Pattern::region(columns, rows, index)));
        }
        // One region in the middle, moved by half of one, meets cells that no region lights alone.
        let middle = rows.saturating_sub(1) / 2 * columns + columns.saturating_sub(1) / 2;
        let held_out = [
            ("held-full", Pattern::full_face()),
            ("held-stripes-x", Pattern::stripes(3, Axis::X)),
            ("held-stripes-y", Pattern::stripes(3, Axis::Y)),
            ("held-shifted", Pattern::shifted_region(columns, rows, middle, [0.5, 0.5])),
            ("held-checker", Pattern::checker(columns + 1, rows + 1)),
        ];
        let held_out = held_out.map(|(name, pattern)| shot(name.into(), Purpose::HeldOut, pattern));
        shots.extend(held_out);
        Plan { shots }
    }
}
