//! `diaphane rig test`: try each device for a moment.

use super::advice::{self, Asked, Command, Part};
use super::{Simulated, camera, file_of, nothing};
use crate::Failure;
use crate::cli::STOP;
use crate::output::{Done, Progress};
use ::rig::devices::camera::test_camera;
use ::rig::devices::{
    Check, CheckResult, HandsProgram, PowerState, ProjectorControl, power_on, test_display,
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
/// A projector is asked for its state, lamp and faults, and muted and unmuted if it is on; white and
/// black flash up on it, and every other pixel stands for three seconds. Then it shows white, and the camera takes three
/// pictures, one of which is written to be looked at. Each axis of a stage goes 1 mm or 1° away and
/// back: see that nothing is in its way. A program that puts things in place is looked for, not
/// called.
///
/// Exit code 0, and "pass" true with --json, if nothing fails; else 1 and false.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  diaphane rig test rig.toml\n  \
    diaphane rig test rig.toml --power --home\n  \
    diaphane rig test my-marble --picture look.png")]
pub(crate) struct Args {
    /// Rig file, or folder of a session on devices
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
    /// What to do about its first failure.
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<String>,
}

impl Tested {
    /// A part at `address` that knows its way out by its kind.
    fn of(
        part: Part,
        driver: &'static str,
        address: Option<Address>,
        checks: Vec<Check>,
        args: &Args,
    ) -> Self {
        let asked = Asked { part, address, command: Command::Test, rig: &args.rig };
        let advice = first_failure(&checks).and_then(|check| asked.advice(check.error?));
        Self { part: part.name(), driver, checks, advice }
    }
}

/// Every other pixel stands on the wall for so long that somebody can see whether it is even.
const LOOK: Duration = Duration::from_secs(3);
/// For one short move, and for homing: the slowest stages need a minute or two.
const MOVE: Duration = Duration::from_secs(60);
const HOMING: Duration = Duration::from_secs(180);

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let path = file_of(&args.rig)?;
    let file = RigFile::read(&path)?;
    let mut tested = Vec::new();
    if let Some(config) = &file.projector.control {
        tested.push(test_control(config, args));
    }
    let simulated = Simulated::default();
    let mut display = None;
    if let Some(config) = &file.projector.display {
        let (shown, opened) = flash(config, &simulated, args);
        tested.push(shown);
        display = opened;
    }
    let mut picture = None;
    if let Some(config) = &file.camera {
        let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
        let path = camera::picture_path(args.picture.as_deref(), &path, overwrite)?;
        let (photographed, frame) = photograph(config, &simulated);
        tested.push(photographed);
        if let Some(frame) = frame {
            camera::write_picture(&frame, &path, overwrite)?;
            picture = Some(path);
        }
    }
    if let Some(Err(error)) = display.map(|mut display| display.park()) {
        let checks = vec![step("park", Err(error))];
        let part = Part::Picture.name();
        tested.push(Tested { part, driver: "picture", checks, advice: None });
    }
    if let Some(config) = &file.stage {
        tested.push(move_stage(config, args));
    }
    if let Some(hands) = file.hands.program() {
        tested.push(look_for(&hands, args));
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
    let failed: Vec<String> = tested
        .iter()
        .filter_map(|device| {
            let check = first_failure(&device.checks)?;
            Some(format!("{}: {}: {}", device.part, check.name, check.found))
        })
        .collect();
    let json = json!({ "pass": failed.is_empty(), "devices": tested, "picture": picture });
    if !failed.is_empty() {
        eprint!("{text}");
        let hints =
            tested.iter().filter_map(|device| Some((device.part, device.advice.as_deref()?)));
        let hint = advice::together(hints);
        return Err(Failure { error: failed.join("\n"), hint, code: 1, details: Some(json) });
    }
    text += "pass";
    Ok(Done::new(json, text))
}

/// What was done besides the tests proper.
fn step(name: &str, outcome: Result<(), DeviceError>) -> Check {
    Check::of(name, outcome.map(|()| "done".into()))
}

fn first_failure(checks: &[Check]) -> Option<&Check> {
    checks.iter().find(|check| check.result == CheckResult::Fail)
}

/// Calls nobody: a program that puts things in place would.
fn look_for(hands: &HandsProgram, args: &Args) -> Tested {
    let found = hands.find().map(|path| format!("{} may be called", path.display()));
    let checks = vec![Check::of("program", found)];
    Tested::of(Part::Hands, "program", None, checks, args)
}

fn photograph(config: &CameraConfig, simulated: &Simulated) -> (Tested, Option<Frame>) {
    let (part, driver) = ("camera", config.driver());
    match config.open(simulated) {
        Ok(mut opened) => {
            let (checks, frame) = test_camera(opened.as_mut());
            let kind =
                first_failure(&checks).and_then(|check| check.error).zip(config.camera_driver());
            let advice = kind.and_then(|(kind, driver)| camera::advice_on(driver, kind));
            (Tested { part, driver, checks, advice: advice.map(Into::into) }, frame)
        }
        Err(error) => {
            let advice = config.camera_driver().and_then(|driver| camera::advice(driver, &error));
            let checks = vec![step("open", Err(error))];
            (Tested { part, driver, checks, advice }, None)
        }
    }
}

fn test_control(config: &ControlConfig, args: &Args) -> Tested {
    let mut projector = config.open(&Simulated::default());
    let mut checks = Vec::new();
    if args.power {
        checks.push(step("switch on", switch_on(projector.as_mut(), config.warm_up())));
    }
    checks.extend(test_projector_control(projector.as_mut(), config.input()));
    Tested::of(Part::Control, config.driver(), config.address(), checks, args)
}

/// Flashes pictures up, and leaves the projector white, so that the camera sees something.
fn flash(
    config: &DisplayConfig,
    simulated: &Simulated,
    args: &Args,
) -> (Tested, Option<Box<dyn Projector>>) {
    let (checks, display) = match config.open(simulated) {
        Ok(mut display) => {
            let mut checks = test_display(display.as_mut());
            if matches!(config, DisplayConfig::Window { .. }) {
                std::thread::sleep(LOOK);
            }
            let ProjectorInfo { width, height, .. } = display.info();
            let data = vec![u8::MAX; width as usize * height as usize];
            let white = display.show(&ProjectorImage { width, height, data });
            checks.push(step("white", white));
            (checks, Some(display))
        }
        Err(error) => (vec![step("open", Err(error))], None),
    };
    (Tested::of(Part::Picture, config.driver(), config.address(), checks, args), display)
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
    let mut stage = config.open(&Simulated::default());
    let mut checks = Vec::new();
    if args.unlock {
        checks.push(step("unlock", stage.unlock()));
    }
    if args.home && first_failure(&checks).is_none() {
        checks.push(step("home", stage.home(HOMING)));
    }
    // What it would do without what was asked for first is not what was asked for.
    if first_failure(&checks).is_none() {
        checks.extend(test_stage(stage.as_mut(), MOVE));
    }
    Tested::of(Part::Stage, config.driver(), config.address(), checks, args)
}
