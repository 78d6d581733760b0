//! `diaphane rig list`: what is connected, and what is in the way.

use super::advice::{self, Asked, Command, Part};
use super::{Simulated, camera, read};
use crate::Failure;
use crate::output::Done;
use ::rig::devices::{SerialPort, find_monitor, list_monitors, scan_serial_ports};
use ::rig::{DeviceError, DeviceErrorKind, DisplayConfig, HandsConfig, RigFile};
use serde::Serialize;
use serde_json::json;
use std::path::{Path, PathBuf};

/// What is connected, and what is in the way
///
/// With a rig file, or the folder of a session on devices: each of its devices, asked for a sign of
/// life. Without: the cameras that are found, the monitors and the serial ports of this machine;
/// each port is opened for a moment, which restarts boards with GRBL.
///
/// Of a rig the exit code is 0, and "ready" true with --json, if each device can be used; else 1 and
/// false. A stage that has yet to be homed can be used. Without a rig nothing is to be ready: the
/// exit code is 0 whatever is found, and there is no "ready".
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane rig list\n  diaphane rig list rig.toml\n  diaphane rig list my-marble"
)]
pub(crate) struct Args {
    /// Rig file, or folder of a session on devices
    rig: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum State {
    Found,
    /// In software.
    Fake,
    /// A stage that does not know where it is until it is homed, as after every start.
    NeedsHoming,
    NoPermission,
    Busy,
    NotFound,
    NoAnswer,
    /// More than one may be meant.
    Ambiguous,
    /// This program was built without its driver.
    NotBuilt,
    /// It answers that it is not well, or what nobody understands.
    Trouble,
}

impl State {
    fn of(error: &DeviceError) -> Self {
        match error.kind() {
            DeviceErrorKind::NotFound | DeviceErrorKind::Disconnected => Self::NotFound,
            DeviceErrorKind::NoPermission => Self::NoPermission,
            DeviceErrorKind::Busy => Self::Busy,
            DeviceErrorKind::Timeout => Self::NoAnswer,
            DeviceErrorKind::Ambiguous => Self::Ambiguous,
            DeviceErrorKind::MissingDriver => Self::NotBuilt,
            DeviceErrorKind::NotHomed => Self::NeedsHoming,
            _ => Self::Trouble,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::Fake => "fake",
            Self::NeedsHoming => "needs homing",
            Self::NoPermission => "NO PERMISSION",
            Self::Busy => "BUSY",
            Self::NotFound => "NOT FOUND",
            Self::NoAnswer => "NO ANSWER",
            Self::Ambiguous => "AMBIGUOUS",
            Self::NotBuilt => "NOT BUILT",
            Self::Trouble => "TROUBLE",
        }
    }

    fn good(self) -> bool {
        matches!(self, Self::Found | Self::Fake | Self::NeedsHoming)
    }
}

#[derive(Serialize)]
struct Device {
    /// The part of the rig; `monitor` or `serial port` where there is no rig file.
    part: &'static str,
    driver: Option<&'static str>,
    address: Option<String>,
    state: State,
    found: String,
    /// What to do about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<String>,
}

impl Device {
    fn fake(part: &'static str) -> Self {
        let (driver, found) = (Some("simulated"), "in software".into());
        Self { part, driver, address: None, state: State::Fake, found, advice: None }
    }

    fn new(driver: &'static str, asked: Asked<'_>, answer: Result<String, DeviceError>) -> Self {
        let (state, found, advice) = match answer {
            Ok(found) if asked.address.is_none() => (State::Fake, found, None),
            Ok(found) => (State::Found, found, None),
            Err(error) => (State::of(&error), error.to_string(), asked.advice(error.kind())),
        };
        let address = asked.address.map(|address| address.to_string());
        Self { part: asked.part.name(), driver: Some(driver), address, state, found, advice }
    }

    /// The program that puts things on the bench, looked for and not called.
    fn hands(program: &str, answer: Result<PathBuf, DeviceError>, asked: &Asked<'_>) -> Self {
        let (state, found, advice) = match answer {
            Ok(path) => (State::Found, format!("{} may be called", path.display()), None),
            Err(error) => (State::of(&error), error.to_string(), asked.advice(error.kind())),
        };
        let (driver, address) = (Some("program"), Some(program.to_owned()));
        Self { part: asked.part.name(), driver, address, state, found, advice }
    }

    /// For people: what it is, and what to do about it if `advised`.
    fn lines(&self, advised: bool) -> String {
        let name = self.driver.map_or(String::new(), |driver| format!(" ({driver})"));
        let part = format!("{}{name}", self.part);
        let address = self.address.as_deref().unwrap_or("-");
        let mut text = format!("{:14} {part:30} {address:16} {}\n", self.state.words(), self.found);
        for line in self.advice.iter().filter(|_| advised).flat_map(|advice| advice.lines()) {
            text += &format!("{:15}{line}\n", "");
        }
        text
    }

