//! `diaphane rig test`: try each device for a moment.

use super::{Simulated, nothing, permission};
use crate::Failure;
use crate::cli::STOP;
use crate::output::{Done, Progress};
use ::rig::devices::{
    Check, CheckResult, PowerState, ProjectorControl, power_on, test_display,
    test_projector_control, test_stage,
};
use ::rig::{Address, ControlConfig, DeviceError, DisplayConfig, RigFile, StageConfig};
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Try each device for a moment
///
/// A projector is asked for its state, lamp and faults, and muted and unmuted if it is on; white,
/// black and every other pixel flash up on it. Each
/// axis of a stage goes 1 mm or 1° away and back: see that nothing is in its way.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  diaphane rig test rig.toml\n  \
    diaphane rig test rig.toml --power --home")]
pub(crate) struct Args {
    /// Rig file
    rig: PathBuf,
    /// Switch the projector on first, wait until it is, and leave it on
    #[arg(long)]
    power: bool,
    /// Find the stage's reference first: it goes to its switches
    #[arg(long)]
    home: bool,
    /// Have the stage forget an alarm first; look at it before
    #[arg(long)]
    unlock: bool,
}

#[derive(Serialize)]
struct Tested {
    part: &'static str,
    driver: &'static str,
    checks: Vec<Check>,
    /// What to do about the first failure.
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<String>,
}

/// For one short move, and for homing: the slowest stages need a minute or two.
const MOVE: Duration = Duration::from_secs(60);
const HOMING: Duration = Duration::from_secs(180);

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let file = RigFile::read(&args.rig)?;
    let mut tested = Vec::new();
    if let Some(config) = &file.projector.control {
        tested.push(test_control(config, args));
    }
    if let Some(config) = &file.projector.display {
        tested.push(flash(config));
    }
    if let Some(config) = &file.stage {
        tested.push(move_stage(config, args));
    }
    let mut text = String::new();
    for device in &tested {
        text += &format!("{} ({})\n", device.part, device.driver);
        for check in &device.checks {
            let mark = match check.result {
                CheckResult::Pass => "pass",
                CheckResult::Fail => "FAIL",
                CheckResult::Skipped => "-",
            };
            text += &format!("  {mark:5} {:10} {}\n", check.name, check.found);
        }
    }
    if tested.is_empty() {
        return Err(nothing(&args.rig, "neither a [projector] nor a [stage] to test"));
    }
    let fails = |check: &&Check| check.result == CheckResult::Fail;
    let first = tested
        .iter()
        .find_map(|device| device.checks.iter().find(fails).map(|check| (device, check.clone())));
    let json = json!({ "pass": first.is_none(), "devices": tested });
    if let Some((device, check)) = first {
        eprint!("{text}");
        return Err(Failure {
            error: format!("{}: {}: {}", device.part, check.name, check.found),
            hint: device.advice.clone(),
            code: 1,
            details: Some(json),
        });
    }
    text += "pass";
    Ok(Done::new(json, text))
}

/// What was done before the test proper, and what to do if it failed.
fn step(
    name: &str,
    outcome: Result<(), DeviceError>,
    address: Option<&Address>,
) -> (Check, Option<String>) {
    let (result, found, advice) = match outcome {
        Ok(()) => (CheckResult::Pass, "done".into(), None),
        Err(error) => {
            (CheckResult::Fail, error.to_string(), permission::advice(error.kind(), address))
        }
    };
    (Check { name: name.into(), result, found }, advice)
}

/// What to do about checks that failed: they are words, but asking once `again` tells.
fn what_helps(
    checks: &[Check],
    again: impl FnOnce() -> Option<DeviceError>,
    address: Option<&Address>,
) -> Option<String> {
    checks.iter().find(|check| check.result == CheckResult::Fail)?;
    permission::advice(again()?.kind(), address)
}

fn test_control(config: &ControlConfig, args: &Args) -> Tested {
    let mut projector = config.open(&Simulated::default());
    let mut checks = Vec::new();
    let mut advice = None;
    if args.power {
        let on = switch_on(projector.as_mut(), config.warm_up());
        let (done, way_out) = step("switch on", on, config.address().as_ref());
        checks.push(done);
        advice = way_out;
    }
    let answers = test_projector_control(projector.as_mut(), config.input());
    let again = || projector.power_state().err();
    advice = advice.or_else(|| what_helps(&answers, again, config.address().as_ref()));
    checks.extend(answers);
    Tested { part: "projector control", driver: config.driver(), checks, advice }
}

fn flash(config: &DisplayConfig) -> Tested {
    let (part, driver) = ("projector", config.driver());
    match config.open(&Simulated::default()) {
        Ok(mut display) => {
            let mut checks = test_display(display.as_mut());
            if let Err(error) = display.park() {
                checks.push(step("park", Err(error), None).0);
            }
            Tested { part, driver, checks, advice: None }
        }
        Err(error) => {
            let (opened, advice) = step("open", Err(error), config.address().as_ref());
            Tested { part, driver, checks: vec![opened], advice }
        }
    }
}

fn switch_on(projector: &mut dyn ProjectorControl, limit: Duration) -> Result<(), DeviceError> {
    let mut progress = Progress::new("projector", 0);
    power_on(projector, limit, &mut |state: PowerState, _| {
        progress.set(0, &state.to_string());
        !STOP.load(Ordering::Relaxed)
    })?;
    progress.finish("on");
    Ok(())
}

fn move_stage(config: &StageConfig, args: &Args) -> Tested {
    let (part, driver) = ("stage", config.driver());
    let mut stage = config.open(&Simulated::default());
    let mut checks = Vec::new();
    for (name, wanted) in [("unlock", args.unlock), ("home", args.home)] {
        if !wanted {
            continue;
        }
        let outcome = if name == "unlock" { stage.unlock() } else { stage.home(HOMING) };
        let (done, advice) = step(name, outcome, config.address().as_ref());
        let failed = done.result == CheckResult::Fail;
        checks.push(done);
        if failed {
            // What it would do without it is not what was asked for.
            return Tested { part, driver, checks, advice };
        }
    }
    let moved = test_stage(stage.as_mut(), MOVE);
    let advice = what_helps(&moved, || stage.position(0).err(), config.address().as_ref());
    checks.extend(moved);
    Tested { part, driver, checks, advice }
}
