//! A chain of Zaber devices of one axis each.

use super::{Protocol, SimulatedStage, StageFailure};

/// Answers as Zaber's ASCII manual says. Axis 0 of the stage is device 1, axis 1 device 2, …
pub struct ZaberEmulator {
    stage: SimulatedStage,
    /// Microsteps a mm or degree.
    steps: f64,
    homed: bool,
    line: Vec<u8>,
}

impl ZaberEmulator {
    /// `stage`, one microstep of which is `step` mm or degrees; it does not know where it is until
    /// it has been homed.
    pub fn new(stage: SimulatedStage, step: f64) -> Self {
        Self { stage, steps: 1.0 / step, homed: false, line: Vec::new() }
    }

    fn answer(&mut self, line: &[u8]) -> Vec<u8> {
        let line = String::from_utf8_lossy(line).trim().to_owned();
        let Some(body) = line.strip_prefix('/') else { return Vec::new() };
        let body = match body.rsplit_once(':') {
            Some((body, sum)) => {
                let total = body.bytes().fold(0u8, |sum, b| sum.wrapping_add(b));
                // What was disturbed on the way is not answered.
                if u8::from_str_radix(sum, 16).map(|sum| sum.wrapping_add(total)) != Ok(0) {
                    return Vec::new();
                }
                body
            }
            None => body,
        };
        let mut words: Vec<&str> = body.split_whitespace().collect();
        let numbers = words.iter().take(3).take_while(|w| w.parse::<u8>().is_ok()).count();
        let rest = words.split_off(numbers);
        let number = |i: usize| words.get(i).and_then(|w| w.parse::<u8>().ok());
        let (device, axis) = (number(0).unwrap_or(0), number(1).unwrap_or(0));
        let id = number(2).map_or(String::new(), |id| format!("{id:02} "));
        let mut replies = String::new();
        for target in 1..=u8::try_from(self.stage.count()).unwrap_or(u8::MAX) {
            if device == target || device == 0 {
                let reply = self.reply(target, axis, &rest);
                replies += &format!("@{target:02} {axis} {id}{reply}\r\n");
            }
        }
        replies.into_bytes()
    }

    fn reply(&mut self, device: u8, axis: u8, words: &[&str]) -> String {
        let number = usize::from(device.saturating_sub(1));
        let (accepted, data) = match (axis, words) {
            (2.., _) => (false, "BADAXIS".to_owned()),
            (_, []) => (true, "0".to_owned()),
            (_, ["get", "pos"]) => (true, format!("{:.0}", self.stage.at(number) * self.steps)),
            (_, ["get", "version"]) => (true, "7.38".to_owned()),
            (_, ["get", "device.id"]) => (true, "50105".to_owned()),
            (_, ["get", "system.axiscount"]) => (true, "1".to_owned()),
            (_, ["move", kind @ ("abs" | "rel"), steps]) => match steps.parse::<f64>() {
                Ok(steps) => {
                    let from = if *kind == "rel" { self.stage.at(number) } else { 0.0 };
                    self.stage.go(number, from + steps / self.steps);
                    (true, "0".to_owned())
                }
                Err(_) => (false, "BADDATA".to_owned()),
            },
            (_, ["home"]) => {
                self.homed = true;
                self.stage.mend();
                self.stage.go(number, 0.0);
                (true, "0".to_owned())
            }
            (_, ["stop" | "estop"]) => {
                self.stage.rest();
                (true, "0".to_owned())
            }
            (_, ["warnings"]) => (true, "00".to_owned()),
            (_, ["warnings", "clear"]) => {
                let warning = self.warning();
                self.stage.mend();
                let count = u8::from(warning != "--");
                (true, if count == 0 { "00".into() } else { format!("01 {warning}") })
            }
            _ => (false, "BADCOMMAND".to_owned()),
        };
        let flag = if accepted { "OK" } else { "RJ" };
        let status = if self.stage.moving(number) { "BUSY" } else { "IDLE" };
        format!("{flag} {status} {} {data}", self.warning())
    }

    fn warning(&self) -> &'static str {
        match self.stage.failed() {
            Some(StageFailure::Stall) => "FS",
            Some(StageFailure::HitLimit) => "FE",
            None if !self.homed => "WR",
            None => "--",
        }
    }
}

impl Protocol for ZaberEmulator {
    fn receive(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        super::wire::lines(&mut self.line, bytes, b"\r\n").iter().map(|l| self.answer(l)).collect()
    }
}
