//! PJLink class 1: projectors of most makers, over TCP port 4352.
//!
//! Commands are `%1` + four letters + space + parameter + CR. On connection the projector greets
//! with `PJLINK 0`, or with `PJLINK 1` and eight characters; then the first command is preceded
//! by the MD5 of these and the password. It hangs up after half a minute of silence, which is
//! no fault: the link opens again.

use super::protocol_error::{printable, trimmed};
use super::{Fault, Link, Part, Patience, PowerState, ProjectorControl, ProtocolError, Severity};
use crate::DeviceError;

/// PJLink's own TCP port.
pub const PORT: u16 = 4352;

/// A PJLink projector.
pub struct Pjlink {
    link: Link,
    password: Option<String>,
}

impl Pjlink {
    /// The projector at `host`, which is not talked to yet.
    pub fn new(host: &str, port: u16, password: Option<String>, patience: Patience) -> Self {
        let device = format!("projector {host}:{port} (PJLink)");
        Self::over(Link::tcp(&device, host, port, patience), password)
    }

    /// A projector at the other end of `link`.
    pub fn over(link: Link, password: Option<String>) -> Self {
        Self { link, password }
    }

    /// Sends a command and returns its value, once more where that may help.
    fn ask(&mut self, command: &[u8; 4], parameter: &str) -> Result<Vec<u8>, DeviceError> {
        let password = self.password.as_deref();
        self.link.retry(|link| ask(link, password, command, parameter))
    }

    fn order(&mut self, command: &[u8; 4], parameter: &str) -> Result<(), DeviceError> {
        let value = self.ask(command, parameter)?;
        if value.eq_ignore_ascii_case(b"OK") {
            return Ok(());
        }
        Err(ProtocolError::new("OK", &value).of(self.link.device()))
    }

    fn of<T>(&self, parsed: Result<T, ProtocolError>) -> Result<T, DeviceError> {
        parsed.map_err(|error| error.of(self.link.device()))
    }
}

fn ask(
    link: &mut Link,
    password: Option<&str>,
    command: &[u8; 4],
    parameter: &str,
) -> Result<Vec<u8>, DeviceError> {
    let device = link.device().to_owned();
    let of = |error: ProtocolError| error.of(&device);
    let mut message = Vec::new();
    if link.connect()? {
        let deadline = link.deadline();
        match parse_greeting(&link.receive(b"\r", deadline)?).map_err(of)? {
            Greeting::Open => {}
            Greeting::Refused => return Err(wrong_password(&device)),
            Greeting::Locked(token) => {
                let Some(password) = password else {
                    let reason = "it wants a password, and the rig file has none".into();
                    return Err(DeviceError::Declined { device, reason });
                };
                let secret = [token.as_slice(), password.as_bytes()].concat();
                message = format!("{:x}", md5::compute(secret)).into_bytes();
            }
        }
    } else {
        link.discard()?;
    }
    message.extend(b"%1");
    message.extend(command);
    message.push(b' ');
    message.extend(parameter.as_bytes());
    message.push(b'\r');
    link.send(&message)?;
    let deadline = link.deadline();
    let reply = link.receive(b"\r", deadline)?;
    match parse_reply(&reply, command).map_err(of)? {
        Reply::Value(value) => Ok(value),
        Reply::WrongPassword => {
            // It goes on speaking to nobody on this connection.
            link.disconnect();
            Err(wrong_password(&device))
        }
        Reply::Undefined => {
            let reason = format!("it does not know the command {}", command.escape_ascii());
            Err(DeviceError::Unsupported { device, reason })
        }
        Reply::OutOfParameter => {
            let reason = format!("it has no {} {parameter}", command.escape_ascii());
            Err(DeviceError::Unsupported { device, reason })
        }
        Reply::Unavailable => Err(DeviceError::Busy { device }),
        Reply::Failure => {
            Err(DeviceError::Fault { device, reason: "it reports a failure (ERR4)".into() })
        }
    }
}

fn wrong_password(device: &str) -> DeviceError {
    DeviceError::Declined { device: device.to_owned(), reason: "wrong password".into() }
}

impl ProjectorControl for Pjlink {
    fn name(&mut self) -> Result<String, DeviceError> {
        let mut parts = Vec::new();
        for command in [b"INF1", b"INF2"] {
            let value = self.ask(command, "?")?;
            parts.push(String::from_utf8_lossy(trimmed(&value)).into_owned());
        }
        let name = parts.join(" ").trim().to_owned();
        Ok(if name.is_empty() { self.link.device().to_owned() } else { name })
    }

    fn power_state(&mut self) -> Result<PowerState, DeviceError> {
        let value = self.ask(b"POWR", "?")?;
        self.of(parse_power(&value))
    }

    fn set_power(&mut self, on: bool) -> Result<(), DeviceError> {
        self.order(b"POWR", if on { "1" } else { "0" })
    }

