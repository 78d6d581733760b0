//! `diaphane rig list`: what is connected, and what is in the way.

use super::{Simulated, camera, permission};
use crate::Failure;
use crate::output::Done;
use ::rig::devices::{SerialPort, find_monitor, list_monitors, scan_serial_ports};
use ::rig::{Address, DeviceError, DeviceErrorKind, DisplayConfig, RigFile};
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;

/// What is connected, and what is in the way
///
/// With a rig file: each of its devices, asked for a sign of life. Without one: the cameras that are
/// found, the monitors and the serial ports of this machine; each port is opened for a moment, which
/// restarts boards with GRBL.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  diaphane rig list\n  diaphane rig list rig.toml")]
pub(crate) struct Args {
    /// Rig file
    rig: Option<PathBuf>,
}

#[derive(Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum State {
    Found,
    /// In software.
    Fake,
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
            _ => Self::Trouble,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Found => "found",
            Self::Fake => "fake",
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
        matches!(self, Self::Found | Self::Fake)
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

    fn new(
        part: &'static str,
        driver: &'static str,
        address: Option<Address>,
        answer: Result<String, DeviceError>,
    ) -> Self {
        let (state, found, advice) = match answer {
            Ok(found) if address.is_none() => (State::Fake, found, None),
            Ok(found) => (State::Found, found, None),
            Err(error) => {
                let advice = permission::advice(error.kind(), address.as_ref());
                (State::of(&error), error.to_string(), advice)
            }
        };
        let address = address.map(|address| address.to_string());
        Self { part, driver: Some(driver), address, state, found, advice }
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
                let advice = permission::advice(error.kind(), Some(&Address::Monitor("".into())));
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
            let address = Address::Serial(port.path.clone());
            advice = permission::advice(problem.kind(), Some(&address));
            found = format!("{found}; {problem}");
        }
        let address = Some(port.path);
        Self { part: "serial port", driver: None, address, state, found, advice }
    }
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let devices = match &args.rig {
        Some(path) => ask(&RigFile::read(path)?),
        None => {
            let cameras = camera::list().into_iter().map(Device::camera);
            let ports = scan_serial_ports().into_iter().map(Device::port);
            cameras.chain(Device::monitors()).chain(ports).collect()
        }
    };
    let mut text = String::new();
    for device in &devices {
        let name = device.driver.map_or(String::new(), |driver| format!(" ({driver})"));
        let part = format!("{}{name}", device.part);
        let address = device.address.as_deref().unwrap_or("-");
        text += &format!("{:14} {part:30} {address:16} {}\n", device.state.words(), device.found);
        for line in device.advice.iter().flat_map(|advice| advice.lines()) {
            text += &format!("{:15}{line}\n", "");
        }
    }
    if args.rig.is_none() && devices.iter().all(|device| device.part != "camera") {
        text += "no cameras\n";
    }
    if args.rig.is_none() && devices.iter().all(|device| device.part != "serial port") {
        text += "no serial ports; projectors on the network are found by their address alone: write a rig file, docs/devices.md has examples";
    }
    let bad = devices.iter().filter(|device| !device.state.good()).count();
    let json = json!({ "ready": bad == 0, "devices": devices });
    // A list of ports is complete whatever is wrong with them; a rig is not.
    if bad > 0 && args.rig.is_some() {
        eprint!("{text}");
        return Err(Failure {
            error: format!("{bad} of {} devices cannot be used", devices.len()),
            hint: devices.iter().find_map(|device| device.advice.clone()),
            code: 1,
            details: Some(json),
        });
    }
    Ok(Done::new(json, text.trim_end()))
}

fn ask(file: &RigFile) -> Vec<Device> {
    let mut devices = Vec::new();
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
            devices.push(Device::new("projector", config.driver(), config.address(), answer));
        }
        None => {}
    }
    if let Some(config) = &file.projector.control {
        let mut projector = config.open(&Simulated::default());
        let answer =
            projector.power_state().and_then(|power| Ok(format!("{}, {power}", projector.name()?)));
        devices.push(Device::new("projector control", config.driver(), config.address(), answer));
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
        devices.push(Device::new("stage", config.driver(), config.address(), answer));
    }
    devices
}
