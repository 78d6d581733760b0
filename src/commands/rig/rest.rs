//! `diaphane rig park` and `diaphane rig halt`: the end of the work, and the end of a fright.

use super::advice::{Asked, Command, Part};
use super::{Simulated, nothing, read};
use crate::Failure;
use crate::cli::STOP;
use crate::output::{Done, Progress};
use ::rig::DeviceError;
use ::rig::devices::{PowerState, power_off};
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Put everything away: the stage to its parking places, the projector off
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane rig park rig.toml\n  diaphane rig park my-marble --home"
)]
pub(crate) struct Park {
    /// Rig file, or folder of a session on devices
    rig: PathBuf,
    /// Find the stage's reference first: it goes to its switches
    #[arg(long)]
    home: bool,
}

/// Stop the stage at once, wherever it is; it may lose its place
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane rig halt rig.toml")]
pub(crate) struct Halt {
    /// Rig file, or folder of a session on devices
    rig: PathBuf,
}

/// For the way to one parking place: the longest slides need minutes.
const MOVE: Duration = Duration::from_secs(180);

/// Lamps cool down for a minute or two.
const COOLING: Duration = Duration::from_secs(300);

pub(super) fn park(args: &Park) -> Result<Done, Failure> {
    let file = read(&args.rig)?;
    let mut done = Vec::new();
    let asked = |part, address| Asked { part, address, command: Command::Park, rig: &args.rig };
    // The stage first: it is the one that stands in the way.
    if let Some(config) = &file.stage {
        let mut stage = config.open(&Simulated::default());
        let homed = if args.home { stage.home(MOVE) } else { Ok(()) };
        let asked = asked(Part::Stage, config.address());
        homed.and_then(|()| stage.park(MOVE)).map_err(|error| failure(error, &asked))?;
        done.push("stage");
    }
    if let Some(config) = &file.projector.control {
        let mut projector = config.open(&Simulated::default());
        let mut progress = Progress::new("projector", 0);
        let asked = asked(Part::Control, config.address());
        power_off(projector.as_mut(), COOLING, &mut |state: PowerState, _| {
            progress.set(0, &state.to_string());
            !STOP.load(Ordering::Relaxed)
        })
        .map_err(|error| failure(error, &asked))?;
        progress.finish("off");
        done.push("projector");
    }
    if done.is_empty() {
        return Err(nothing(&args.rig, "neither a [stage] nor a [projector.control] to park"));
    }
    Ok(Done::new(json!({ "parked": done }), format!("parked: {}", done.join(", "))))
}

pub(super) fn halt(args: &Halt) -> Result<Done, Failure> {
    let file = read(&args.rig)?;
    let Some(config) = &file.stage else {
        return Err(nothing(&args.rig, "no [stage] to halt"));
    };
    let mut stage = config.open(&Simulated::default());
    let asked = Asked {
        part: Part::Stage,
        address: config.address(),
        command: Command::Halt,
        rig: &args.rig,
    };
    stage.halt().map_err(|error| failure(error, &asked))?;
    let text = format!("{}: halted; it may have to be homed", stage.name());
    Ok(Done::new(json!({ "halted": stage.name() }), text))
}

fn failure(error: DeviceError, asked: &Asked<'_>) -> Failure {
    if STOP.load(Ordering::Relaxed) {
        return Failure::other(format!("interrupted: {error}"))
            .hint("the same command goes on from here");
    }
    Failure { hint: asked.advice(error.kind()), ..Failure::other(error) }
}
