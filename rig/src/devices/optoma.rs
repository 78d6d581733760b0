//! Optoma's RS-232 protocol: 9600 baud, 8N1.
//!
//! Orders are `~`, two digits of the projector's number, the command, a space and a variable, CR.
//! They are answered with `P` or `F`, questions with `OK` and digits, both with or without a CR
//! after it, as the model likes. `INFO` and a digit come by themselves: warming up, cooling down,
//! and what is wrong.

mod messages;

use std::time::Duration;

pub use messages::{
    Information, Message, parse_hours, parse_information, parse_messages, parse_switch,
};

use super::transition::Transition;
use super::{Fault, Link, Part, Patience, PowerState, ProjectorControl, ProtocolError, Severity};
use crate::DeviceError;

/// Optoma's speed.
pub const BAUD: u32 = 9600;

/// At 9600 baud a byte takes a millisecond; USB adapters hold bytes back for up to 16.
const QUIET: Duration = Duration::from_millis(60);

/// An Optoma projector.
pub struct Optoma {
    link: Link,
    id: u8,
    transition: Transition,
    /// What it announced since it was last found on.
    faults: Vec<Fault>,
}

impl Optoma {
    /// The projector number `id` (0 to 99; 0 for any) at the serial port `path`, which is not
    /// talked to yet.
    pub fn new(path: &str, baud: u32, id: u8, patience: Patience) -> Self {
        Self::over(Link::serial(&format!("projector {path} (Optoma)"), path, baud, patience), id)
    }

    /// A projector at the other end of `link`.
    pub fn over(link: Link, id: u8) -> Self {
        Self { link, id: id.min(99), transition: Transition::default(), faults: Vec::new() }
    }

    /// Sends a command and returns the first message that is no news. A value without an end may
    /// be half of one: it is believed when it comes twice.
    fn ask(&mut self, command: &str) -> Result<Message, DeviceError> {
        let order = format!("~{:02}{command}\r", self.id);
        let mut news = Vec::new();
        let mut unended: Option<Message> = None;
        let answer = self.link.retry(|link| {
            if !link.connect()? {
                collect_news(link, &mut news)?;
            }
            link.send(order.as_bytes())?;
            let mut deadline = link.deadline();
            loop {
                let (part, ended) = link.receive_until_quiet(b"\r\n", QUIET, deadline)?;
                let messages = parse_messages(&part).map_err(|e| e.of(link.device()))?;
                let (infos, answers): (Vec<_>, Vec<_>) =
                    messages.into_iter().partition(|m| matches!(m, Message::Info(_)));
                news.extend(infos);
                let Some(answer) = answers.into_iter().next() else { continue };
                let whole = ended || !matches!(answer, Message::Value(_));
                if whole || unended.as_ref() == Some(&answer) {
                    return Ok(answer);
                }
                unended = Some(answer);
                link.send(order.as_bytes())?;
                deadline = link.deadline();
            }
        });
        for message in news {
            if let Message::Info(code) = message {
                self.hear(code);
            }
        }
        answer
    }

    fn hear(&mut self, code: u8) {
        match code {
            0 => self.transition.end(),
            1 => self.transition.begin(true),
            2 => self.transition.begin(false),
            _ => {}
        }
        self.faults.extend(fault_of(code).filter(|fault| !self.faults.contains(fault)));
    }

    fn order(&mut self, command: &str) -> Result<(), DeviceError> {
        match self.ask(command)? {
            Message::Pass => Ok(()),
            Message::Fail => Err(self.refused(command)),
            other => Err(self.unexpected("P or F", &other)),
        }
    }

    /// `F` says neither why nor whether it will pass: while it warms up or cools down, it will.
    fn refused(&mut self, command: &str) -> DeviceError {
        let device = self.link.device().to_owned();
        if self.transition.state().is_some() {
            return DeviceError::Busy { device };
        }
        let reason = format!("it answered F to the command {command}");
        DeviceError::Unsupported { device, reason }
    }

