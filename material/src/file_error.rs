//! What can be wrong with a file of any of the formats.

use std::io;
use std::path::PathBuf;

use crate::MaterialError;

/// A file that could not be read or written; every variant names it.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done: read, write, ...
        action: &'static str,
        /// The system's own words.
        source: io::Error,
    },
    /// There is a file already and it was not asked to be replaced.
    #[error("{}: is there already and is not overwritten", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Something else than the format that was asked for.
    #[error("{}: expected {expected}, found {found}", path.display())]
    OtherFormat {
        /// The file.
        path: PathBuf,
        /// The format that was expected.
        expected: &'static str,
        /// What is there instead.
        found: String,
    },
    /// A later version of the format.
    #[error(
        "{}: written by a newer version of Diaphane: format {found}, this version reads up to {supported}",
        path.display()
    )]
    NewerVersion {
        /// The file.
        path: PathBuf,
        /// Version that the file states.
        found: u32,
        /// Latest version that can be read.
        supported: u32,
    },
    /// The file ends too early, or something was appended to it.
    #[error("{}: expected {expected} bytes, found {found}: incomplete or damaged", path.display())]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// Bytes that its header asks for.
        expected: u64,
        /// Bytes that are there.
        found: u64,
    },
    /// The content does not match the hash that was written with it.
    #[error(
        "{}: damaged: its content hashes to {found}, expected {expected}",
        path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Hash in the file.
        expected: String,
        /// Hash of the content.
        found: String,
    },
    /// A header, archive or entry that makes no sense.
    #[error("{}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        reason: String,
    },
    /// An array that is not in the archive.
    #[error("{}: expected an array named {name:?}, found {}", path.display(), list(available))]
    MissingArray {
        /// The file.
        path: PathBuf,
        /// The array that was asked for.
        name: String,
        /// The arrays that are there.
        available: Vec<String>,
    },
    /// An array of the wrong shape.
    #[error("{}: array {name:?}: expected shape {expected}, found {found:?}", path.display())]
    WrongShape {
        /// The file.
        path: PathBuf,
        /// The array.
        name: String,
        /// The shape that was expected, in words or numbers.
        expected: String,
        /// The shape that is there.
        found: Vec<usize>,
    },
    /// The format has no place for what was to be written.
    #[error("{}: not written: {reason}", path.display())]
    CannotHold {
        /// The file or folder.
        path: PathBuf,
        /// What the format holds and what it was given.
        reason: String,
    },
    /// The material has voxels that no scattering medium has, and they were to be refused.
    #[error(
        "{}: not written: {count} of {of} voxel values have 3κμ > 1, which needs negative scattering",
        path.display()
    )]
    Impossible {
        /// The file or folder.
        path: PathBuf,
        /// Voxels times channels with 3κμ > 1.
        count: usize,
        /// Voxels times channels.
        of: usize,
    },
    /// Well-formed, but not a material.
    #[error("{}: {source}", path.display())]
    NotAMaterial {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: MaterialError,
    },
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "no arrays at all".into() } else { names.join(", ") }
}

impl FileError {
    pub(crate) fn malformed(path: &std::path::Path, reason: impl Into<String>) -> Self {
        FileError::Malformed { path: path.into(), reason: reason.into() }
    }

    pub(crate) fn reading(path: &std::path::Path) -> impl Fn(io::Error) -> Self {
        move |source| FileError::Io { path: path.into(), action: "read", source }
    }
}
