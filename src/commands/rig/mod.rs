//! `diaphane rig`: the devices of a rig, without a session.

mod list;
mod permission;
mod rest;
mod test;

use crate::Failure;
use crate::output::Done;
use ::rig::devices::{ProjectorControl, Stage, StageAxis};
use ::rig::{Camera, DeviceError, Projector, Rig, RigFileError, SimulatedDevices};
use clap::Subcommand;
use material::Face;
use simulator::devices::{ProjectorSpec, SimulatedProjector, SimulatedStage};
use simulator::{SampleKind, SampleSpec, SimulatedRig};
use std::path::Path;

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
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    match args {
        Args::List(args) => list::run(args),
        Args::Test(args) => test::run(args),
        Args::Park(args) => rest::park(args),
        Args::Halt(args) => rest::halt(args),
    }
}

/// A rig file without what a command is about.
fn nothing(path: &Path, what: &str) -> Failure {
    Failure::input(format!("{}: there is {what}", path.display()))
        .hint("docs/devices.md has examples")
}

/// Of a simulated stage, mm or degrees a second: about that of a small real one.
const SPEED: f64 = 20.0;

/// The devices that a rig file calls simulated.
struct Simulated;

impl SimulatedDevices for Simulated {
    fn camera(&self) -> Result<Box<dyn Camera>, DeviceError> {
        Ok(simulated_rig()?.camera)
    }

    fn display(&self) -> Result<Box<dyn Projector>, DeviceError> {
        Ok(simulated_rig()?.projector)
    }

    fn control(&self) -> Box<dyn ProjectorControl> {
        Box::new(SimulatedProjector::new(ProjectorSpec::default()))
    }

    fn stage(&self, axes: Vec<StageAxis>) -> Box<dyn Stage> {
        Box::new(SimulatedStage::new(axes, SPEED))
    }
}

/// Around the block of the demo.
fn simulated_rig() -> Result<Rig, DeviceError> {
    let sample = SampleSpec { kind: SampleKind::Wax, seed: 1 };
    Ok(SimulatedRig::new(&sample, Face::Back)?.rig())
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
