//! A short test of each device, the same for every driver.

use std::time::Duration;

use serde::Serialize;

use super::{Coordinate, Fault, PowerState, ProjectorControl, Severity, Stage};
use crate::{DeviceError, DeviceErrorKind, Projector, ProjectorImage, ProjectorInfo};

/// How one check went.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CheckResult {
    /// As it should be.
    Pass,
    /// Not as it should be.
    Fail,
    /// Not done; the text says why.
    Skipped,
}

/// One thing that was tried.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// What.
    pub name: String,
    /// How it went.
    pub result: CheckResult,
    /// What was found.
    pub found: String,
    /// What went wrong, where a device did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<DeviceErrorKind>,
}

impl Check {
    /// How a request went.
    pub fn of(name: impl Into<String>, outcome: Result<String, DeviceError>) -> Self {
        let (result, found, error) = match outcome {
            Ok(found) => (CheckResult::Pass, found, None),
            Err(error) => (CheckResult::Fail, error.to_string(), Some(error.kind())),
        };
        Self { name: name.into(), result, found, error }
    }

    pub(super) fn fail(name: impl Into<String>, found: impl Into<String>) -> Self {
        let (name, found) = (name.into(), found.into());
        Self { name, result: CheckResult::Fail, found, error: None }
    }

    pub(super) fn skipped(name: impl Into<String>, found: impl Into<String>) -> Self {
        let (name, found) = (name.into(), found.into());
        Self { name, result: CheckResult::Skipped, found, error: None }
    }
}

/// Flashes pictures up: white, black, and every other pixel, each of which has to stand.
pub fn test_display(display: &mut dyn Projector) -> Vec<Check> {
    let ProjectorInfo { name, width, height } = display.info();
    let checker = |x: u32, y: u32| if (x + y).is_multiple_of(2) { u8::MAX } else { 0 };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| checker(x, y))).collect();
    let flat = |level: u8| vec![level; width as usize * height as usize];
    let pictures = [("white", flat(u8::MAX)), ("black", flat(0)), ("pixels", pixels)];
    let mut checks = Vec::new();
    for (what, data) in pictures {
        let shown = display.show(&ProjectorImage { width, height, data });
        let stood = shown.and_then(|()| display.still_shows());
        let failed = stood.is_err();
        checks.push(Check::of(what, stood.map(|()| format!("stood on {name}"))));
        if failed {
            break;
        }
    }
    checks
}

/// Asks a projector for its state, lamp and faults, and, if it is on, selects `input` and mutes and
/// unmutes it.
pub fn test_projector_control(
    projector: &mut dyn ProjectorControl,
    input: Option<&str>,
) -> Vec<Check> {
    let power = projector.power_state();
    let on = matches!(power, Ok(PowerState::On));
    let answers = power.is_ok();
    let mut checks = vec![Check::of("power", power.map(|state| state.to_string()))];
    if !answers {
        // Further questions would only wait for the same silence.
        return checks;
    }
    checks.push(Check::of("model", projector.name()));
    let hours = projector.lamp_hours().map(|hours| {
        let hours: Vec<_> = hours.iter().map(|h| format!("{h} h")).collect();
        if hours.is_empty() { "no lamp that is counted".to_owned() } else { hours.join(", ") }
    });
    checks.push(Check::of("lamp", hours));
    checks.push(match projector.faults() {
        Ok(None) => Check::skipped("faults", "the protocol cannot tell"),
        Ok(Some(faults)) => {
            let list = faults.iter().map(Fault::to_string).collect::<Vec<_>>().join(", ");
            if faults.iter().any(|f| f.severity == Severity::Error) {
                Check::fail("faults", list)
            } else {
                Check::of("faults", Ok(if list.is_empty() { "none".into() } else { list }))
            }
        }
        Err(error) => Check::of("faults", Err(error)),
    });
    if let Some(input) = input.filter(|_| on) {
        let selected = projector.select_input(input).map(|()| format!("{input} selected"));
        checks.push(Check::of("input", selected));
    }
    checks.push(if on {
        Check::of("mute", mute_and_unmute(projector))
    } else {
        Check::skipped("mute", "the projector is not on")
    });
    checks
}

fn mute_and_unmute(projector: &mut dyn ProjectorControl) -> Result<String, DeviceError> {
    let mut told = true;
    for mute in [true, false] {
        projector.set_av_mute(mute)?;
        match projector.av_mute()? {
            Some(now) if now != mute => {
                let device = projector.name()?;
                let state = if mute { "muted" } else { "unmuted" };
                let reason = format!("it was {state}, and says that it was not");
                return Err(DeviceError::Fault { device, reason });
            }
            Some(_) => {}
            None => told = false,
        }
    }
    Ok(if told { "muted and back" } else { "accepted; the protocol cannot tell more" }.into())
}

/// How far a stage is moved: enough to be seen, too little to hit anything.
const STEP: f64 = 1.0;

/// Asks each axis where it is and moves it by 1 mm or 1° and back, `limit` for each way.
pub fn test_stage(stage: &mut dyn Stage, limit: Duration) -> Vec<Check> {
    let mut checks = Vec::new();
    for (number, axis) in stage.axes().to_vec().into_iter().enumerate() {
        let name = format!("axis {}", axis.name);
        let here = match stage.position(number) {
            Ok(here) => here,
            Err(error) => {
                checks.push(Check::of(name, Err(error)));
                // After an alarm or a lost link the other axes would say the same.
                return checks;
            }
        };
        let (first, last) = axis.range.ends();
        let there = [STEP, -STEP].into_iter().map(|step| here.value() + step);
        let there = there.into_iter().find(|v| (first.value()..=last.value()).contains(v));
        let Some(there) = there.map(|v| here.at(v)) else {
            let found = format!("at {here}, too far outside of {first} to {last} to be moved");
            checks.push(Check::fail(name, found));
            continue;
        };
        checks.push(Check::of(name, there_and_back(stage, number, here, there, limit)));
    }
    checks
}

fn there_and_back(
    stage: &mut dyn Stage,
    axis: usize,
    here: Coordinate,
    there: Coordinate,
    limit: Duration,
) -> Result<String, DeviceError> {
    stage.move_to(axis, there, limit)?;
    let reached = stage.position(axis)?;
    stage.move_to(axis, here, limit)?;
    let back = stage.position(axis)?;
    Ok(format!("from {here} to {reached} and back to {back}"))
}
