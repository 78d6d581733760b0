//! An Epson projector.

use rig::devices::{Part, PowerState};

use super::{Protocol, SimulatedProjector};

/// When a model says `:` after it was switched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prompt {
    /// At once; then it can be asked how far it is.
    AtOnce,
    /// When the lamp burns, or is cold. Until then it says nothing.
    WhenDone,
}

/// Answers as Epson's ESC/VP21 guide says.
pub struct EpsonEmulator {
    projector: SimulatedProjector,
    prompt: Prompt,
    /// A `:` is due when it has settled.
    owed: bool,
    line: Vec<u8>,
}

impl EpsonEmulator {
    /// `projector` behind ESC/VP21.
    pub fn new(projector: SimulatedProjector, prompt: Prompt) -> Self {
        Self { projector, prompt, owed: false, line: Vec::new() }
    }

    fn answer(&mut self, line: &[u8]) -> Vec<u8> {
        if self.owed {
            return Vec::new();
        }
        let line = String::from_utf8_lossy(line).trim().to_owned();
        let projector = &self.projector;
        let reply = match line.as_str() {
            "" => String::new(),
            "PWR?" => {
                let broken = projector.reported().iter().any(|f| f.part == Part::Lamp);
                let state = match projector.power() {
                    PowerState::Off if broken => "05",
                    PowerState::Off => "00",
                    PowerState::On => "01",
                    PowerState::Warming => "02",
                    PowerState::Cooling => "03",
                };
                format!("PWR={state}\r")
            }
            "PWR ON" | "PWR OFF" => {
                if projector.switch(line == "PWR ON") {
                    self.owed = self.prompt == Prompt::WhenDone;
                    if self.owed {
                        return Vec::new();
                    }
                    String::new()
                } else {
                    "ERR\r".into()
                }
            }
            "LAMP?" => format!("LAMP={}\r", projector.hours()),
            "ERR?" => {
                let faults = projector.reported();
                let code = match faults.first().map(|f| f.part) {
                    None => "00",
                    Some(Part::Fan) => "01",
                    Some(Part::Lamp) => "06",
                    Some(Part::Temperature) => "04",
                    Some(Part::Cover) => "07",
                    Some(Part::Filter | Part::Other) => "0B",
                };
                format!("ERR={code}\r")
            }
            "SNO?" => "SNO=SIM0000001\r".into(),
            // The rest needs a picture.
            _ if !projector.ready() => "ERR\r".into(),
            "MUTE?" => format!("MUTE={}\r", if projector.mute() { "ON" } else { "OFF" }),
            "MUTE ON" | "MUTE OFF" => {
                projector.set_mute(line == "MUTE ON");
                String::new()
            }
            "SOURCE 30" | "SOURCE 11" => {
                projector.set_input(line.trim_start_matches("SOURCE "));
                String::new()
            }
            _ => "ERR\r".into(),
        };
        format!("{reply}:").into_bytes()
    }
}

impl Protocol for EpsonEmulator {
    fn receive(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        super::wire::lines(&mut self.line, bytes, b"\r").iter().map(|l| self.answer(l)).collect()
    }

    fn tick(&mut self) -> Vec<u8> {
        let settled = matches!(self.projector.power(), PowerState::On | PowerState::Off);
        if self.owed && settled {
            self.owed = false;
            return b":".to_vec();
        }
        Vec::new()
    }
}