    fn select_input(&mut self, input: &str) -> Result<(), DeviceError> {
        if !matches!(input.as_bytes(), [b'1'..=b'5', b'1'..=b'9']) {
            let reason =
                format!("inputs are two digits, a kind (1 to 5) and a number, not {input:?}");
            let device = self.link.device().to_owned();
            return Err(DeviceError::Unsupported { device, reason });
        }
        self.order(b"INPT", input)
    }

    fn av_mute(&mut self) -> Result<Option<bool>, DeviceError> {
        let value = self.ask(b"AVMT", "?")?;
        self.of(parse_mute(&value)).map(Some)
    }

    fn set_av_mute(&mut self, mute: bool) -> Result<(), DeviceError> {
        self.order(b"AVMT", if mute { "31" } else { "30" })
    }

    fn lamp_hours(&mut self) -> Result<Vec<u32>, DeviceError> {
        match self.ask(b"LAMP", "?") {
            Ok(value) => self.of(parse_lamps(&value)),
            // A laser has no lamp.
            Err(DeviceError::Unsupported { .. }) => Ok(Vec::new()),
            Err(error) => Err(error),
        }
    }

    fn faults(&mut self) -> Result<Option<Vec<Fault>>, DeviceError> {
        let value = self.ask(b"ERST", "?")?;
        self.of(parse_errors(&value)).map(Some)
    }
}

/// What a projector says first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Greeting {
    /// `PJLINK 0`: no password.
    Open,
    /// `PJLINK 1 token`: the first command has to be preceded by the MD5 of token and password.
    Locked(Vec<u8>),
    /// `PJLINK ERRA`.
    Refused,
}

/// Parses the first line of a connection, without its CR.
///
/// # Errors
/// It is none.
pub fn parse_greeting(line: &[u8]) -> Result<Greeting, ProtocolError> {
    let wrong = || ProtocolError::new("a PJLink greeting", line);
    let text = printable("a PJLink greeting", trimmed(line))?.to_ascii_uppercase();
    let mut words = text.split(' ');
    if words.next() != Some("PJLINK") {
        return Err(wrong());
    }
    match (words.next(), words.next(), words.next()) {
        (Some("0"), None, None) => Ok(Greeting::Open),
        (Some("ERRA"), None, None) => Ok(Greeting::Refused),
        // The token as it was sent: letters keep their case in the digest.
        (Some("1"), Some(token), None) if !token.is_empty() => {
            let sent = trimmed(line);
            let start = sent.len().saturating_sub(token.len());
            sent.get(start..).map(|token| Greeting::Locked(token.to_vec())).ok_or_else(wrong)
        }
        _ => Err(wrong()),
    }
}

/// The answer to a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// `OK`, or what was asked for.
    Value(Vec<u8>),
    /// `ERR1`.
    Undefined,
    /// `ERR2`.
    OutOfParameter,
    /// `ERR3`: not now, as in stand-by.
    Unavailable,
    /// `ERR4`.
    Failure,
    /// `PJLINK ERRA`.
    WrongPassword,
}

/// Parses the reply to `command`, without its CR.
///
/// # Errors
/// It is the reply to something else, or none.
pub fn parse_reply(line: &[u8], command: &[u8; 4]) -> Result<Reply, ProtocolError> {
    const EXPECTED: &str = "%1, the command, = and a value";
    let wrong = || ProtocolError::new(EXPECTED, line);
    let line = line.strip_prefix(b"\n").unwrap_or(line);
    if line.eq_ignore_ascii_case(b"PJLINK ERRA") {
        return Ok(Reply::WrongPassword);
    }
    let rest = line.strip_prefix(b"%1").ok_or_else(wrong)?;
    let (name, rest) = rest.split_at_checked(4).ok_or_else(wrong)?;
    let value = rest.strip_prefix(b"=").ok_or_else(wrong)?;
    if !name.eq_ignore_ascii_case(command) {
        return Err(wrong());
    }
    Ok(match value.to_ascii_uppercase().as_slice() {
        b"ERR1" => Reply::Undefined,
        b"ERR2" => Reply::OutOfParameter,
        b"ERR3" => Reply::Unavailable,
        b"ERR4" => Reply::Failure,
        _ => Reply::Value(value.to_vec()),
    })
}

/// Parses the value of `POWR ?`.
///
/// # Errors
/// It is none of 0 to 3.
pub fn parse_power(value: &[u8]) -> Result<PowerState, ProtocolError> {
    match trimmed(value) {
        b"0" => Ok(PowerState::Off),
        b"1" => Ok(PowerState::On),
        b"2" => Ok(PowerState::Cooling),
        b"3" => Ok(PowerState::Warming),
        _ => Err(ProtocolError::new("a power state, 0 to 3", value)),
    }
}

