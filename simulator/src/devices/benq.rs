//! A BenQ projector.

use rig::devices::PowerState;

use super::{Protocol, SimulatedProjector};

/// Answers as BenQ's command guides say, echo and prompt included.
pub struct BenqEmulator {
    projector: SimulatedProjector,
    line: Vec<u8>,
}

impl BenqEmulator {
    /// `projector` behind BenQ's protocol.
    pub fn new(projector: SimulatedProjector) -> Self {
        Self { projector, line: Vec::new() }
    }

    fn answer(&self, line: &[u8]) -> Vec<u8> {
        let line = String::from_utf8_lossy(line);
        let line = line.trim();
        if line.is_empty() {
            return Vec::new();
        }
        let command = line.strip_prefix('*').and_then(|l| l.strip_suffix('#'));
        let reply = match command.and_then(|c| c.split_once('=')) {
            Some((key, value)) => {
                self.value(&key.to_ascii_lowercase(), &value.to_ascii_lowercase())
            }
            None => "Illegal format".into(),
        };
        format!(">{line}\r\n{reply}\r\n").into_bytes()
    }

    fn value(&self, key: &str, value: &str) -> String {
        let projector = &self.projector;
        let blocked = || "Block item".to_owned();
        let power = projector.power();
        if matches!(power, PowerState::Warming | PowerState::Cooling) {
            return blocked();
        }
        let result = match (key, value) {
            ("pow", "?") => if power == PowerState::On { "on" } else { "off" }.to_owned(),
            ("pow", "on" | "off") => {
                if !projector.switch(value == "on") {
                    return blocked();
                }
                value.to_owned()
            }
            ("ltim", "?") => projector.hours().to_string(),
            ("modelname", "?") => "simulated".to_owned(),
            ("blank" | "sour", _) if !projector.ready() => return blocked(),
            ("blank", "?") => if projector.mute() { "on" } else { "off" }.to_owned(),
            ("blank", "on" | "off") => {
                projector.set_mute(value == "on");
                value.to_owned()
            }
            ("sour", "?") => projector.input(),
            ("sour", "hdmi" | "hdmi2" | "rgb") => {
                projector.set_input(value);
                value.to_owned()
            }
            ("pow" | "blank", _) => return "Illegal format".into(),
            _ => return "Unsupported item".into(),
        };
        format!("*{}={}#", key.to_ascii_uppercase(), result.to_ascii_uppercase())
    }
}

impl Protocol for BenqEmulator {
    fn receive(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        super::wire::lines(&mut self.line, bytes, b"\r").iter().map(|l| self.answer(l)).collect()
    }
}
