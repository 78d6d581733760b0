//! What can go wrong between a picture and a calibrated quantity.

use std::path::PathBuf;

use crate::detection::missing::NoBoard;

/// Result of everything in this crate.
pub type Result<T> = std::result::Result<T, CalibrationError>;

/// What was expected, what was found, and in which file or picture.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// A file or folder could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file exists but is not what its kind promises (truncated, corrupt, another format).
    #[error("{path}: expected {expected}, found {found}")]
    BadFile {
        /// The file.
        path: PathBuf,
        /// What it should have held.
        expected: String,
        /// What it holds.
        found: String,
    },
    /// A folder without a single picture.
    #[error("{path}: expected pictures (png, jpg, tif, dng, cr2, cr3, nef, arw), found none")]
    NoPictures {
        /// The folder.
        path: PathBuf,
    },
    /// A file's exposure time is nowhere to be found.
    #[error("{path}: no exposure time in its EXIF data ({reason})")]
    NoExposure {
        /// The picture.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A description such as "9x6" that cannot be read.
    #[error("{what}: expected {expected}, found {found:?}")]
    BadInput {
        /// What was being described.
        what: String,
        /// The form it should have.
        expected: String,
        /// What was given.
        found: String,
    },
    /// The board is not in the picture, or not well enough.
    #[error("{picture}: no {board} found: {reason}")]
    BoardNotFound {
        /// The picture's name.
        picture: String,
        /// Which board.
        board: String,
        /// The likeliest cause.
        reason: NoBoard,
    },
    /// Too few views for a calibration.
    #[error("{what} needs at least {needed} views, found {found}")]
    TooFewViews {
        /// Which calibration.
        what: &'static str,
        /// How many it takes.
        needed: usize,
        /// How many there are.
        found: usize,
    },
    /// A picture that does not go with the others.
    #[error("{picture}: expected {expected}, found {found}")]
    Mismatch {
        /// The odd one out.
        picture: String,
        /// What the others are.
        expected: String,
        /// What this one is.
        found: String,
    },
    /// A picture that is not what the code sequence has in its place.
    #[error("{picture}: not as the code sequence has it: {reason}")]
    CodeSequence {
        /// The picture's name.
        picture: String,
        /// What it looks like.
        reason: String,
    },
    /// A bracket that cannot say anything about the response or the radiance.
    #[error("exposure bracket: expected {expected}, found {found}")]
    BadBracket {
        /// What it takes.
        expected: &'static str,
        /// What was given.
        found: String,
    },
    /// A colour chart that is absent, half hidden or upside down.
    #[error("{picture}: no usable ColorChecker: {reason}")]
    ChartNotFound {
        /// The picture's name.
        picture: String,
        /// Why it was refused.
        reason: String,
    },
    /// Observations that leave something open, however many there are.
    #[error("{what}: {reason}")]
    Degenerate {
        /// What was being solved.
        what: &'static str,
        /// What they have in common.
        reason: String,
    },
    /// A distortion that maps two rays to one pixel.
    #[error("{what}: distortion {distortion} folds the picture onto itself at pixel ({:.0}, {:.0})", pixel[0], pixel[1])]
    Folded {
        /// What was being solved.
        what: &'static str,
        /// The distortion's name.
        distortion: &'static str,
        /// Where the picture's rim has no ray, or more than one.
        pixel: [f64; 2],
    },
    /// A solver did not arrive.
    #[error("{what} did not converge: {reason}")]
    NotConverged {
        /// What was being solved.
        what: &'static str,
        /// What happened.
        reason: String,
    },
    /// A file could not be written.
    #[error(transparent)]
    File(#[from] material::FileError),
    /// OpenCV refused.
    #[error("{doing} failed: {message}")]
    OpenCv {
        /// What it was asked to do.
        doing: &'static str,
        /// Its own words, without its file and line.
        message: String,
    },
}

impl From<raw::RawError> for CalibrationError {
    fn from(error: raw::RawError) -> Self {
        use raw::RawError as R;
        match error {
            R::Io { path, source } => Self::Io { path, source },
            R::BadFile { path, expected, found } => {
                Self::BadFile { path, expected: expected.into(), found }
            }
            R::BadPattern { found } => Self::BadInput {
                what: "Bayer pattern".into(),
                expected: "rggb, bggr, grbg or gbrg".into(),
                found,
            },
        }
    }
}

impl CalibrationError {
    pub(crate) fn io(path: &std::path::Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io { path, source }
    }

    pub(crate) fn opencv(doing: &'static str) -> impl Fn(opencv::Error) -> Self {
        // "OpenCV(4.6.0) /its/own/file.cpp:1: error: (-215:Assertion failed) what in function 'which'".
        move |error| {
            let message = error.message.trim();
            let told = message.split_once("error: ").map_or(message, |(_, told)| told);
            let told =
                told.split_once(") ").filter(|_| told.starts_with('(')).map_or(told, |t| t.1);
            let message = told.lines().next().unwrap_or_default().trim().to_owned();
            Self::OpenCv { doing, message }
        }
    }
}
