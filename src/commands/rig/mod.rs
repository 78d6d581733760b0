//! `diaphane rig`: the devices of a rig, without a session.

mod advice;
mod camera;
mod list;
mod rest;
mod rules;
mod test;
mod twin;

use crate::Failure;
use crate::devices::{RIG_FILE, Simulated};
use crate::output::Done;
use crate::session::{RigConfig, Session};
use ::rig::{RigFile, RigFileError};
use clap::Subcommand;
use std::path::{Path, PathBuf};

pub(crate) use camera::how_to_get;

#[derive(Subcommand)]
pub(crate) enum Args {
    /// What is connected, and what is in the way
    List(list::Args),
    /// Try each device for a moment
    Test(test::Args),
    /// Put everything away: the stage to its parking places, the projector off
    Park(rest::Park),
    /// Stop the stage at once, wherever it is
    Halt(rest::Halt),
    /// A whole rig without hardware, to try the drivers for hardware on
    Twin(twin::Args),
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    match args {
        Args::List(args) => list::run(args),
        Args::Test(args) => test::run(args),
        Args::Park(args) => rest::park(args),
        Args::Halt(args) => rest::halt(args),
        Args::Twin(args) => twin::run(args),
    }
}

/// The rig file that is meant: the file itself, or that of a session.
fn read(path: &Path) -> Result<RigFile, Failure> {
    Ok(RigFile::read(&file_of(path)?)?)
}

fn file_of(path: &Path) -> Result<PathBuf, Failure> {
    if !path.is_dir() {
        return Ok(path.into());
    }
    let file = path.join(RIG_FILE);
    if file.is_file() {
        return Ok(file);
    }
    let folder = path.display();
    if !path.join("session.toml").is_file() {
        let error = format!("{folder}: expected a rig file, or a folder with a {RIG_FILE}");
        return Err(Failure::input(error).hint("docs/devices.md has examples of rig files"));
    }
    Err(match Session::open(path)?.config.rig {
        RigConfig::Simulated { .. } => Failure::input(format!(
            "{folder}: the rig of this session is simulated: it has no devices and no rig file"
        ))
        .hint(format!("nothing has to be connected; what comes next: diaphane status {folder}")),
        RigConfig::Imported => Failure::input(format!(
            "{folder}: the pictures of this session were imported: it has no devices and no rig file"
        )),
        RigConfig::Devices { .. } => Failure::input(format!("{}: not found", file.display()))
            .hint("put the rig file back that the session was made with"),
    })
}

/// A rig file without what a command is about.
fn nothing(path: &Path, what: &str) -> Failure {
    Failure::input(format!("{}: there is {what}", path.display()))
        .hint("docs/devices.md has examples")
}

impl From<RigFileError> for Failure {
    fn from(error: RigFileError) -> Self {
        let hint = match &error {
            RigFileError::Read { .. } => "write one; docs/devices.md has examples",
            RigFileError::Newer { .. } => "update Diaphane",
            RigFileError::Syntax { .. } | RigFileError::Value { .. } => {
                "docs/devices.md has all keys"
            }
        };
        Self::input(error).hint(hint)
    }
}
