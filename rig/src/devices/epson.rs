//! Epson's ESC/VP21 over a serial port: 9600 baud, 8N1.
//!
//! A command ends with CR; the projector answers with `NAME=value` and CR where something was
//! asked, with `ERR` and CR where it was not understood or is not possible now, and then, always,
//! with `:`. Some models hold the `:` back until the lamp burns, which takes up to 100 seconds.

use std::time::{Duration, Instant};

use super::protocol_error::{digits, printable, trimmed};
use super::{Fault, Link, Part, Patience, PowerState, ProjectorControl, ProtocolError, Severity};
use crate::DeviceError;

/// Epson's speed.
pub const BAUD: u32 = 9600;

/// Three attempts to light the lamp take up to 100 s, says the manual, some models 130 s.
const LONGEST_SWITCH: Duration = Duration::from_secs(140);

/// An Epson projector.
pub struct Epson {
    link: Link,
    /// It was told to go on or off and has not answered yet.
    switching: Option<(PowerState, Instant)>,
}

impl Epson {
    /// The projector at the serial port `path`, which is not talked to yet.
    pub fn new(path: &str, baud: u32, patience: Patience) -> Self {
        Self::over(Link::serial(&format!("projector {path} (Epson)"), path, baud, patience))
    }

    /// A projector at the other end of `link`.
    pub fn over(link: Link) -> Self {
        Self { link, switching: None }
    }

    /// Sends a command and returns what came before the `:`.
    fn ask(&mut self, command: &str) -> Result<Reply, DeviceError> {
        if self.still_switching()?.is_some() {
            return Err(DeviceError::Busy { device: self.link.device().to_owned() });
        }
        self.link.retry(|link| ask(link, command))
    }

    fn order(&mut self, command: &str) -> Result<(), DeviceError> {
        match self.ask(command)? {
            Reply::Done => Ok(()),
            Reply::Refused => Err(self.refused(command)),
            Reply::Value { name, value } => {
                let found = format!("{name}={value}");
                Err(ProtocolError::new(":", found.as_bytes()).of(self.link.device()))
            }
        }
    }

    /// The value of `question`.
    fn question(&mut self, question: &'static str) -> Result<String, DeviceError> {
        match self.ask(&format!("{question}?"))? {
            Reply::Value { name, value } if name.eq_ignore_ascii_case(question) => Ok(value),
            Reply::Refused => Err(self.refused(question)),
            other => {
                let found = format!("{other:?}");
                Err(ProtocolError::new("the value that was asked for", found.as_bytes())
                    .of(self.link.device()))
            }
        }
    }

    fn refused(&self, command: &str) -> DeviceError {
        let reason = format!("it answered ERR to {command}");
        DeviceError::Unsupported { device: self.link.device().to_owned(), reason }
    }

    /// Where it is going, if it has not said `:` yet.
    fn still_switching(&mut self) -> Result<Option<PowerState>, DeviceError> {
        let Some((state, since)) = self.switching else { return Ok(None) };
        if self.link.connect()? {
            // The `:` went to a connection that is no more. The projector answers again when it
            // is done, so its next answer is as good.
            self.switching = None;
            return Ok(None);
        }
        let soon = Instant::now() + Duration::from_millis(2);
        match self.link.receive(b":", soon) {
            Ok(_) => {
                self.switching = None;
                Ok(None)
            }
            Err(DeviceError::Timeout { .. }) if since.elapsed() < LONGEST_SWITCH => Ok(Some(state)),
            Err(error) => {
                self.switching = None;
                Err(error)
            }
        }
    }
}

fn ask(link: &mut Link, command: &str) -> Result<Reply, DeviceError> {
    if link.connect()? {
        // A lone CR ends what may have been left half sent, and brings a `:`.
        link.send(b"\r")?;
        let deadline = link.deadline();
        link.receive(b":", deadline)?;
    }
    link.discard()?;
    link.send(format!("{command}\r").as_bytes())?;
    receive(link, command.ends_with('?'))
}

/// The answer to a question, or to an order. A `:` alone answers no question: it was held back
/// until the lamp burned.
fn receive(link: &mut Link, question: bool) -> Result<Reply, DeviceError> {
    let deadline = link.deadline();
    loop {
        let part = link.receive(b":", deadline)?;
        // Networked models announce events between the answers.
        match parse_reply(&part).map_err(|e| e.of(link.device()))? {
            Some(Reply::Done) if question => {}
            Some(reply) => return Ok(reply),
            None => {}
        }
    }
}

