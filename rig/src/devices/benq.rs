//! BenQ's RS-232 protocol, 8N1 at the speed that the projector's menu says.
//!
//! A command is CR `*key=value#` CR, a question has `?` for a value. Most models echo it, after a
//! `>`; then comes `*KEY=VALUE#`, with or without the star and the hash, as the model likes, or
//! `Illegal format`, `Unsupported item` or `Block item`.

use super::protocol_error::{digits, printable, trimmed};
use super::transition::Transition;
use super::{Fault, Link, Patience, PowerState, ProjectorControl, ProtocolError};
use crate::DeviceError;

/// What most models are delivered with.
pub const BAUD: u32 = 115_200;

/// A BenQ projector.
pub struct Benq {
    link: Link,
    transition: Transition,
}

impl Benq {
    /// The projector at the serial port `path`, which is not talked to yet.
    pub fn new(path: &str, baud: u32, patience: Patience) -> Self {
        Self::over(Link::serial(&format!("projector {path} (BenQ)"), path, baud, patience))
    }

    /// A projector at the other end of `link`.
    pub fn over(link: Link) -> Self {
        Self { link, transition: Transition::default() }
    }

    /// Sends `*key=value#` and returns the value that comes back.
    fn ask(&mut self, key: &str, value: &str) -> Result<String, DeviceError> {
        let command = format!("*{key}={value}#");
        self.link.retry(|link| {
            if !link.connect()? {
                link.discard()?;
            }
            link.send(format!("\r{command}\r").as_bytes())?;
            let device = link.device().to_owned();
            let deadline = link.deadline();
            loop {
                let line = link.receive(b"\r\n", deadline)?;
                match parse_line(&line, &command).map_err(|e| e.of(&device))? {
                    Line::Nothing => {}
                    Line::Value { key: found, value } if found.eq_ignore_ascii_case(key) => {
                        return Ok(value);
                    }
                    Line::Value { .. } => {
                        return Err(ProtocolError::new("the key that was sent", &line).of(&device));
                    }
                    Line::IllegalFormat => {
                        // It never is when it is sent, so it was disturbed on the way.
                        return Err(ProtocolError::new("a value", &line).of(&device));
                    }
                    Line::Unsupported => {
                        let reason = format!("this model has no {command}");
                        return Err(DeviceError::Unsupported { device, reason });
                    }
                    Line::Blocked => return Err(DeviceError::Busy { device }),
                }
            }
        })
    }

    fn order(&mut self, key: &str, value: &str) -> Result<(), DeviceError> {
        let found = self.ask(key, value)?;
        if found.eq_ignore_ascii_case(value) {
            return Ok(());
        }
        Err(ProtocolError::new("the value that was set", found.as_bytes()).of(self.link.device()))
    }
}

impl ProjectorControl for Benq {
    fn name(&mut self) -> Result<String, DeviceError> {
        match self.ask("modelname", "?") {
            Ok(model) => Ok(format!("BenQ {model}")),
            Err(DeviceError::Unsupported { device, .. } | DeviceError::Busy { device }) => {
                Ok(device)
            }
            Err(error) => Err(error),
        }
    }

    fn power_state(&mut self) -> Result<PowerState, DeviceError> {
        let value = match self.ask("pow", "?") {
            Ok(value) => value,
            // It blocks everything while it warms up or cools down.
            Err(DeviceError::Busy { device }) => {
                return self.transition.state().ok_or(DeviceError::Busy { device });
            }
            Err(error) => return Err(error),
        };
        match parse_power(&value).map_err(|e| e.of(self.link.device()))? {
            Power::On => Ok(self.transition.resolve(true)),
            Power::Off => Ok(self.transition.resolve(false)),
            Power::Cooling => Ok(PowerState::Cooling),
        }
    }

    fn set_power(&mut self, on: bool) -> Result<(), DeviceError> {
        self.order("pow", if on { "on" } else { "off" })?;
        self.transition.begin(on);
        Ok(())
    }

    fn select_input(&mut self, input: &str) -> Result<(), DeviceError> {
        if input.is_empty() || !input.bytes().all(|b| b.is_ascii_alphanumeric()) {
            let reason = format!("inputs are words like hdmi or rgb, not {input:?}");
            let device = self.link.device().to_owned();
            return Err(DeviceError::Unsupported { device, reason });
        }
        self.order("sour", input)
    }

    fn av_mute(&mut self) -> Result<Option<bool>, DeviceError> {
        let value = self.ask("blank", "?")?;
        parse_switch(&value).map(Some).map_err(|e| e.of(self.link.device()))
    }

    /// Blanks the picture; the sound is muted by another key, and of no use here.
    fn set_av_mute(&mut self, mute: bool) -> Result<(), DeviceError> {
        self.order("blank", if mute { "on" } else { "off" })
    }