    fn unexpected(&self, expected: &'static str, found: &Message) -> DeviceError {
        let bytes = match found {
            Message::Pass => b"P".to_vec(),
            Message::Fail => b"F".to_vec(),
            Message::Value(value) => [b"OK", value.as_slice()].concat(),
            Message::Info(code) => format!("INFO{code}").into_bytes(),
        };
        ProtocolError::new(expected, &bytes).of(self.link.device())
    }

    fn question(&mut self, command: &str) -> Result<Vec<u8>, DeviceError> {
        match self.ask(command)? {
            Message::Value(value) => Ok(value),
            Message::Fail => Err(self.refused(command)),
            other => Err(self.unexpected("OK and a value", &other)),
        }
    }
}

/// Takes in what was announced since the last answer.
fn collect_news(link: &mut Link, news: &mut Vec<Message>) -> Result<(), DeviceError> {
    loop {
        let deadline = std::time::Instant::now() + Duration::from_millis(2);
        match link.receive_until_quiet(b"\r\n", Duration::from_millis(1), deadline) {
            // Whatever else is there belongs to a question that was given up.
            Ok((part, _)) => news.extend(
                parse_messages(&part)
                    .unwrap_or_default()
                    .into_iter()
                    .filter(|m| matches!(m, Message::Info(_))),
            ),
            Err(DeviceError::Timeout { .. }) => return Ok(()),
            Err(error) => return Err(error),
        }
    }
}

impl ProjectorControl for Optoma {
    fn name(&mut self) -> Result<String, DeviceError> {
        let device = self.link.device().to_owned();
        Ok(match self.question("151 1") {
            Ok(model) => format!("Optoma, model {}", String::from_utf8_lossy(&model)),
            // Older ones do not say, and none says so while it warms up.
            Err(DeviceError::Unsupported { .. } | DeviceError::Busy { .. }) => device,
            Err(error) => return Err(error),
        })
    }

    fn power_state(&mut self) -> Result<PowerState, DeviceError> {
        let on = match self.question("124 1") {
            Ok(value) => parse_switch(&value).map_err(|e| e.of(self.link.device()))?,
            Err(DeviceError::Busy { device }) => {
                return self.transition.state().ok_or(DeviceError::Busy { device });
            }
            // Older ones know only the collected answer.
            Err(DeviceError::Unsupported { .. }) => {
                let value = self.question("150 1")?;
                parse_information(&value).map_err(|e| e.of(self.link.device()))?.on
            }
            Err(error) => return Err(error),
        };
        let state = self.transition.resolve(on);
        if state == PowerState::On {
            // Whatever kept it from lighting is over.
            self.faults.retain(|fault| fault.severity == Severity::Warning);
        }
        Ok(state)
    }

    fn set_power(&mut self, on: bool) -> Result<(), DeviceError> {
        self.order(if on { "00 1" } else { "00 0" })?;
        self.transition.begin(on);
        Ok(())
    }

    fn select_input(&mut self, input: &str) -> Result<(), DeviceError> {
        if !(1..=2).contains(&input.len()) || !input.bytes().all(|b| b.is_ascii_digit()) {
            let reason = format!("inputs are numbers of one or two digits, not {input:?}");
            let device = self.link.device().to_owned();
            return Err(DeviceError::Unsupported { device, reason });
        }
        self.order(&format!("12 {input}"))
    }

    fn av_mute(&mut self) -> Result<Option<bool>, DeviceError> {
        Ok(None)
    }

    fn set_av_mute(&mut self, mute: bool) -> Result<(), DeviceError> {
        self.order(if mute { "02 1" } else { "02 0" })
    }

    fn lamp_hours(&mut self) -> Result<Vec<u32>, DeviceError> {
        let hours = match self.question("108 1") {
            Ok(value) => parse_hours(&value),
            Err(DeviceError::Unsupported { .. }) => {
                parse_information(&self.question("150 1")?).map(|info| info.lamp_hours)
            }
            Err(error) => return Err(error),
        };
        Ok(vec![hours.map_err(|e| e.of(self.link.device()))?])
    }

