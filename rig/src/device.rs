//! What a rig consists of, as traits that hardware and the simulator both implement.

use std::collections::BTreeMap;

use material::Face;
use serde::{Deserialize, Serialize};

use crate::{Frame, HeldBoard, ProjectorImage};

/// A whole rig.
pub struct Rig {
    /// Looks at the front face.
    pub camera: Box<dyn Camera>,
    /// Lights the lit face.
    pub projector: Box<dyn Projector>,
    /// Puts things where they belong.
    pub bench: Box<dyn Bench>,
}

/// Takes pictures.
pub trait Camera: Send {
    /// What the camera is.
    fn info(&self) -> CameraInfo;

    /// Tells which frame of its plan comes next, counted from 0, and which repeat of the same
    /// photograph it is. A simulated camera lives by it, so that what changes with time does
    /// so alike when a capture is taken up again; others need not care.
    fn announce(&mut self, _number: usize, _repeat: u32) {}

    /// Exposes for `exposure_s` seconds and returns the frame with the exposure time that
    /// was really used, where the device tells.
    ///
    /// # Errors
    /// The device does not answer, is gone, or cannot do that exposure.
    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError>;

    /// What the camera says of itself after an exposure.
    ///
    /// # Errors
    /// The device does not answer or is gone.
    fn readback(&mut self) -> Result<Readback, DeviceError> {
        Ok(Readback::default())
    }
}

/// What a device says of itself; it goes into the journal with every frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Readback {
    /// Of the sensor or, where there is no such thermometer, of the housing, °C.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Settings by the device's own names, in its own words: `Gain` → `0 dB`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub settings: BTreeMap<String, String>,
}

/// What a camera delivers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// Maker and model, or whatever tells it from others.
    pub name: String,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Values a pixel: 1 (grey) or 3 (R, G, B).
    pub channels: u8,
    /// Bits a value, 8 to 16: the largest value is 2^bit_depth − 1.
    pub bit_depth: u8,
}

/// Shows pictures.
pub trait Projector: Send {
    /// What the projector is.
    fn info(&self) -> ProjectorInfo;

    /// Shows an image of the projector's own size and returns once the light is there.
    ///
    /// # Errors
    /// The device does not answer or is gone, or the image has another size.
    fn show(&mut self, image: &ProjectorImage) -> Result<(), DeviceError>;

    /// Whether what was shown is still on the wall: a projector may have fallen asleep, or its
    /// window may be gone, without anybody having asked it for anything.
    ///
    /// # Errors
    /// It is not, or the device does not answer.
    fn still_shows(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }

    /// Goes dark and is put away; nothing is shown any more.
    ///
    /// # Errors
    /// The device does not answer or is gone.
    fn park(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// What a projector takes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProjectorInfo {
    /// Maker and model, or whatever tells it from others.
    pub name: String,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// Whoever puts a thing in front of the camera: a technician who is asked to, or the
/// simulator.
pub trait Bench: Send {
    /// Puts `target`, and nothing else, on the rig and returns once it is there.
    ///
    /// # Errors
    /// It could not be done, or somebody declined.
    fn place(&mut self, target: &Target) -> Result<(), DeviceError>;

    /// Puts whatever moves to where it rests.
    ///
    /// # Errors
    /// The device does not answer, is gone, or has stopped itself.
    fn park(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
}

/// A thing that a picture is taken of.
///
/// Sheets and boards are thin enough to be seen from both sides when they are lit from
/// either, so that back-lit rigs can use them as well as front-lit ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Target {
    /// The block that is acquired, in its place.
    Sample,
    /// The printed chessboard, held up in the pose of that number.
    Board {
        /// Which pose, counted from 0; a technician chooses freely but differently each time.
        pose: usize,
    },
    /// A blank white sheet over the printed chessboard, which has not moved since
    /// [`Target::Board`] of the same number.
    Sheet {
        /// The pose of the board under it.
        pose: usize,
    },
    /// The printed chessboard lying in the plane of a face of the sample, instead of the
    /// sample: its pattern is centred on the face, its rows along x.
    FaceBoard {
        /// Which face's plane.
        face: Face,
    },
    /// A white Lambertian sheet lying in the plane of a face, instead of the sample: lit by
    /// projector white, it defines irradiance 1.
    FaceSheet {
        /// Which face's plane.
        face: Face,
    },
    /// The colour chart in the plane of the front face, instead of the sample.
    Chart,
    /// Nothing: the lens is capped, so that no light reaches the sensor.
    Dark,
    /// Something evenly bright that fills the camera's whole picture: a light panel, or opal
    /// glass before the lens.
    Flat,
}

impl Target {
    /// The kind of place that it is put to, by the name that a rig file has for it.
    pub fn place(&self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::FaceBoard { face: Face::Front }
            | Self::FaceSheet { face: Face::Front }
            | Self::Chart => "front-plane",
            Self::FaceBoard { face: Face::Back } | Self::FaceSheet { face: Face::Back } => {
                "back-plane"
            }
            Self::Board { .. } | Self::Sheet { .. } => "held",
            Self::Dark | Self::Flat => "away",
        }
    }
}

impl std::fmt::Display for Target {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let plane = |face: &Face| match face {
            Face::Front => "front",
            Face::Back => "back",
        };
        match self {
            Target::Sample => write!(f, "the sample"),
            Target::Board { pose } => {
                write!(f, "the chessboard, pose {}: {}", pose + 1, HeldBoard::pose(*pose))
            }
            Target::Sheet { pose } => {
                write!(f, "a white sheet over the chessboard, still in pose {}", pose + 1)
            }
            Target::FaceBoard { face } => {
                write!(f, "the chessboard in the plane of the sample's {} face", plane(face))
            }
            Target::FaceSheet { face } => {
                write!(f, "the white sheet in the plane of the sample's {} face", plane(face))
            }
            Target::Chart => write!(f, "the colour chart in the plane of the sample's front face"),
            Target::Dark => write!(f, "the cap on the lens"),
            Target::Flat => write!(f, "a light panel or opal glass before the lens"),
        }
    }
}

