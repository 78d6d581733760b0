//! Stages behind GRBL 1.1, the G-code interpreter of small mills and plotters.
//!
//! A line is answered with `ok` or `error:N`. `ALARM:N`, `[MSG:…]` and the start-up message come
//! by themselves. Single bytes act at once and are not answered: `?` brings a status report,
//! `!` holds, 0x18 resets. Moves are in machine coordinates (G53), so that no offset that somebody
//! left in the controller matters.

mod messages;
mod settings;

use std::time::{Duration, Instant};

pub use messages::{Activity, Message, Places, Status, alarm_text, error_text, parse_message};
use settings::Settings;

use super::{Coordinate, Link, Patience, ProtocolError, Stage, StageAxis};
use crate::DeviceError;

/// GRBL's own speed.
pub const BAUD: u32 = 115_200;

/// An Arduino restarts when its port is opened, and says nothing for most of this time.
const BOOT: Duration = Duration::from_secs(3);

/// Between two status reports that are asked for while something moves.
const POLL: Duration = Duration::from_millis(100);

/// Steps are a few thousandths of a millimetre; a motor that lost some lost a whole turn's worth.
const CLOSE: f64 = 0.02;

/// A stage with up to three axes behind GRBL.
pub struct Grbl {
    link: Link,
    axes: Vec<StageAxis>,
    /// Axis letter of each of `axes`: an index into X, Y, Z.
    letters: Vec<usize>,
    settings: Settings,
    /// Work coordinate offset of the last report that had one.
    offset: Option<[f64; 3]>,
    /// What keeps it from moving, until somebody homes or unlocks it.
    alarm: Option<Alarm>,
    /// Whether it has been talked to: if it restarts after that, its place is gone.
    known: bool,
    /// It has restarted, and was not homed or unlocked since.
    restarted: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Alarm {
    /// It stopped itself, and said why by a number.
    Number(u16),
    /// It is locked without a word: as it is after every start, where it has switches to home to.
    Locked,
}

const RESTARTED: &str = "it restarted, and may have lost its place; home or unlock it";

const LETTERS: [char; 3] = ['X', 'Y', 'Z'];

impl Grbl {
    /// The controller at the serial port `path`, which is not talked to yet. Each axis comes with
    /// the number of its letter: 0 is X, 1 Y, 2 Z.
    pub fn new(path: &str, baud: u32, axes: Vec<(StageAxis, usize)>, patience: Patience) -> Self {
        Self::over(Link::serial(&format!("stage {path} (GRBL)"), path, baud, patience), axes)
    }

    /// A controller at the other end of `link`.
    pub fn over(link: Link, axes: Vec<(StageAxis, usize)>) -> Self {
        let (axes, letters) = axes.into_iter().unzip();
        let settings = Settings::default();
        Self {
            link,
            axes,
            letters,
            settings,
            offset: None,
            alarm: None,
            known: false,
            restarted: false,
        }
    }

    fn device(&self) -> String {
        self.link.device().to_owned()
    }

    fn fault(&self, reason: impl Into<String>) -> DeviceError {
        DeviceError::Fault { device: self.device(), reason: reason.into() }
    }

    fn axis(&self, axis: usize) -> Result<(StageAxis, usize), DeviceError> {
        match (self.axes.get(axis), self.letters.get(axis)) {
            (Some(found), Some(&letter)) if letter < LETTERS.len() => Ok((found.clone(), letter)),
            _ => Err(DeviceError::Unsupported {
                device: self.device(),
                reason: format!("there is no axis number {axis}"),
            }),
        }
    }

    /// Opens the link if need be, waits until the controller has started, and looks at how it is
    /// set up.
    fn ready(&mut self) -> Result<(), DeviceError> {
        if !self.link.connect()? {
            return Ok(());
        }
        self.offset = None;
        let greeted = self.awaken().and_then(|()| self.read_settings());
        // Half a greeting is none: the next use has to begin at the beginning.
        greeted.inspect_err(|_| self.link.disconnect())
    }

