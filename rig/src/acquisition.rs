//! The standard acquisition: which shots calibrate a rig and capture a sample.

use material::Face;

use serde::{Deserialize, Serialize};

use crate::{
    Axis, Chessboard, CodeSequence, Pattern, PhaseShift, Plan, Purpose, SMatrix, Shot, Target,
};

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
    /// How the regions are lit.
    pub scheme: SampleScheme,
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
    /// What the projector shows to be found by.
    pub projector_method: ProjectorMethod,
    /// Columns and rows of the projector.
    pub projector_px: [u32; 2],
    /// Levels of the ramp that the projector's response is found by.
    pub ramp_levels: usize,
    /// Frames at each exposure.
    pub repeats: u32,
}

/// How the regions of the lit face follow each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SampleScheme {
    /// One at a time.
    #[default]
    Regions,
    /// About half of all at a time, by the rows of an [`SMatrix`].
    Multiplexed,
}

/// What the projector shows on a sheet over the printed board, to be calibrated by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProjectorMethod {
    /// A chessboard: one picture a pose, some dozens of points.
    #[default]
    Chessboard,
    /// Gray code of all columns and rows: some 40 pictures a pose, every corner of the printed
    /// board.
    GrayCode,
    /// A coarser Gray code and sinusoids: some 30 to 40 pictures a pose.
    PhaseShift(PhaseShift),
}

impl ProjectorMethod {
    /// The code that is shown; `None` for a chessboard.
    pub fn code(self, projector: [u32; 2]) -> Option<CodeSequence> {
        match self {
            Self::Chessboard => None,
            Self::GrayCode => Some(CodeSequence { projector, phase: None }),
            Self::PhaseShift(phase) => Some(CodeSequence { projector, phase: Some(phase) }),
        }
    }
}

/// Exposures of the burst that shows a colour wheel: shortest, longest and number, from far less
/// than a turn to several, in uneven steps.
const BURST: (f64, f64, usize) = (1.0 / 1000.0, 1.0 / 25.0, 32);
/// Frames at each exposure of the burst: each catches another phase of the wheel.
const BURST_REPEATS: u32 = 4;
/// Frames at each exposure from which the camera's noise is measured: pairs, whose difference
/// holds nothing but noise.
const NOISE_REPEATS: u32 = 2;

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

/// Exposures of the burst, seconds, in steps that no wheel keeps pace with.
pub fn burst() -> Vec<f64> {
    let (shortest, longest, count) = BURST;
    let last = count.saturating_sub(1).max(1) as f64;
    let place = |i: usize| (i as f64 + 0.33 * (2.4 * (i * i) as f64).sin()).clamp(0.0, last);
    (0..count).map(|i| shortest + (longest - shortest) * place(i) / last).collect()
}

/// Names of the shots of [`Acquisition::light_plan`] beside the ramp: dark frames, the burst, and
/// white once more.
pub const DARK_SHOT: &str = "light-dark";
/// See [`DARK_SHOT`].
pub const BURST_SHOT: &str = "light-burst";
/// See [`DARK_SHOT`].
pub const WHITE_AGAIN_SHOT: &str = "light-white-again";

/// Name of the first shot of [`Acquisition::capture_plan`]: no light but the room's.
pub const BLACK_SHOT: &str = "black";

/// Name of the shot of [`Acquisition::capture_plan`] that lights the whole face. From behind it
/// checks the fit. From the front every cell that the camera sees is lit directly, which says
/// nothing of multiple scattering and all of the surface; it is called as it ever was, so that
/// frames of earlier sessions serve.
pub const FULL_FACE_SHOT: &str = "held-full";

/// Names of the shots of [`Acquisition::noise_plan`]: pairs of dark and of evenly lit frames.
pub const NOISE_DARK_SHOT: &str = "noise-dark";
/// See [`NOISE_DARK_SHOT`].
pub const NOISE_FLAT_SHOT: &str = "noise-flat";

/// Name of the ramp's shot at a level.
pub fn grey_shot(level: f64) -> String {
    format!("light-grey-{:03}", (255.0 * level).round())
}