impl ProjectorControl for Epson {
    fn name(&mut self) -> Result<String, DeviceError> {
        let device = self.link.device().to_owned();
        Ok(match self.question("SNO") {
            Ok(number) => format!("Epson, serial number {number}"),
            Err(DeviceError::Unsupported { .. } | DeviceError::Busy { .. }) => device,
            Err(error) => return Err(error),
        })
    }

    fn power_state(&mut self) -> Result<PowerState, DeviceError> {
        if let Some(state) = self.still_switching()? {
            return Ok(state);
        }
        let value = self.question("PWR")?;
        match parse_power(&value).map_err(|e| e.of(self.link.device()))? {
            Power::State(state) => Ok(state),
            Power::Abnormal => {
                let reason = "stand-by after a failure (PWR=05)".into();
                Err(DeviceError::Fault { device: self.link.device().to_owned(), reason })
            }
        }
    }

    fn set_power(&mut self, on: bool) -> Result<(), DeviceError> {
        let (command, state) =
            if on { ("PWR ON", PowerState::Warming) } else { ("PWR OFF", PowerState::Cooling) };
        if self.still_switching()?.is_some() {
            return Err(DeviceError::Busy { device: self.link.device().to_owned() });
        }
        // Anything that may be wrong with the connection shows here, where it can be repeated.
        self.question("PWR")?;
        self.link.send(format!("{command}\r").as_bytes())?;
        match receive(&mut self.link, false) {
            Ok(Reply::Refused) => Err(self.refused(command)),
            Ok(_) => Ok(()),
            // It says `:` when the lamp burns.
            Err(DeviceError::Timeout { .. }) => {
                self.switching = Some((state, Instant::now()));
                Ok(())
            }
            Err(error) => Err(error),
        }
    }

    fn select_input(&mut self, input: &str) -> Result<(), DeviceError> {
        if input.len() != 2 || !input.bytes().all(|b| b.is_ascii_hexdigit()) {
            let reason = format!("inputs are two hexadecimal digits, not {input:?}");
            let device = self.link.device().to_owned();
            return Err(DeviceError::Unsupported { device, reason });
        }
        self.order(&format!("SOURCE {input}"))
    }

    fn av_mute(&mut self) -> Result<Option<bool>, DeviceError> {
        let value = self.question("MUTE")?;
        parse_mute(&value).map(Some).map_err(|e| e.of(self.link.device()))
    }

    fn set_av_mute(&mut self, mute: bool) -> Result<(), DeviceError> {
        self.order(if mute { "MUTE ON" } else { "MUTE OFF" })
    }

    fn lamp_hours(&mut self) -> Result<Vec<u32>, DeviceError> {
        let value = self.question("LAMP")?;
        parse_hours(&value).map_err(|e| e.of(self.link.device()))
    }

    fn faults(&mut self) -> Result<Option<Vec<Fault>>, DeviceError> {
        let value = self.question("ERR")?;
        parse_error(&value).map(Some).map_err(|e| e.of(self.link.device()))
    }
}

/// What comes before a `:`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// Nothing more: an order was carried out.
    Done,
    /// `ERR`.
    Refused,
    /// `NAME=value`.
    Value {
        /// What was asked for.
        name: String,
        /// What it is.
        value: String,
    },
}

/// Parses what came before a `:`; `None` for an event that nobody asked for.
///
/// # Errors
/// It is no answer.
pub fn parse_reply(bytes: &[u8]) -> Result<Option<Reply>, ProtocolError> {
    const EXPECTED: &str = "NAME=value, ERR or nothing, before the :";
    let text = printable(EXPECTED, trimmed(bytes))?;
    if text.is_empty() {
        return Ok(Some(Reply::Done));
    }
    if text == "ERR" {
        return Ok(Some(Reply::Refused));
    }
    match text.split_once('=') {
        Some(("IMEVENT", _)) => Ok(None),
        Some((name, value))
            if !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric()) =>
        {
            Ok(Some(Reply::Value { name: name.to_owned(), value: value.to_owned() }))
        }
        _ => Err(ProtocolError::new(EXPECTED, bytes)),
    }
}

/// The value of `PWR?`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// As it should be.
    State(PowerState),
    /// 05: it went to stand-by by itself.
    Abnormal,
}

/// Parses the value of `PWR?`.
///
/// # Errors
/// It is no state that there is.
pub fn parse_power(value: &str) -> Result<Power, ProtocolError> {
    Ok(Power::State(match value {
        // 04: stand-by that listens to the network; 09: stand-by that passes sound on.
        "00" | "04" | "09" => PowerState::Off,
        "01" => PowerState::On,
        "02" => PowerState::Warming,
        "03" => PowerState::Cooling,
        "05" => return Ok(Power::Abnormal),
        _ => return Err(ProtocolError::new("a power state, 00 to 05 or 09", value.as_bytes())),
    }))
}

