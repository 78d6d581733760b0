//! Values of a rig file that make no sense.

use std::path::Path;

use super::source::Source;
use super::{ControlConfig, DisplayConfig, RigFile, RigFileError, StageConfig};

/// A value that is wrong, in a file that is not named yet.
pub(super) struct Problem {
    key: String,
    expected: String,
    found: String,
}

impl Problem {
    pub fn at(self, path: &Path, source: &Source<'_>) -> RigFileError {
        let Self { key, expected, found } = self;
        let line = source.line_of(&key);
        RigFileError::Value { path: path.into(), line, key, expected, found }
    }
}

pub(super) fn wrong(
    key: impl Into<String>,
    expected: impl Into<String>,
    found: impl ToString,
) -> Result<(), Problem> {
    Err(Problem { key: key.into(), expected: expected.into(), found: found.to_string() })
}

/// Speeds that serial ports have.
const BAUDS: [u32; 11] =
    [2400, 4800, 9600, 14_400, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 921_600];

impl RigFile {
    pub(super) fn check(&self) -> Result<(), Problem> {
        let nothing = self.camera.is_none()
            && self.projector.display.is_none()
            && self.projector.control.is_none()
            && self.stage.is_none();
        if nothing {
            let parts = "a [camera], a [projector.display], a [projector.control] or a [stage]";
            return wrong("the file", parts, "none");
        }
        if let Some(DisplayConfig::Window { monitor, settle_ms, .. }) = &self.projector.display {
            if monitor.trim().is_empty() {
                return wrong("projector.display.monitor", "a name, such as HDMI-1", "nothing");
            }
            if !(0.0..=5000.0).contains(settle_ms) {
                return wrong("projector.display.settle_ms", "0 to 5000", settle_ms);
            }
        }
        if let Some(camera) = &self.camera {
            camera.check()?;
        }
        if let Some(control) = &self.projector.control {
            check_control(control)?;
        }
        if let Some(stage) = &self.stage {
            check_stage(stage)?;
        }
        if let super::HandsConfig::Program { program, limit_s } = &self.hands {
            if program.trim().is_empty() {
                return wrong("hands.program", "a program", "nothing");
            }
            if !(*limit_s >= 1.0 && *limit_s <= 86_400.0) {
                return wrong("hands.limit_s", "1 to 86400", limit_s);
            }
        }
        check_places(self)?;
        match (self.projector.control.as_ref(), self.stage.as_ref()) {
            (Some(control), Some(stage))
                if control.address().is_some() && control.address() == stage.address() =>
            {
                wrong("stage.port", "another port than the projector's", "the same")
            }
            _ => Ok(()),
        }
    }
}

fn check_places(file: &RigFile) -> Result<(), Problem> {
    let axes = file.stage.as_ref().map(StageConfig::axes).unwrap_or_default();
    for (i, place) in file.places.iter().enumerate() {
        let key = |name: &str| format!("places[{i}].{name}");
        if file.places.iter().take(i).any(|other| other.target == place.target) {
            return wrong(key("target"), "each target once", place.target.name());
        }
        for (name, value) in &place.at {
            let Some(axis) = axes.iter().find(|axis| axis.name == *name) else {
                let names: Vec<_> = axes.iter().map(|axis| axis.name.as_str()).collect();
                let there = format!("an axis of [stage] ({})", names.join(", "));
                return wrong(key("at"), there, format!("{name:?}"));
            };
            let (from, to) = axis.range.ends();
            if !(from.value()..=to.value()).contains(value) {
                return wrong(key(&format!("at.{name}")), format!("from {from} to {to}"), value);
            }
        }
    }
    Ok(())
}