    fn awaken(&mut self) -> Result<(), DeviceError> {
        let limit = BOOT + self.link.patience().reply;
        let deadline = Instant::now() + limit;
        loop {
            self.link.send(b"?")?;
            let ask_again = deadline.min(Instant::now() + Duration::from_millis(500));
            match self.next(ask_again) {
                Ok(Message::Status(_)) => {
                    // Its greeting may have been lost.
                    self.restarted |= self.known && self.alarm == Some(Alarm::Locked);
                    self.known = true;
                    return Ok(());
                }
                Ok(Message::Startup) => self.restarted |= self.known,
                Ok(_) => {}
                Err(DeviceError::Timeout { .. } | DeviceError::Protocol { .. })
                    if Instant::now() < deadline => {}
                // It was asked again and again, not only the last time.
                Err(DeviceError::Timeout { device, .. }) => {
                    return Err(DeviceError::Timeout { device, waited_s: limit.as_secs_f64() });
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn read_settings(&mut self) -> Result<(), DeviceError> {
        let deadline = self.link.deadline();
        self.link.send(b"$$\n")?;
        let mut settings = Settings::default();
        loop {
            match self.next(deadline)? {
                Message::Setting(number, value) => settings.set(number, value),
                Message::Ok => break,
                // Refused while it moves or is locked up; the defaults are GRBL's own.
                Message::Error(_) => break,
                _ => {}
            }
        }
        if settings.inches {
            let reason = "it reports inches; set $13=0".into();
            return Err(DeviceError::Unsupported { device: self.device(), reason });
        }
        self.settings = settings;
        Ok(())
    }

    /// The next message. Alarms and restarts are remembered on the way.
    fn next(&mut self, deadline: Instant) -> Result<Message, DeviceError> {
        loop {
            let line = self.link.receive(b"\n", deadline)?;
            let message = parse_message(&line).map_err(|e| e.of(self.link.device()))?;
            match &message {
                Message::Blank => continue,
                Message::Alarm(number) => self.alarm = Some(Alarm::Number(*number)),
                Message::Status(status) => {
                    self.offset = status.offset.or(self.offset);
                    match status.activity {
                        Activity::Alarm => self.alarm = self.alarm.or(Some(Alarm::Locked)),
                        _ => self.alarm = None,
                    }
                }
                _ => {}
            }
            return Ok(message);
        }
    }

    /// Sends a line and waits for its `ok`. While nothing comes, status reports are asked for: a
    /// controller that is silent even then for as long as one reply may take is gone.
    fn line(&mut self, line: &str, limit: Instant) -> Result<(), DeviceError> {
        self.ready()?;
        self.link.send(format!("{line}\n").as_bytes())?;
        let mut strange: Option<DeviceError> = None;
        let mut heard = Instant::now();
        loop {
            let now = Instant::now();
            if now >= limit {
                let waited_s = self.link.patience().reply.as_secs_f64();
                let late = DeviceError::Timeout { device: self.device(), waited_s };
                return Err(strange.unwrap_or(late));
            }
            match self.next(limit.min(now + POLL)) {
                Ok(Message::Ok) => return Ok(()),
                Ok(Message::Error(number)) => return Err(self.refusal(line, number)),
                Ok(Message::Alarm(number)) => return Err(self.fault(alarm_text(number))),
                Ok(Message::Startup) => {
                    self.restarted = true;
                    return Err(self.fault(RESTARTED));
                }
                Ok(_) => heard = Instant::now(),
                Err(error @ DeviceError::Protocol { .. }) => {
                    // Some firmware chats. Only if its answer never comes was this the answer.
                    heard = Instant::now();
                    strange = Some(error);
                }
                Err(DeviceError::Timeout { .. }) => {
                    if heard.elapsed() > self.link.patience().reply {
                        let waited_s = self.link.patience().reply.as_secs_f64();
                        let late = DeviceError::Timeout { device: self.device(), waited_s };
                        self.link.disconnect();
                        return Err(strange.unwrap_or(late));
                    }
                    self.link.send(b"?")?;
                }
                Err(error) => return Err(error),
            }
        }
    }

    fn refusal(&self, line: &str, number: u16) -> DeviceError {
        let device = self.device();
        match (number, self.alarm) {
            (9, Some(alarm)) => self.stopped_by(alarm),
            (9, None) => self.fault(error_text(9)),
            (8, _) => DeviceError::Busy { device },
            _ => {
                let reason = format!("it refused {line}: {}", error_text(number));
                DeviceError::Unsupported { device, reason }
            }
        }
    }

    fn stopped_by(&self, alarm: Alarm) -> DeviceError {
        match alarm {
            Alarm::Number(number) => self.fault(alarm_text(number)),
            Alarm::Locked if self.restarted => self.fault(RESTARTED),
            Alarm::Locked if self.settings.homing => {
                DeviceError::NotHomed { device: self.device() }
            }
            Alarm::Locked => self.fault("it is locked, and has no switches to home to; unlock it"),
        }
    }

    /// Asks for a status report.
    fn status(&mut self) -> Result<Status, DeviceError> {
        self.ready()?;
        // What came before the question is no answer to it, but may be an alarm.
        loop {
            match self.next(Instant::now() + Duration::from_millis(2)) {
                Ok(_) | Err(DeviceError::Protocol { .. }) => {}
                Err(DeviceError::Timeout { .. }) => break,
                Err(error) => return Err(error),
            }
        }
        self.link.send(b"?")?;
        let deadline = self.link.deadline();
        loop {
            if let Message::Status(status) = self.next(deadline)? {
                return Ok(status);
            }
        }
    }

    /// [`status`](Self::status), asked again after garbage or silence: a report changes nothing.
    fn status_again(&mut self) -> Result<Status, DeviceError> {
        let patience = self.link.patience();
        let mut pause = patience.pause;
        for _ in 1..patience.attempts {
            match self.status() {
                Err(error) if self.may_pass(&error) => {
                    std::thread::sleep(pause);
                    pause *= 2;
                }
                other => return other,
            }
        }
        self.status().map_err(|error| match (self.alarm, error) {
            // After a limit switch it says nothing until it is reset.
            (Some(alarm), DeviceError::Timeout { .. }) => self.stopped_by(alarm),
            (_, error) => error,
        })
    }

    /// Whether asking again may help. What has never said a word that GRBL knows has been asked a
    /// dozen times by then.
    fn may_pass(&self, error: &DeviceError) -> bool {
        let heard = self.known || matches!(error, DeviceError::Disconnected { .. });
        heard && self.link.may_pass(error)
    }

    /// Where all axes are, in machine coordinates.
    fn places(&mut self) -> Result<[f64; 3], DeviceError> {
        // An offset comes with every 30th report at the latest, unless it was compiled out.
        for _ in 0..31 {
            match self.status_again()?.places {
                Places::Machine(at) => return Ok(at),
                Places::Work(at) => {
                    if let Some(offset) = self.offset {
                        return Ok([0, 1, 2].map(|i| at[i] + offset[i]));
                    }
                }
            }
        }
        let reason = "it does not say where it is in machine coordinates; set $10=1".into();
        Err(DeviceError::Unsupported { device: self.device(), reason })
    }

    fn fail_on_alarm(&mut self) -> Result<(), DeviceError> {
        self.status_again()?;
        match self.alarm {
            Some(alarm) => Err(self.stopped_by(alarm)),
            None if self.restarted => Err(self.fault(RESTARTED)),
            None => Ok(()),
        }
    }

    /// Somebody has looked, or it has found its switches.
    fn forget_alarm(&mut self) {
        self.alarm = None;
        self.restarted = false;
    }

    /// Resets the controller and waits until it has started again.
    fn reset(&mut self) -> Result<(), DeviceError> {
        self.link.send(&[0x18])?;
        let deadline = Instant::now() + BOOT + self.link.patience().reply;
        loop {
            match self.next(deadline) {
                Ok(Message::Startup) => return Ok(()),
                Ok(_) | Err(DeviceError::Protocol { .. }) => {}
                Err(error) => return Err(error),
            }
        }
    }

    /// Homes, unlike [`Stage::home`] without looking whether it can.
    fn run_homing(&mut self, limit: Duration) -> Result<(), DeviceError> {
        // No report is sent during homing, so that silence says nothing until the limit.
        self.link.send(b"$H\n")?;
        let deadline = Instant::now() + limit;
        loop {
            match self.next(deadline)? {
                Message::Ok => return Ok(()),
                Message::Error(number) => return Err(self.refusal("$H", number)),
                Message::Alarm(number) => return Err(self.fault(alarm_text(number))),
                _ => {}
            }
        }
    }
}

impl Stage for Grbl {
    fn name(&self) -> String {
        self.device()
    }

    fn axes(&self) -> &[StageAxis] {
        &self.axes
    }

    fn position(&mut self, axis: usize) -> Result<Coordinate, DeviceError> {
        let (axis, letter) = self.axis(axis)?;
        self.fail_on_alarm()?;
        let places = self.places()?;
        Ok(axis.range.ends().0.at(places.get(letter).copied().unwrap_or_default()))
    }

    fn move_to(&mut self, axis: usize, to: Coordinate, limit: Duration) -> Result<(), DeviceError> {
        let (found, letter) = self.axis(axis)?;
        let value = found.admit(self.link.device(), to)?;
        let letter = LETTERS[letter];
        self.fail_on_alarm()?;
        let deadline = Instant::now() + limit;
        // The second line waits in the queue behind the move: its `ok` comes when that is over.
        let moved = self.line(&format!("G21G90G53G0{letter}{value:.4}"), deadline);
        let moved = moved.and_then(|()| self.line("G4P0.01", deadline));
        if let Err(DeviceError::Timeout { device, .. }) = moved {
            // Nobody waits for it any more, so it must not go on.
            let held = self.hold();
            let waited_s = limit.as_secs_f64();
            return Err(held.err().unwrap_or(DeviceError::Timeout { device, waited_s }));
        }
        moved?;
        let reached = self.position(axis)?;
        if (reached.value() - value).abs() > CLOSE {
            return Err(
                self.fault(format!("axis {} was sent to {to} and is at {reached}", found.name))
            );
        }
        Ok(())
    }

    fn hold(&mut self) -> Result<(), DeviceError> {
        self.ready()?;
        self.link.send(b"!")?;
        let deadline = self.link.deadline();
        // Held motion would go on with the next command; a reset forgets it, and keeps the place
        // if it comes after the axes have stopped.
        loop {
            let status = self.status()?;
            match status.activity {
                Activity::Idle => return Ok(()),
                Activity::Held => return self.reset(),
                Activity::Alarm => return self.fail_on_alarm(),
                Activity::Moving | Activity::Other if Instant::now() >= deadline => {
                    let waited_s = self.link.patience().reply.as_secs_f64();
                    return Err(DeviceError::Timeout { device: self.device(), waited_s });
                }
                Activity::Moving | Activity::Other => std::thread::sleep(POLL / 5),
            }
        }
    }

    fn halt(&mut self) -> Result<(), DeviceError> {
        self.ready()?;
        self.reset()
    }

    fn home(&mut self, limit: Duration) -> Result<(), DeviceError> {
        self.ready()?;
        if !self.settings.homing {
            let reason = "homing is switched off ($22=0)".into();
            return Err(DeviceError::Unsupported { device: self.device(), reason });
        }
        self.run_homing(limit)?;
        self.forget_alarm();
        Ok(())
    }

    fn unlock(&mut self) -> Result<(), DeviceError> {
        let deadline = self.link.deadline();
        self.ready()?;
        if matches!(self.alarm, Some(Alarm::Number(1 | 2))) {
            // After a limit GRBL wants a reset before it listens to anything.
            self.reset()?;
        }
        self.line("$X", deadline)?;
        self.forget_alarm();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