/// Parses the value of `MUTE?`.
///
/// # Errors
/// It is neither ON nor OFF.
pub fn parse_mute(value: &str) -> Result<bool, ProtocolError> {
    match value {
        "ON" => Ok(true),
        "OFF" => Ok(false),
        _ => Err(ProtocolError::new("ON or OFF", value.as_bytes())),
    }
}

/// Parses the value of `LAMP?`: the hours of each lamp.
///
/// # Errors
/// It is no list of numbers.
pub fn parse_hours(value: &str) -> Result<Vec<u32>, ProtocolError> {
    // Of several lamps; an error shows all of them.
    let wrong = |_| ProtocolError::new("lamp hours", value.as_bytes());
    value.split(' ').map(|w| digits("lamp hours", w.as_bytes(), 6).map_err(wrong)).collect()
}

/// Parses the value of `ERR?`: 00 for nothing, else what is wrong.
///
/// # Errors
/// It is no two hexadecimal digits.
pub fn parse_error(value: &str) -> Result<Vec<Fault>, ProtocolError> {
    let wrong = || ProtocolError::new("an error code of two hexadecimal digits", value.as_bytes());
    if value.len() != 2 || !value.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Err(wrong());
    }
    let part = match u8::from_str_radix(value, 16).map_err(|_| wrong())? {
        0x00 => return Ok(Vec::new()),
        0x01 => Part::Fan,
        // The lamp did not light, failed, or its ballast did.
        0x03 | 0x06 | 0x0E => Part::Lamp,
        // Too hot, too little air, cooling that failed.
        0x04 | 0x0C | 0x0D | 0x10 | 0x11 => Part::Temperature,
        0x07 => Part::Cover,
        _ => Part::Other,
    };
    Ok(vec![Fault { part, severity: Severity::Error }])
}

#[cfg(test)]
mod tests {
    use super::super::scripted::{Step, scripted};
    use super::*;

    /// A projector that has been greeted and plays the steps then.
    fn greeted(then: impl IntoIterator<Item = Step>) -> Epson {
        let greeting = [Step::Expect(b"\r"), Step::Reply(b":")];
        Epson::over(scripted(greeting.into_iter().chain(then).collect()))
    }

    /// One in stand-by that is switched on.
    fn switched_on(then: impl IntoIterator<Item = Step>) -> Epson {
        let order = [Step::Expect(b"PWR?\r"), Step::Reply(b"PWR=00\r:"), Step::Expect(b"PWR ON\r")];
        let mut projector = greeted(order.into_iter().chain(then));
        projector.set_power(true).unwrap();
        projector
    }

    #[test]
    fn a_colon_that_is_held_back_is_warming_up() {
        let mut projector = switched_on([]);
        assert_eq!(projector.power_state().unwrap(), PowerState::Warming);
    }

    #[test]
    fn it_is_on_once_the_colon_is_there() {
        let mut projector = switched_on([
            Step::Reply(b":"),
            Step::Expect(b"PWR?\r"),
            Step::Reply(b"IMEVENT=0001 02 00000002 00000000 T1 F1\r:PWR=01\r:"),
        ]);
        assert_eq!(projector.power_state().unwrap(), PowerState::On);
    }

    #[test]
    fn a_late_colon_answers_no_question() {
        let mut projector =
            greeted([Step::Expect(b"LAMP?\r"), Step::Reply(b":"), Step::Reply(b"LAMP=77\r:")]);
        assert_eq!(projector.lamp_hours().unwrap(), [77]);
    }

    #[test]
    fn replies_mean_what_the_manual_says() {
        assert_eq!(parse_reply(b"ERR\r").unwrap(), Some(Reply::Refused));
        assert_eq!(parse_reply(b"\r").unwrap(), Some(Reply::Done));
        assert!(parse_reply(b"PWR\xff=01").is_err());
        assert!(parse_reply(b"=01").is_err());
        assert_eq!(parse_power("05").unwrap(), Power::Abnormal);
        assert!(parse_power("08").is_err());
        assert_eq!(parse_hours("1234").unwrap(), [1234]);
        assert!(parse_hours("-1").is_err());
        let lamp = Fault { part: Part::Lamp, severity: Severity::Error };
        assert_eq!(parse_error("03").unwrap(), [lamp]);
        assert_eq!(parse_error("00").unwrap(), []);
        assert!(parse_error("+1").is_err());
    }
}