    fn lamp_hours(&mut self) -> Result<Vec<u32>, DeviceError> {
        let value = self.ask("ltim", "?")?;
        parse_hours(&value).map(|hours| vec![hours]).map_err(|e| e.of(self.link.device()))
    }

    fn faults(&mut self) -> Result<Option<Vec<Fault>>, DeviceError> {
        Ok(None)
    }
}

/// One line from the projector.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Line {
    /// A prompt, or the command again.
    Nothing,
    /// What was set or asked for.
    Value {
        /// Of what.
        key: String,
        /// What it is now.
        value: String,
    },
    /// The command was garbled.
    IllegalFormat,
    /// The model cannot do that.
    Unsupported,
    /// Not now.
    Blocked,
}

/// Parses a line that came after `command` was sent.
///
/// # Errors
/// It is none of a BenQ projector.
pub fn parse_line(line: &[u8], command: &str) -> Result<Line, ProtocolError> {
    const EXPECTED: &str = "*KEY=VALUE#";
    let text = printable(EXPECTED, trimmed(line))?;
    let text = text.trim_start_matches('>').trim();
    // An order that is carried out comes back in capitals, its echo as it was sent.
    if text.is_empty() || text == command {
        return Ok(Line::Nothing);
    }
    let message = text.trim_matches(['*', '#']).trim();
    for (words, meaning) in [
        ("Illegal format", Line::IllegalFormat),
        ("Unsupported item", Line::Unsupported),
        ("Block item", Line::Blocked),
    ] {
        if message.eq_ignore_ascii_case(words) {
            return Ok(meaning);
        }
    }
    match message.split_once('=') {
        Some((key, value)) if !key.is_empty() && !value.is_empty() && !value.contains('#') => {
            Ok(Line::Value { key: key.to_owned(), value: value.to_owned() })
        }
        _ => Err(ProtocolError::new(EXPECTED, line)),
    }
}

/// The value of `pow`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// It makes light, or is about to.
    On,
    /// It does not, or is about to stop.
    Off,
    /// Some models say so.
    Cooling,
}

/// Parses the value of `pow`.
///
/// # Errors
/// It is no state that there is.
pub fn parse_power(value: &str) -> Result<Power, ProtocolError> {
    match value.to_ascii_uppercase().as_str() {
        "ON" => Ok(Power::On),
        "OFF" => Ok(Power::Off),
        "COOL DOWN" => Ok(Power::Cooling),
        _ => Err(ProtocolError::new("ON or OFF", value.as_bytes())),
    }
}

/// Parses the value of a switch.
///
/// # Errors
/// It is neither on nor off.
pub fn parse_switch(value: &str) -> Result<bool, ProtocolError> {
    match value.to_ascii_uppercase().as_str() {
        "ON" => Ok(true),
        "OFF" => Ok(false),
        _ => Err(ProtocolError::new("ON or OFF", value.as_bytes())),
    }
}

/// Parses the value of `ltim`.
///
/// # Errors
/// It is no number of hours.
pub fn parse_hours(value: &str) -> Result<u32, ProtocolError> {
    digits("lamp hours", value.as_bytes(), 6)
}

#[cfg(test)]
mod tests {
    use super::super::scripted::{Step, scripted};
    use super::*;
    use crate::DeviceErrorKind;

    #[test]
    fn echoes_are_no_answers() {
        let link = scripted(vec![
            Step::Expect(b"\r*pow=on#\r"),
            Step::Reply(b">*pow=on#\r\n*POW=ON#\r\n"),
            Step::Expect(b"\r*blank=?#\r"),
            Step::Reply(b"\r\nBLANK=OFF#\r\n"),
        ]);
        let mut projector = Benq::over(link);
        projector.set_power(true).unwrap();
        assert_eq!(projector.av_mute().unwrap(), Some(false));
    }

    #[test]
    fn refusals_are_told_apart() {
        let kind = |reply: &'static [u8]| {
            let link = scripted(vec![Step::Expect(b"\r*ltim=?#\r"), Step::Reply(reply)]);
            let patience = super::super::Patience { attempts: 1, ..link.patience() };
            let mut projector = Benq::over(link.with_patience(patience));
            projector.lamp_hours().unwrap_err().kind()
        };
        assert_eq!(kind(b">*ltim=?#\r\nUnsupported item\r\n"), DeviceErrorKind::Unsupported);
        assert_eq!(kind(b"Block item\r\n"), DeviceErrorKind::Busy);
        assert_eq!(kind(b"Illegal format\r\n"), DeviceErrorKind::Protocol);
        assert_eq!(kind(b"*LTIM=many#\r\n"), DeviceErrorKind::Protocol);
        assert_eq!(kind(b"*POW=ON#\r\n"), DeviceErrorKind::Protocol);
        assert_eq!(kind(b"\xff\xff\r\n"), DeviceErrorKind::Protocol);
    }
}