fn check_control(control: &ControlConfig) -> Result<(), Problem> {
    let key = |name: &str| format!("projector.control.{name}");
    match control {
        ControlConfig::Simulated { .. } => {}
        ControlConfig::Pjlink { host, port, password, .. } => {
            if host.trim().is_empty() {
                return wrong(key("host"), "a name or an address", "nothing");
            }
            if *port == 0 {
                return wrong(key("port"), "1 to 65535", port);
            }
            let good = |p: &String| (1..=32).contains(&p.len()) && p.bytes().all(|b| b > b' ');
            if password.as_ref().is_some_and(|p| !good(p)) {
                // Not shown: messages end up in places where passwords do not belong.
                return wrong(key("password"), "1 to 32 characters without spaces", "another");
            }
        }
        ControlConfig::Optoma { port, baud, id, .. } => {
            check_serial("projector.control", port, *baud)?;
            if *id > 99 {
                return wrong(key("id"), "0 to 99", id);
            }
        }
        ControlConfig::Epson { port, baud, .. } | ControlConfig::Benq { port, baud, .. } => {
            check_serial("projector.control", port, *baud)?;
        }
    }
    if let Some(input) = control.input() {
        let bytes = input.as_bytes();
        let (good, expected) = match control {
            ControlConfig::Simulated { .. } => (!bytes.is_empty(), "a name"),
            ControlConfig::Pjlink { .. } => (
                matches!(bytes, [b'1'..=b'5', b'1'..=b'9']),
                "two digits, the first from 1 to 5, the second not 0",
            ),
            ControlConfig::Optoma { .. } => (
                (1..=2).contains(&bytes.len()) && bytes.iter().all(u8::is_ascii_digit),
                "one or two digits",
            ),
            ControlConfig::Epson { .. } => (
                bytes.len() == 2 && bytes.iter().all(u8::is_ascii_hexdigit),
                "two hexadecimal digits",
            ),
            ControlConfig::Benq { .. } => (
                !bytes.is_empty() && bytes.iter().all(u8::is_ascii_alphanumeric),
                "letters and digits",
            ),
        };
        if !good {
            return wrong(key("input"), expected, format!("{input:?}"));
        }
    }
    let warm_up_s = control.warm_up().as_secs_f64();
    if !(1.0..=600.0).contains(&warm_up_s) {
        return wrong(key("warm_up_s"), "1 to 600", control.warm_up_s());
    }
    Ok(())
}

fn check_serial(section: &str, port: &str, baud: u32) -> Result<(), Problem> {
    if port.trim().is_empty() {
        return wrong(format!("{section}.port"), "a serial port, such as /dev/ttyUSB0", "nothing");
    }
    if !BAUDS.contains(&baud) {
        let all: Vec<_> = BAUDS.iter().map(u32::to_string).collect();
        return wrong(format!("{section}.baud"), format!("one of {}", all.join(", ")), baud);
    }
    Ok(())
}

fn check_stage(stage: &StageConfig) -> Result<(), Problem> {
    match stage {
        StageConfig::Simulated { .. } => {}
        StageConfig::Grbl { port, baud, axes } => {
            check_serial("stage", port, *baud)?;
            for (i, axis) in axes.iter().enumerate() {
                if axes.iter().take(i).any(|other| other.letter == axis.letter) {
                    let key = format!("stage.axes[{i}].letter");
                    return wrong(
                        key,
                        "another letter for each axis",
                        format!("{:?}", axis.letter),
                    );
                }
            }
        }
        StageConfig::Zaber { port, baud, axes } => {
            check_serial("stage", port, *baud)?;
            for (i, axis) in axes.iter().enumerate() {
                let key = |name: &str| format!("stage.axes[{i}].{name}");
                if !(1..=99).contains(&axis.device) {
                    return wrong(key("device"), "1 to 99", axis.device);
                }
                if !(1..=9).contains(&axis.axis) {
                    return wrong(key("axis"), "1 to 9", axis.axis);
                }
                if !(axis.step.is_finite() && axis.step > 0.0) {
                    return wrong(key("step"), "more than 0", axis.step);
                }
                let same = |other: &super::ZaberAxisConfig| {
                    (other.device, other.axis) == (axis.device, axis.axis)
                };
                if axes.iter().take(i).any(same) {
                    return wrong(key("device"), "another device or axis for each", axis.device);
                }
            }
        }
    }
    let axes = stage.axes();
    if axes.is_empty() {
        return wrong("stage.axes", "at least one", "none");
    }
    for (i, axis) in axes.iter().enumerate() {
        let key = |name: &str| format!("stage.axes[{i}].{name}");
        if axis.name.trim().is_empty() || axes.iter().take(i).any(|other| other.name == axis.name) {
            return wrong(key("name"), "a name of its own", format!("{:?}", axis.name));
        }
        let (from, to) = axis.range.ends();
        let (from, to) = (from.value(), to.value());
        // A kilometre is a slip of the pen.
        if !(from.abs() <= 1e6 && to.abs() <= 1e6 && from < to) {
            return wrong(
                key("range"),
                "the lower end first, up to 1e6",
                format!("[{from}, {to}]"),
            );
        }
        if let Some(park) = axis.park
            && !(from..=to).contains(&park.value())
        {
            return wrong(key("park"), format!("from {from} to {to}"), park.value());
        }
    }
    Ok(())
}
