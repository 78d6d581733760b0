//! A PJLink class 1 projector.

use rig::devices::{Part, PowerState, Severity};

use super::{Protocol, SimulatedProjector};

/// Answers as the PJLink specification says, with a password or without.
pub struct PjlinkEmulator {
    projector: SimulatedProjector,
    password: Option<String>,
    /// What the first command of this connection has to begin with.
    digest: Option<String>,
    connections: u32,
    line: Vec<u8>,
}

const INPUTS: [&str; 3] = ["11", "31", "32"];

impl PjlinkEmulator {
    /// `projector` behind PJLink.
    pub fn new(projector: SimulatedProjector, password: Option<&str>) -> Self {
        let password = password.map(str::to_owned);
        Self { projector, password, digest: None, connections: 0, line: Vec::new() }
    }

    fn answer(&mut self, line: &[u8]) -> Vec<u8> {
        let line = String::from_utf8_lossy(line).into_owned();
        let mut command = line.as_str();
        if let Some(digest) = self.digest.take() {
            match command.strip_prefix(digest.as_str()) {
                Some(rest) => command = rest,
                None => {
                    self.digest = Some(digest);
                    return b"PJLINK ERRA\r".to_vec();
                }
            }
        }
        let Some((name, parameter)) = command.strip_prefix("%1").and_then(|c| c.split_once(' '))
        else {
            return Vec::new();
        };
        let name = name.to_ascii_uppercase();
        format!("%1{name}={}\r", self.value(&name, parameter)).into_bytes()
    }

    fn value(&self, name: &str, parameter: &str) -> String {
        let projector = &self.projector;
        match (name, parameter) {
            ("POWR", "?") => match projector.power() {
                PowerState::Off => "0",
                PowerState::On => "1",
                PowerState::Cooling => "2",
                PowerState::Warming => "3",
            }
            .into(),
            ("POWR", "0" | "1") => {
                if projector.switch(parameter == "1") { "OK" } else { "ERR3" }.into()
            }
            // A projector in stand-by has neither a picture to mute nor an input to select.
            ("AVMT" | "INPT", _) if !projector.ready() => "ERR3".into(),
            ("AVMT", "?") => if projector.mute() { "31" } else { "30" }.into(),
            ("AVMT", "11" | "31" | "10" | "30") => {
                projector.set_mute(parameter.ends_with('1'));
                "OK".into()
            }
            ("INPT", "?") => {
                let input = projector.input();
                if input.is_empty() { "11".into() } else { input }
            }
            ("INPT", input) if INPUTS.contains(&input) => {
                projector.set_input(input);
                "OK".into()
            }
            ("ERST", "?") => self.errors(),
            ("LAMP", "?") => {
                let lit = projector.power() == PowerState::On;
                format!("{} {}", projector.hours(), u8::from(lit))
            }
            ("INST", "?") => INPUTS.join(" "),
            ("NAME", "?") => "rig".into(),
            ("INF1", "?") => "Diaphane".into(),
            ("INF2", "?") => "simulated projector".into(),
            ("INFO", "?") => String::new(),
            ("CLSS", "?") => "1".into(),
            ("POWR" | "AVMT" | "INPT", _) => "ERR2".into(),
            _ => "ERR1".into(),
        }
    }

    fn errors(&self) -> String {
        const PARTS: [Part; 6] =
            [Part::Fan, Part::Lamp, Part::Temperature, Part::Cover, Part::Filter, Part::Other];
        let faults = self.projector.reported();
        let digit = |part| {
            let of_part = faults.iter().filter(|f| f.part == part);
            of_part.fold('0', |digit, fault| match fault.severity {
                Severity::Error => '2',
                Severity::Warning => digit.max('1'),
            })
        };
        PARTS.map(digit).iter().collect()
    }
}

impl Protocol for PjlinkEmulator {
    fn connected(&mut self) -> Vec<u8> {
        self.line.clear();
        let Some(password) = &self.password else { return b"PJLINK 0\r".to_vec() };
        // Another one for each connection, the same in each run.
        self.connections += 1;
        let token = format!("{:08x}", 0x498e_4a67_u32.wrapping_mul(self.connections));
        self.digest = Some(format!("{:x}", md5::compute(format!("{token}{password}"))));
        format!("PJLINK 1 {token}\r").into_bytes()
    }

    fn receive(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        super::wire::lines(&mut self.line, bytes, b"\r").iter().map(|l| self.answer(l)).collect()
    }
}