/// Name of picture `index` of the code on the sheet over the board in a pose.
pub fn code_shot(pose: usize, index: usize) -> String {
    format!("code-{:02}-{index:02}", pose + 1)
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
            match self.projector_method.code(self.projector_px) {
                None => shots.push(shot(
                    format!("projected-{number:02}"),
                    Purpose::Geometry,
                    target,
                    board(),
                )),
                Some(code) => {
                    shots.extend(code.patterns().into_iter().enumerate().map(|(i, pattern)| {
                        shot(code_shot(pose, i), Purpose::Geometry, target, pattern)
                    }))
                }
            }
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

    /// What the projector's light is: a ramp of grey levels on the white sheet, and a burst of
    /// short exposures that shows its colour wheel; white once more, which tells a drift of the
    /// lamp; and dark frames of the same exposures.
    pub fn light_plan(&self) -> Plan {
        let target = Target::FaceSheet { face: self.lit_face };
        let shot = |name: String, exposures_s: Vec<f64>, repeats, target, pattern| Shot {
            name,
            purpose: if repeats > 1 { Purpose::Wheel } else { Purpose::Light },
            exposures_s,
            repeats,
            target,
            pattern,
        };
        let exposures = self.ramp_exposures_s();
        let dark = shot(DARK_SHOT.into(), exposures.clone(), 1, Target::Dark, Pattern::Black);
        let mut shots = vec![dark];
        for level in self.ramp() {
            shots.push(shot(
                grey_shot(level),
                exposures.clone(),
                1,
                target,
                Pattern::Grey { level },
            ));
        }
        shots.push(shot(BURST_SHOT.into(), burst(), BURST_REPEATS, target, Pattern::White));
        let again = Pattern::Grey { level: 1.0 };
        shots.push(shot(WHITE_AGAIN_SHOT.into(), exposures.clone(), 1, target, again));
        Plan { shots }
    }

    /// Levels of the ramp, 0 to 1, each one that an 8-bit projector has.
    pub fn ramp(&self) -> Vec<f64> {
        let steps = self.ramp_levels.saturating_sub(1).max(1) as f64;
        let level = |i: usize| (255.0 * i as f64 / steps).round() / 255.0;
        let mut levels: Vec<f64> = (0..self.ramp_levels).map(level).collect();
        levels.dedup();
        levels
    }

    /// Exposures of the ramp: white must fit into the shortest, and the longest lifts the
    /// projector's black out of the noise.
    pub fn ramp_exposures_s(&self) -> Vec<f64> {
        let mut out: Vec<f64> = [self.reference_bracket_s.first(), self.reference_bracket_s.last()]
            .into_iter()
            .flatten()
            .copied()
            .collect();
        out.dedup();
        out
    }

    /// What the camera's noise is measured from: pairs of dark frames and of an evenly bright
    /// panel, at the exposures of the sample.
    pub fn noise_plan(&self) -> Plan {
        let shot = |name: &str, target, exposures_s: &[f64]| Shot {
            name: name.into(),
            purpose: Purpose::Noise,
            exposures_s: exposures_s.to_vec(),
            repeats: NOISE_REPEATS,
            target,
            pattern: Pattern::Black,
        };
        Plan {
            shots: vec![
                shot(NOISE_DARK_SHOT, Target::Dark, &self.bracket_s),
                shot(NOISE_FLAT_SHOT, Target::Flat, &self.response_bracket_s),
            ],
        }
    }

    /// The sample: black, every region or mixture of regions, patterns that are kept out of the
    /// fit, and among these the whole face, which from the front is for the surface instead.
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
        let mut shots = vec![shot(BLACK_SHOT.into(), Purpose::Reference, Pattern::Black)];
        match self.scheme {
            SampleScheme::Regions => shots.extend((0..columns * rows).map(|index| {
                let name = format!("region-{:02}", index + 1);
                shot(name, Purpose::Fit, Pattern::region(columns, rows, index))
            })),
            SampleScheme::Multiplexed => {
                let matrix = SMatrix::for_regions(columns * rows);
                shots.extend((0..matrix.order()).map(|row| {
                    let pattern = Pattern::regions(columns, rows, |j| matrix.lights(row, j));
                    shot(format!("multiplexed-{:02}", row + 1), Purpose::Fit, pattern)
                }));
            }
        }
        // One region in the middle, moved by half of one, meets cells that no region lights alone.
        let middle = rows.saturating_sub(1) / 2 * columns + columns.saturating_sub(1) / 2;
        let held_out = [
            (FULL_FACE_SHOT, Pattern::full_face()),
            ("held-stripes-x", Pattern::stripes(3, Axis::X)),
            ("held-stripes-y", Pattern::stripes(3, Axis::Y)),
            ("held-shifted", Pattern::shifted_region(columns, rows, middle, [0.5, 0.5])),
            ("held-checker", Pattern::checker(columns + 1, rows + 1)),
        ];
        let purpose = |name| match self.lit_face {
            Face::Front if name == FULL_FACE_SHOT => Purpose::Surface,
            Face::Front | Face::Back => Purpose::HeldOut,
        };
        let held_out = held_out.map(|(name, pattern)| shot(name.into(), purpose(name), pattern));
        shots.extend(held_out);
        Plan { shots }
    }
}