/// What a device did wrong. Each names the device; [`DeviceError::kind`] is what code that
/// knows no device can act on.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// It is not there.
    #[error("{device}: not found")]
    NotFound {
        /// The device.
        device: String,
    },
    /// Nothing that is there is called that.
    #[error("{device}: not found; {}", there_is(there))]
    NoneSuch {
        /// What was looked for.
        device: String,
        /// What is there instead.
        there: Vec<String>,
    },
    /// More than one thing is called that.
    #[error("{device}: {} are called that: {}", matching.len(), matching.join("; "))]
    Ambiguous {
        /// What was looked for.
        device: String,
        /// All that it may be.
        matching: Vec<String>,
    },
    /// It is there, but this user may not open it.
    #[error("{device}: no permission to open {path}")]
    NoPermission {
        /// The device.
        device: String,
        /// What could not be opened.
        path: String,
    },
    /// This program was built without the part that speaks to it.
    #[error("{device}: this program was built without the driver \"{driver}\"")]
    MissingDriver {
        /// The device.
        device: String,
        /// The driver, which is also the name of the Cargo feature.
        driver: &'static str,
    },
    /// Somebody else has it, or it has not finished.
    #[error("{device}: busy")]
    Busy {
        /// The device.
        device: String,
    },
    /// It was there and is gone.
    #[error("{device}: disconnected")]
    Disconnected {
        /// The device.
        device: String,
    },
    /// It did not answer in time.
    #[error("{device}: no answer within {waited_s} s")]
    Timeout {
        /// The device.
        device: String,
        /// How long it was given, seconds.
        waited_s: f64,
    },
    /// It answered something that its protocol does not know.
    #[error("{device}: expected {expected}, received \"{}\"", bytes.escape_ascii())]
    Protocol {
        /// The device.
        device: String,
        /// What the protocol asks for.
        expected: String,
        /// What came instead.
        bytes: Vec<u8>,
    },
    /// A picture came that cannot be one of this camera's.
    #[error("{device}: expected {expected}, received {found}")]
    BadFrame {
        /// The camera.
        device: String,
        /// Size, channels and bits that it has.
        expected: String,
        /// What came instead.
        found: String,
    },
    /// It cannot do what was asked.
    #[error("{device}: {reason}")]
    Unsupported {
        /// The device.
        device: String,
        /// What it can do and what was asked.
        reason: String,
    },
    /// It stopped itself, or says that it is broken; a person has to look at it.
    #[error("{device}: {reason}")]
    Fault {
        /// The device.
        device: String,
        /// What it reports.
        reason: String,
    },
    /// It does not know where it is, as after every start of a stage with switches.
    #[error("{device}: it does not know where it is until it is homed")]
    NotHomed {
        /// The device.
        device: String,
    },
    /// Somebody said no.
    #[error("{device}: declined: {reason}")]
    Declined {
        /// The device, or the person.
        device: String,
        /// Why.
        reason: String,
    },
}

fn there_is(there: &[String]) -> String {
    match there {
        [] => "there is none".into(),
        there => format!("there is {}", there.join("; ")),
    }
}

/// What a [`DeviceError`] amounts to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DeviceErrorKind {
    /// Not there.
    NotFound,
    /// Not clear which.
    Ambiguous,
    /// Not allowed.
    NoPermission,
    /// Not in this build.
    MissingDriver,
    /// Not now.
    Busy,
    /// Not any more.
    Disconnected,
    /// Not in time.
    Timeout,
    /// Not understood.
    Protocol,
    /// Not possible.
    Unsupported,
    /// Not before somebody has looked at it.
    Fault,
    /// Not before it is homed.
    NotHomed,
    /// Not wanted.
    Declined,
}

impl DeviceErrorKind {
    /// Whether the same request may well succeed a moment later.
    pub fn is_transient(self) -> bool {
        matches!(self, Self::Busy | Self::Timeout | Self::Protocol)
    }

    /// Whether a device that was there is not: a plug that somebody may push back in.
    pub fn is_gone(self) -> bool {
        matches!(self, Self::Disconnected | Self::NotFound)
    }
}

impl DeviceError {
    /// What the error amounts to.
    pub fn kind(&self) -> DeviceErrorKind {
        match self {
            Self::NotFound { .. } | Self::NoneSuch { .. } => DeviceErrorKind::NotFound,
            Self::Ambiguous { .. } => DeviceErrorKind::Ambiguous,
            Self::NoPermission { .. } => DeviceErrorKind::NoPermission,
            Self::MissingDriver { .. } => DeviceErrorKind::MissingDriver,
            Self::Busy { .. } => DeviceErrorKind::Busy,
            Self::Disconnected { .. } => DeviceErrorKind::Disconnected,
            Self::Timeout { .. } => DeviceErrorKind::Timeout,
            Self::Protocol { .. } | Self::BadFrame { .. } => DeviceErrorKind::Protocol,
            Self::Unsupported { .. } => DeviceErrorKind::Unsupported,
            Self::Fault { .. } => DeviceErrorKind::Fault,
            Self::NotHomed { .. } => DeviceErrorKind::NotHomed,
            Self::Declined { .. } => DeviceErrorKind::Declined,
        }
    }
}
