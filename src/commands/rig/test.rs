//! `diaphane rig test`: try each device for a moment.

use super::{Simulated, camera, nothing, permission};
use crate::Failure;
use crate::cli::STOP;
use crate::output::{Done, Progress};
use ::rig::devices::camera::test_camera;
use ::rig::devices::{
    Check, CheckResult, PowerState, ProjectorControl, power_on, test_display,
    test_projector_control, test_stage,
};
use ::rig::{
    Address, CameraConfig, ControlConfig, DeviceError, DisplayConfig, Frame, Projector,
    ProjectorImage, ProjectorInfo, RigFile, StageConfig,
};
use material::Overwrite;
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Try each device for a moment
///
/// A projector is asked for its state, lamp and faults, and muted and unmuted if it is on; white,
/// black and every other pixel flash up on it. Then it shows white, and the camera takes three
/// pictures, one of which is written to be looked at. Each axis of a stage goes 1 mm or 1° away and
/// back: see that nothing is in its way.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  diaphane rig test rig.toml\n  \
    diaphane rig test rig.toml --power --home\n  \
    diaphane rig test rig.toml --picture look.png")]
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
    /// Where the camera's picture goes, PNG [default: beside the rig file, numbered]
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Replace a picture that is there
    #[arg(long)]
    force: bool,
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
    let simulated = Simulated::default();
    let mut display = None;
    if let Some(config) = &file.projector.display {
        let (shown, opened) = flash(config, &simulated);
        tested.push(shown);
        display = opened;
    }
    let mut picture = None;
    if let Some(config) = &file.camera {
        let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
        let path = camera::picture_path(args.picture.as_deref(), &args.rig, overwrite)?;
        let (photographed, frame) = photograph(config, &simulated);
        tested.push(photographed);
        if let Some(frame) = frame {
            camera::write_picture(&frame, &path, overwrite)?;
            picture = Some(path);
        }
    }
    if let Some(Err(error)) = display.map(|mut display| display.park()) {
        let (checks, advice) = step("park", Err(error), None);
        tested.push(Tested { part: "projector", driver: "picture", checks: vec![checks], advice });
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
    if let Some(path) = &picture {
        text += &format!("picture: {}\n", path.display());
    }
    if tested.is_empty() {
        return Err(nothing(&args.rig, "no [camera], no [projector] and no [stage] to test"));
    }
    let fails = |check: &&Check| check.result == CheckResult::Fail;
    let first = tested
        .iter()
        .find_map(|device| device.checks.iter().find(fails).map(|check| (device, check.clone())));
    let json = json!({ "pass": first.is_none(), "devices": tested, "picture": picture });
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

fn photograph(config: &CameraConfig, simulated: &Simulated) -> (Tested, Option<Frame>) {
    let (part, driver) = ("camera", config.driver());
    let advice = |error: &DeviceError| camera::advice(config.camera_driver()?, error);
    match config.open(simulated) {
        Ok(mut opened) => {
            let (checks, frame) = test_camera(opened.as_mut());
            (Tested { part, driver, checks, advice: None }, frame)
        }
        Err(error) => {
            let advice = advice(&error);
            let (name, result, found) = ("open".into(), CheckResult::Fail, error.to_string());
            let checks = vec![Check { name, result, found }];
            (Tested { part, driver, checks, advice }, None)
        }
    }
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

/// Flashes pictures up, and leaves the projector white, so that the camera sees something.
fn flash(config: &DisplayConfig, simulated: &Simulated) -> (Tested, Option<Box<dyn Projector>>) {
    let (part, driver) = ("projector", config.driver());
    match config.open(simulated) {
        Ok(mut display) => {
            let mut checks = test_display(display.as_mut());
            let ProjectorInfo { width, height, .. } = display.info();
            let data = vec![u8::MAX; width as usize * height as usize];
            let white = display.show(&ProjectorImage { width, height, data });
            checks.push(step("white", white, None).0);
            (Tested { part, driver, checks, advice: None }, Some(display))
        }
        Err(error) => {
            let (opened, advice) = step("open", Err(error), config.address().as_ref());
            (Tested { part, driver, checks: vec![opened], advice }, None)
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
