//! What can be wrong with a camera raw file.

use std::path::PathBuf;

/// Why there is no mosaic.
#[derive(Debug, thiserror::Error)]
pub enum RawError {
    /// The file could not be read.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not what its kind promises (truncated, corrupt, another format, another filter),
    /// or the decoders were left out when the program was built.
    #[error("{path}: expected {expected}, found {found}")]
    BadFile {
        /// The file.
        path: PathBuf,
        /// What it should have held.
        expected: &'static str,
        /// What it holds.
        found: String,
    },
    /// An order of colours that there is not.
    #[error("Bayer pattern: expected rggb, bggr, grbg or gbrg, found {found:?}")]
    BadPattern {
        /// What was given.
        found: String,
    },
}
