//! The rig file: which devices a rig consists of, where they are, and how far they may go.

mod assemble;
mod camera;
mod check;
mod error;
mod open;
mod source;

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

pub use camera::CameraConfig;
pub use error::RigFileError;
pub use open::{Address, SimulatedDevices};
use source::{Mistake, Source};

use crate::devices::{Coordinate, Degrees, Millimetres, Range, StageAxis};

/// The layout that this version writes and reads.
const VERSION: u32 = 1;

/// A rig, as `rig.toml` describes it. A part that is missing is not there.
///
/// Parts with a `driver` are read by [`RigFile::parse`] alone: it brings them into the form that
/// serde keeps the places of mistakes in.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// Layout of the file.
    pub version: u32,
    /// What takes the pictures.
    pub camera: Option<CameraConfig>,
    /// What shows them.
    #[serde(default)]
    pub projector: ProjectorConfig,
    /// What moves things.
    pub stage: Option<StageConfig>,
    /// Who puts things on the bench.
    #[serde(default)]
    pub hands: HandsConfig,
    /// Where the stage goes for each kind of target; where nothing is said, it stays.
    #[serde(default)]
    pub places: Vec<PlaceConfig>,
}

/// `[hands]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum HandsConfig {
    /// Whoever sits at the terminal is asked.
    Person {},
    /// Those of the simulated rig.
    Simulated {},
    /// A program that is called with the target as JSON and returns 0 when it is in place.
    Program {
        /// Its path.
        program: String,
        /// The longest that it may take, seconds.
        #[serde(default = "hands_limit_s")]
        limit_s: f64,
    },
}

impl Default for HandsConfig {
    fn default() -> Self {
        Self::Person {}
    }
}

/// `[[places]]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceConfig {
    /// Of which targets.
    pub target: PlaceTarget,
    /// Where each axis goes, by name, in the axis's unit. Axes that are not named stay.
    pub at: BTreeMap<String, f64>,
}

/// Targets that belong to one place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlaceTarget {
    /// The block.
    Sample,
    /// Board, sheet and chart in the plane of its front face.
    FrontPlane,
    /// Board and sheet in the plane of its back face.
    BackPlane,
    /// Boards in free poses.
    Held,
    /// Nothing before the camera, or a panel.
    Away,
}

impl PlaceTarget {
    /// Its name, as [`crate::Target::place`] gives it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::FrontPlane => "front-plane",
            Self::BackPlane => "back-plane",
            Self::Held => "held",
            Self::Away => "away",
        }
    }
}

/// Time for somebody to walk over.
fn hands_limit_s() -> f64 {
    600.0
}

/// `[projector]`.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProjectorConfig {
    /// Where its picture comes from.
    pub display: Option<DisplayConfig>,
    /// How it is switched.
    pub control: Option<ControlConfig>,
}

/// `[projector.display]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum DisplayConfig {
    /// The one of the simulated rig.
    Simulated {},
    /// A window on one of this computer's monitors, which the projector is.
    Window {
        /// The monitor's name, as `diaphane rig list` prints it.
        monitor: String,
        /// The X display server, such as `:0`, where it is not the one that this session works at.
        server: Option<String>,
        /// What the projector itself takes from a new picture to its light, milliseconds.
        #[serde(default = "settle_ms")]
        settle_ms: f64,
    },
}

/// `[projector.control]`. `input` is selected once the projector is on; `warm_up_s` is the longest
/// time that it may take.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum ControlConfig {
    /// A projector in software.
    Simulated {
        /// Its input.
        input: Option<String>,
        /// Longest warm-up, seconds.
        #[serde(default = "warm_up_s")]
        warm_up_s: f64,
    },
    /// PJLink class 1 over TCP.
    Pjlink {
        /// Name or address.
        host: String,
        /// TCP port.
        #[serde(default = "pjlink_port")]
        port: u16,
        /// Where the projector wants one.
        password: Option<String>,
        /// Two digits, such as 31.
        input: Option<String>,
        /// Longest warm-up, seconds.
        #[serde(default = "warm_up_s")]
        warm_up_s: f64,
    },
    /// Optoma's serial protocol.
    Optoma {
        /// Serial port.
        port: String,
        /// Its speed.
        #[serde(default = "slow_baud")]
        baud: u32,
        /// Number of the projector, as its menu says; 0 for any.
        #[serde(default)]
        id: u8,
        /// A number, such as 1.
        input: Option<String>,
        /// Longest warm-up, seconds.
        #[serde(default = "warm_up_s")]
        warm_up_s: f64,
    },
    /// Epson's ESC/VP21 over a serial port.
    Epson {
        /// Serial port.
        port: String,
        /// Its speed.
        #[serde(default = "slow_baud")]
        baud: u32,
        /// Two hexadecimal digits, such as 30.
        input: Option<String>,
        /// Longest warm-up, seconds.
        #[serde(default = "warm_up_s")]
        warm_up_s: f64,
    },
    /// BenQ's serial protocol.
    Benq {
        /// Serial port.
        port: String,
        /// Its speed, as the projector's menu says.
        #[serde(default = "fast_baud")]
        baud: u32,
        /// A word, such as hdmi.
        input: Option<String>,
        /// Longest warm-up, seconds.
        #[serde(default = "warm_up_s")]
        warm_up_s: f64,
    },
}