    /// The monitors of this machine, or why they are not known.
    fn monitors() -> Vec<Self> {
        let part = "monitor";
        match list_monitors(None) {
            Ok(monitors) => monitors
                .into_iter()
                .map(|monitor| Self {
                    part,
                    driver: Some("window"),
                    found: format!("{monitor} at {}, {}", monitor.x, monitor.y),
                    address: Some(monitor.name),
                    state: State::Found,
                    advice: None,
                })
                .collect(),
            Err(error) => {
                let advice = advice::picture(error.kind());
                let (state, found) = (State::of(&error), error.to_string());
                vec![Self { part, driver: Some("window"), address: None, state, found, advice }]
            }
        }
    }

    fn camera(answer: camera::Answer) -> Self {
        let (part, driver) = ("camera", Some(answer.driver.name()));
        let (state, found) = match answer.outcome {
            Ok((found, true)) => (State::Fake, found),
            Ok((found, false)) => (State::Found, found),
            Err(error) => (State::of(&error), error.to_string()),
        };
        Self { part, driver, address: answer.address, state, found, advice: answer.advice }
    }

    fn port(port: SerialPort) -> Self {
        let mut found = match &port.usb {
            Some(usb) => format!("{:04x}:{:04x} {}", usb.vendor, usb.product, usb.name),
            None => "of this machine's board".into(),
        };
        let (mut state, mut advice) = (State::Found, None);
        if let Some(problem) = &port.problem {
            state = State::of(problem);
            advice = advice::port(problem.kind(), &port.path);
            found = format!("{found}; {problem}");
        }
        let address = Some(port.path);
        Self { part: "serial port", driver: None, address, state, found, advice }
    }
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let Some(rig) = &args.rig else {
        let devices = around();
        let json = json!({ "devices": devices });
        return Ok(Done::new(json, of_machine(&devices).trim_end()));
    };
    let devices = ask(&read(rig)?, rig);
    let bad: Vec<_> = devices.iter().filter(|device| !device.state.good()).collect();
    let json = json!({ "ready": bad.is_empty(), "devices": devices });
    // What helps with those that cannot be used comes last, where it is read.
    let text: String = devices.iter().map(|d| d.lines(d.state.good())).collect();
    if bad.is_empty() {
        return Ok(Done::new(json, text.trim_end()));
    }
    eprint!("{text}");
    let hints = bad.iter().filter_map(|device| Some((device.part, device.advice.as_deref()?)));
    Err(Failure {
        error: format!("{} of {} devices cannot be used", bad.len(), devices.len()),
        hint: advice::together(hints),
        code: 1,
        details: Some(json),
    })
}

/// Whatever is connected to this machine.
fn around() -> Vec<Device> {
    let cameras = camera::list().into_iter().map(Device::camera);
    let ports = scan_serial_ports().into_iter().map(Device::port);
    cameras.chain(Device::monitors()).chain(ports).collect()
}

fn of_machine(devices: &[Device]) -> String {
    let mut text: String = devices.iter().map(|device| device.lines(true)).collect();
    if devices.iter().all(|device| device.part != "camera") {
        text += "no cameras\n";
    }
    if devices.iter().all(|device| device.part != "serial port") {
        text += "no serial ports\n";
    }
    text += "projectors on the network are found by their address alone: write a rig file, docs/devices.md has examples";
    text
}

/// Each device of a rig, asked; `rig` is what it was called, for commands.
fn ask(file: &RigFile, rig: &Path) -> Vec<Device> {
    let mut devices = Vec::new();
    let asked = |part, address| Asked { part, address, command: Command::List, rig };
    if let Some(config) = &file.camera {
        let answer = camera::ask(config, &Simulated::default());
        devices.push(answer.map_or_else(|| Device::fake("camera"), Device::camera));
    }
    match &file.projector.display {
        Some(DisplayConfig::Simulated {}) => devices.push(Device::fake("projector")),
        Some(config @ DisplayConfig::Window { monitor, server, .. }) => {
            // Looked for only: a window would flash up on whatever is shown there.
            let answer =
                find_monitor(server.as_deref(), monitor).map(|monitor| monitor.to_string());
            let asked = asked(Part::Picture, config.address());
            devices.push(Device::new(config.driver(), asked, answer));
        }
        None => {}
    }
    if let Some(config) = &file.projector.control {
        let mut projector = config.open(&Simulated::default());
        let answer =
            projector.power_state().and_then(|power| Ok(format!("{}, {power}", projector.name()?)));
        let asked = asked(Part::Control, config.address());
        devices.push(Device::new(config.driver(), asked, answer));
    }
    if let Some(config) = &file.stage {
        let mut stage = config.open(&Simulated::default());
        let names: Vec<String> = stage.axes().iter().map(|axis| axis.name.clone()).collect();
        let places: Result<Vec<String>, DeviceError> = names
            .iter()
            .enumerate()
            .map(|(number, name)| Ok(format!("{name} at {}", stage.position(number)?)))
            .collect();
        let answer = places.map(|places| places.join(", "));
        let asked = asked(Part::Stage, config.address());
        devices.push(Device::new(config.driver(), asked, answer));
    }
    match (&file.hands, file.hands.program()) {
        (HandsConfig::Simulated {}, _) => devices.push(Device::fake("hands")),
        (HandsConfig::Program { program, .. }, Some(hands)) => {
            devices.push(Device::hands(program, hands.find(), &asked(Part::Hands, None)));
        }
        // A person is asked when it is time.
        _ => {}
    }
    devices
}