    /// Those that it announced: they cannot be asked for.
    fn faults(&mut self) -> Result<Option<Vec<Fault>>, DeviceError> {
        Ok(Some(self.faults.clone()))
    }
}

/// What an announcement says is wrong.
fn fault_of(code: u8) -> Option<Fault> {
    let (part, severity) = match code {
        4 => (Part::Lamp, Severity::Error),
        6 => (Part::Fan, Severity::Error),
        7 => (Part::Temperature, Severity::Error),
        8 => (Part::Lamp, Severity::Warning),
        9 => (Part::Cover, Severity::Error),
        _ => return None,
    };
    Some(Fault { part, severity })
}

#[cfg(test)]
mod tests {
    use super::super::scripted::{Step, scripted};
    use super::*;
    use crate::DeviceErrorKind;

    #[test]
    fn answers_and_announcements_are_told_apart() {
        let messages = parse_messages(b"INFO1\rP").unwrap();
        assert_eq!(messages, [Message::Info(1), Message::Pass]);
        let messages = parse_messages(b"Ok1INFO4").unwrap();
        assert_eq!(messages, [Message::Value(b"1".to_vec()), Message::Info(4)]);
        assert_eq!(parse_messages(b"\r\n").unwrap(), []);
        for bad in [&b"INFO"[..], b"INFOx", b"OK", b"X", b"P\xff"] {
            assert!(parse_messages(bad).is_err(), "{}", bad.escape_ascii());
        }
    }

    #[test]
    fn the_collected_answer_has_two_widths() {
        let info = |value: &[u8]| parse_information(value).unwrap();
        assert_eq!(info(b"101230600C01"), Information { on: true, lamp_hours: 123 });
        assert_eq!(info(b"1012340600C010").lamp_hours, 1234);
        assert!(parse_information(b"1").is_err());
        assert!(parse_information(b"1xxxx0600C01").is_err());
    }

    #[test]
    fn warming_up_is_neither_off_nor_a_failure() {
        let link = scripted(vec![
            Step::Expect(b"~0000 1\r"),
            Step::Reply(b"P"),
            Step::Silence,
            Step::Reply(b"INFO1\r"),
            Step::Silence,
            Step::Expect(b"~00124 1\r"),
            Step::Reply(b"OK0\r"),
            Step::Expect(b"~00124 1\r"),
            Step::Reply(b"F\r"),
            Step::Expect(b"~00124 1\r"),
            Step::Reply(b"OK1\r"),
        ]);
        let mut projector = Optoma::over(link, 0);
        projector.set_power(true).unwrap();
        assert_eq!(projector.power_state().unwrap(), PowerState::Warming);
        assert_eq!(projector.power_state().unwrap(), PowerState::Warming);
        assert_eq!(projector.power_state().unwrap(), PowerState::On);
    }

    #[test]
    fn off_after_an_order_is_warming_up_though_nothing_is_announced() {
        let link = scripted(vec![
            Step::Expect(b"~0000 1\r"),
            Step::Reply(b"P\r"),
            Step::Expect(b"~00124 1\r"),
            Step::Reply(b"OK0\r"),
        ]);
        let mut projector = Optoma::over(link, 0);
        projector.set_power(true).unwrap();
        assert_eq!(projector.power_state().unwrap(), PowerState::Warming);
    }

    #[test]
    fn half_a_value_is_not_believed() {
        let link = scripted(vec![
            Step::Expect(b"~00108 1\r"),
            Step::Reply(b"OK01"),
            Step::Silence,
            Step::Expect(b"~00108 1\r"),
            Step::Reply(b"OK01234"),
            Step::Silence,
            Step::Expect(b"~00108 1\r"),
            Step::Reply(b"OK01234"),
            Step::Silence,
        ]);
        assert_eq!(Optoma::over(link, 0).lamp_hours().unwrap(), [1234]);
    }

    #[test]
    fn an_input_is_a_number() {
        let mut projector = Optoma::over(scripted(Vec::new()), 0);
        let error = projector.select_input("hdmi\r~0000 0").unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Unsupported);
    }
}
