//! Where a result came from, in enough detail to derive it again.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::FileError;

/// The software, inputs and settings behind a result.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// Name of the software that made it.
    pub software: String,
    /// Version of that software.
    pub version: String,
    /// When the first of its pictures was taken, seconds since 1970-01-01 UTC; 0 where nobody noted it. (Not
    /// when it was computed: the same pictures and settings make the same bytes.)
    #[serde(default, alias = "created_unix_s")]
    pub captured_unix_s: u64,
    /// Seed of every random number used, where there were any.
    pub seed: Option<u64>,
    /// The files it was made from.
    pub inputs: Vec<Input>,
    /// Everything that could be set, by name, in words.
    pub settings: BTreeMap<String, String>,
}

/// One file that a result was made from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// Its name as seen from the session.
    pub name: String,
    /// BLAKE3 of its content, 64 hexadecimal digits.
    pub blake3: String,
}

impl Input {
    /// The input `name`, hashed from the file at `path`.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn from_file(name: impl Into<String>, path: &Path) -> Result<Self, FileError> {
        Ok(Self { name: name.into(), blake3: hash_file(path)? })
    }
}

/// BLAKE3 of a file's content as 64 lower-case hexadecimal digits.
///
/// # Errors
/// The file cannot be read.
pub fn hash_file(path: &Path) -> Result<String, FileError> {
    let mut hasher = blake3::Hasher::new();
    File::open(path)
        .and_then(|file| hasher.update_reader(file).map(|_| ()))
        .map_err(FileError::reading(path))?;
    Ok(hasher.finalize().to_hex().to_string())
}