/// Parses the value of `AVMT ?`: whether the picture is muted.
///
/// # Errors
/// It is no two digits of the protocol.
pub fn parse_mute(value: &[u8]) -> Result<bool, ProtocolError> {
    match trimmed(value) {
        b"11" | b"31" => Ok(true),
        // 21 mutes the sound alone.
        b"10" | b"20" | b"21" | b"30" => Ok(false),
        _ => Err(ProtocolError::new("a mute state, 11, 21, 30 or 31", value)),
    }
}

/// Parses the value of `LAMP ?`, pairs of hours and whether that lamp is lit, to the hours.
///
/// # Errors
/// It is no such list.
pub fn parse_lamps(value: &[u8]) -> Result<Vec<u32>, ProtocolError> {
    const EXPECTED: &str = "pairs of lamp hours and 0 or 1";
    let wrong = || ProtocolError::new(EXPECTED, value);
    let text = printable(EXPECTED, trimmed(value))?;
    let words: Vec<&str> = text.split(' ').collect();
    // Eight lamps at most.
    if !words.len().is_multiple_of(2) || words.len() > 16 {
        return Err(wrong());
    }
    let pair = |pair: &[&str]| match pair {
        [hours, "0" | "1"] if hours.len() <= 5 => hours.parse().map_err(|_| wrong()),
        _ => Err(wrong()),
    };
    words.chunks(2).map(pair).collect()
}

/// Parses the value of `ERST ?`: six digits for fan, lamp, temperature, cover, filter, other.
///
/// # Errors
/// They are not.
pub fn parse_errors(value: &[u8]) -> Result<Vec<Fault>, ProtocolError> {
    const PARTS: [Part; 6] =
        [Part::Fan, Part::Lamp, Part::Temperature, Part::Cover, Part::Filter, Part::Other];
    let wrong = || ProtocolError::new("six digits 0 to 2", value);
    let digits = trimmed(value);
    if digits.len() != PARTS.len() {
        return Err(wrong());
    }
    let mut faults = Vec::new();
    for (&part, digit) in PARTS.iter().zip(digits) {
        match digit {
            b'0' => {}
            b'1' => faults.push(Fault { part, severity: Severity::Warning }),
            b'2' => faults.push(Fault { part, severity: Severity::Error }),
            _ => return Err(wrong()),
        }
    }
    Ok(faults)
}

#[cfg(test)]
mod tests {
    use super::super::scripted::{Step, scripted};
    use super::*;
    use crate::DeviceErrorKind;

    #[test]
    fn the_first_command_carries_the_digest_and_the_second_does_not() {
        // The digest of "498e4a67" and "JBMIAProjectorLink", the example of the specification.
        let link = scripted(vec![
            Step::Reply(b"PJLINK 1 498e4a67\r"),
            Step::Expect(b"5d8409bc1c3fa39749434aa3a5c38682%1POWR ?\r"),
            Step::Reply(b"%1POWR=3\r"),
            Step::Expect(b"%1AVMT 31\r"),
            Step::Reply(b"%1AVMT=OK\r"),
        ]);
        let mut projector = Pjlink::over(link, Some("JBMIAProjectorLink".into()));
        assert_eq!(projector.power_state().unwrap(), PowerState::Warming);
        projector.set_av_mute(true).unwrap();
    }

    #[test]
    fn a_wrong_password_is_declined_at_once() {
        let link = scripted(vec![Step::Reply(b"PJLINK ERRA\r")]);
        let mut projector = Pjlink::over(link, Some("no".into()));
        assert_eq!(projector.power_state().unwrap_err().kind(), DeviceErrorKind::Declined);
    }

    #[test]
    fn garbage_is_asked_again_over_a_new_connection() {
        let link = scripted(vec![
            Step::Reply(b"PJLINK 0\r"),
            Step::Expect(b"%1POWR ?\r"),
            Step::Reply(b"\xff\xfe%%1\r"),
            Step::Reply(b"PJLINK 0\r"),
            Step::Expect(b"%1POWR ?\r"),
            Step::Reply(b"%1POWR=1\r"),
        ]);
        let mut projector = Pjlink::over(link, None);
        assert_eq!(projector.power_state().unwrap(), PowerState::On);
    }

    #[test]
    fn replies_mean_what_the_specification_says() {
        assert_eq!(parse_reply(b"%1powr=ERR3", b"POWR").unwrap(), Reply::Unavailable);
        assert_eq!(parse_lamps(b"40 1 20 0").unwrap(), [40, 20]);
        assert!(parse_lamps(b"40 1 20").is_err());
        let faults = parse_errors(b"021000").unwrap();
        assert_eq!(faults[0], Fault { part: Part::Lamp, severity: Severity::Error });
        assert_eq!(faults[1], Fault { part: Part::Temperature, severity: Severity::Warning });
        assert!(parse_errors(b"0000000").is_err());
        let error = parse_reply(b"%1INPT=31", b"POWR").unwrap_err();
        assert_eq!(error.bytes, b"%1INPT=31");
    }
}
