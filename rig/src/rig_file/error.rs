//! What is wrong with a rig file, and where in it.

use std::path::{Path, PathBuf};

use super::VERSION;

/// What is wrong with a rig file.
#[derive(Debug, thiserror::Error)]
pub enum RigFileError {
    /// It cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is no TOML, or has a key that is not known or of the wrong type.
    #[error("{}{message}", at(path, *line, key.as_deref()))]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where, counted from 1, as far as it is known.
        line: Option<usize>,
        /// The key, from the root of the file; none where the file is no TOML.
        key: Option<String>,
        /// What, with the keys that there are.
        message: String,
    },
    /// It was written for a later version.
    #[error("{}: layout {found}, this version reads up to {VERSION}", path.display())]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its layout.
        found: u32,
    },
    /// A value makes no sense.
    #[error("{}expected {expected}, found {found}", at(path, *line, Some(key)))]
    Value {
        /// The file.
        path: PathBuf,
        /// Where, counted from 1, if the key is in the file.
        line: Option<usize>,
        /// The key, from the root of the file.
        key: String,
        /// What it may be.
        expected: String,
        /// What it is.
        found: String,
    },
}

/// File, line and key, each with a colon and a space.
fn at(path: &Path, line: Option<usize>, key: Option<&str>) -> String {
    let line = line.map_or(String::new(), |line| format!("line {line}: "));
    let key = key.map_or(String::new(), |key| format!("{key}: "));
    format!("{}: {line}{key}", path.display())
}
