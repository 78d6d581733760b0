//! Why a run fails.

use material::FileError;

use crate::{DeviceError, FrameError, JournalError, PlanError};

/// Why a run failed. Everything taken so far is kept, and the run can be repeated.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The plan makes no sense.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The journal cannot be used.
    #[error(transparent)]
    Journal(#[from] JournalError),
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
    /// The camera delivered something impossible, or it could not be written.
    #[error("shot {shot:?}: {source}")]
    Frame {
        /// The shot.
        shot: String,
        /// What is wrong with the frame.
        source: FrameError,
    },
    /// A device failed for good.
    #[error("shot {shot:?}: {source}")]
    Device {
        /// The shot.
        shot: String,
        /// What the device did.
        source: DeviceError,
    },
    /// The disk is full but for a reserve, and nobody made room.
    #[error(
        "shot {shot:?}: {:.1} MB are free on the disk, the next frames need {:.1} MB",
        *free as f64 / 1e6,
        *needed as f64 / 1e6
    )]
    NoSpace {
        /// The shot.
        shot: String,
        /// Bytes that the disk still takes.
        free: u64,
        /// Bytes that are needed.
        needed: u64,
    },
    /// A pattern on the face, but nobody knows where the face is.
    #[error("shot {0:?}: its pattern lies on the lit face, which needs a calibrated projector")]
    NoFaceMap(String),
    /// The session holds frames of that name taken under other settings.
    #[error(
        "shot {shot:?}: {file} was taken with another target, pattern or exposure time than the plan has now"
    )]
    OtherSettings {
        /// The shot.
        shot: String,
        /// The frame, relative to the session.
        file: String,
    },
}
