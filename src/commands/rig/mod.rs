//! `diaphane rig`: the devices of a rig, without a session.

mod camera;
mod list;
mod permission;
mod rest;
mod test;
mod twin;

use crate::Failure;
use crate::devices::Simulated;
use crate::output::Done;
use ::rig::RigFileError;
use clap::Subcommand;
use std::path::Path;

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