/// `[stage]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum StageConfig {
    /// A stage in software.
    Simulated {
        /// Its axes.
        axes: Vec<AxisConfig>,
    },
    /// GRBL 1.1 over a serial port.
    Grbl {
        /// Serial port.
        port: String,
        /// Its speed.
        #[serde(default = "fast_baud")]
        baud: u32,
        /// Its axes.
        axes: Vec<GrblAxisConfig>,
    },
    /// Zaber's ASCII protocol over a serial port.
    Zaber {
        /// Serial port.
        port: String,
        /// Its speed.
        #[serde(default = "fast_baud")]
        baud: u32,
        /// Its axes.
        axes: Vec<ZaberAxisConfig>,
    },
}

/// The unit of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Millimetres.
    Mm,
    /// Degrees.
    Deg,
}

/// `[[stage.axes]]` of a stage in software.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisConfig {
    /// What it is called.
    pub name: String,
    /// Of all its numbers.
    pub unit: Unit,
    /// From where to where it may go.
    pub range: [f64; 2],
    /// Where it is put in the end.
    pub park: Option<f64>,
}

/// `[[stage.axes]]` of a GRBL controller.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GrblAxisConfig {
    /// What it is called.
    pub name: String,
    /// Of all its numbers. GRBL itself takes degrees for millimetres: its steps a millimetre are
    /// then steps a degree.
    pub unit: Unit,
    /// From where to where it may go, in machine coordinates.
    pub range: [f64; 2],
    /// Where it is put in the end.
    pub park: Option<f64>,
    /// Which axis of the controller it is.
    pub letter: Letter,
}

/// An axis of a GRBL controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum Letter {
    /// The first.
    X,
    /// The second.
    Y,
    /// The third.
    Z,
}

/// `[[stage.axes]]` of a Zaber chain.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZaberAxisConfig {
    /// What it is called.
    pub name: String,
    /// Of all its numbers.
    pub unit: Unit,
    /// From where to where it may go.
    pub range: [f64; 2],
    /// Where it is put in the end.
    pub park: Option<f64>,
    /// Number of the device in the chain, from 1.
    pub device: u8,
    /// Number of the device's axis, from 1.
    #[serde(default = "first_axis")]
    pub axis: u8,
    /// What a microstep moves, mm or degrees; the data sheet has it.
    pub step: f64,
}

/// Lamps take one to two minutes, and up to three attempts.
fn warm_up_s() -> f64 {
    180.0
}

fn settle_ms() -> f64 {
    1e3 * crate::devices::display::SETTLE_S
}

fn pjlink_port() -> u16 {
    crate::devices::pjlink::PORT
}

fn slow_baud() -> u32 {
    crate::devices::epson::BAUD
}

fn fast_baud() -> u32 {
    crate::devices::grbl::BAUD
}

fn first_axis() -> u8 {
    1
}

impl RigFile {
    /// Reads and checks a rig file.
    ///
    /// # Errors
    /// It cannot be read, has a key that is not known, or a value that makes no sense.
    pub fn read(path: &Path) -> Result<Self, RigFileError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| RigFileError::Read { path: path.into(), source })?;
        Self::parse(path, &text)
    }

    /// Like [`read`](Self::read), of a text; `path` is for messages.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn parse(path: &Path, text: &str) -> Result<Self, RigFileError> {
        let syntax = |Mistake { line, key, message }| RigFileError::Syntax {
            path: path.into(),
            line,
            key,
            message,
        };
        let source = Source::parse(text).map_err(syntax)?;
        // The version first: a newer file may well hold keys that mean nothing here.
        let found = source.version().map_err(syntax)?;
        if found > VERSION {
            return Err(RigFileError::Newer { path: path.into(), found });
        }
        let file = source.read().map_err(syntax)?;
        file.check().map_err(|problem| problem.at(path, &source))?;
        Ok(file)
    }
}

impl StageConfig {
    /// Its axes, as stages take them.
    pub fn axes(&self) -> Vec<StageAxis> {
        let axis = |name: &str, unit, range, park| stage_axis(name, unit, range, park);
        match self {
            Self::Simulated { axes } => {
                axes.iter().map(|a| axis(&a.name, a.unit, a.range, a.park)).collect()
            }
            Self::Grbl { axes, .. } => {
                axes.iter().map(|a| axis(&a.name, a.unit, a.range, a.park)).collect()
            }
            Self::Zaber { axes, .. } => {
                axes.iter().map(|a| axis(&a.name, a.unit, a.range, a.park)).collect()
            }
        }
    }
}

fn stage_axis(name: &str, unit: Unit, [from, to]: [f64; 2], park: Option<f64>) -> StageAxis {
    let (range, park) = match unit {
        Unit::Mm => (
            Range::Linear(Millimetres(from), Millimetres(to)),
            park.map(|v| Coordinate::Linear(Millimetres(v))),
        ),
        Unit::Deg => (
            Range::Rotary(Degrees(from), Degrees(to)),
            park.map(|v| Coordinate::Rotary(Degrees(v))),
        ),
    };
    StageAxis { name: name.to_owned(), range, park }
}
