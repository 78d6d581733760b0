//! An Optoma projector.

use rig::devices::{Part, PowerState};

use super::{Protocol, SimulatedProjector};

/// Answers as the tables of Optoma's manuals say, and announces what it does.
pub struct OptomaEmulator {
    projector: SimulatedProjector,
    line: Vec<u8>,
    /// What it announced last.
    announced: PowerState,
    lamp_announced: bool,
}

impl OptomaEmulator {
    /// `projector` behind Optoma's protocol.
    pub fn new(projector: SimulatedProjector) -> Self {
        let announced = projector.power();
        Self { projector, line: Vec::new(), announced, lamp_announced: false }
    }

    fn answer(&self, line: &[u8]) -> Vec<u8> {
        let line = String::from_utf8_lossy(line);
        let Some(command) = line.trim().strip_prefix('~').and_then(|l| l.get(2..)) else {
            return Vec::new();
        };
        let projector = &self.projector;
        let on = projector.power() == PowerState::On;
        let done = |ok: bool| if ok { "P" } else { "F" }.to_owned();
        match command.split_once(' ') {
            Some(("00", switch @ ("0" | "1" | "2"))) => done(projector.switch(switch == "1")),
            Some(("124", "1")) => format!("OK{}\r", u8::from(on)),
            Some(("108", "1")) => format!("OK{:05}\r", projector.hours()),
            Some(("150", "1")) => {
                format!("OK{}{:04}0600C01\r", u8::from(on), projector.hours() % 10_000)
            }
            Some(("151", "1")) => "OK2\r".to_owned(),
            Some(("02", mute @ ("0" | "1" | "2"))) => {
                let ready = projector.ready();
                if ready {
                    projector.set_mute(mute == "1");
                }
                done(ready)
            }
            Some(("12", input @ ("1" | "15" | "5" | "8"))) => {
                let ready = projector.ready();
                if ready {
                    projector.set_input(input);
                }
                done(ready)
            }
            _ => done(false),
        }
        .into_bytes()
    }
}

impl Protocol for OptomaEmulator {
    fn receive(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        super::wire::lines(&mut self.line, bytes, b"\r").iter().map(|l| self.answer(l)).collect()
    }

    fn tick(&mut self) -> Vec<u8> {
        let mut news = String::new();
        let lamp = self.projector.reported().iter().any(|f| f.part == Part::Lamp);
        if lamp && !self.lamp_announced {
            news += "INFO4\r";
        }
        self.lamp_announced = lamp;
        let power = self.projector.power();
        if power != self.announced {
            self.announced = power;
            news += match power {
                PowerState::Off => "INFO0\r",
                PowerState::Warming => "INFO1\r",
                PowerState::Cooling => "INFO2\r",
                PowerState::On => "",
            };
        }
        news.into_bytes()
    }
}
