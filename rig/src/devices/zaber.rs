//! Zaber's ASCII protocol: 115200 baud, 8N1.
//!
//! A command is `/device axis id words`, then `:` and a checksum, LF; the reply is
//! `@device axis id OK IDLE -- data`, CR LF: whether it was taken, whether the axis moves, and a
//! warning of two letters. `!` (alerts) and `#` (remarks) come by themselves. The id of the
//! command comes back in its reply, so that a late reply is never taken for the next.

mod messages;

use std::time::{Duration, Instant};

pub use messages::{Line, Reply, parse_line, parse_position};
use messages::{checksum, fault_text};

use super::{Coordinate, Link, Patience, Stage, StageAxis};
use crate::DeviceError;

/// Zaber's speed.
pub const BAUD: u32 = 115_200;

/// Between two questions whether it still moves.
const POLL: Duration = Duration::from_millis(50);

/// One axis of a Zaber chain.
#[derive(Clone, Debug)]
pub struct ZaberAxis {
    /// Its name, range and parking place.
    pub axis: StageAxis,
    /// The device in the chain, from 1.
    pub device: u8,
    /// The axis of that device, from 1.
    pub number: u8,
    /// What one microstep moves, mm or degrees; from the stage's data sheet.
    pub step: f64,
}

/// A chain of Zaber stages.
pub struct Zaber {
    link: Link,
    axes: Vec<StageAxis>,
    wiring: Vec<ZaberAxis>,
    /// Of the last command: 0 to 99.
    id: u8,
}

impl Zaber {
    /// The chain at the serial port `path`, which is not talked to yet.
    pub fn new(path: &str, baud: u32, axes: Vec<ZaberAxis>, patience: Patience) -> Self {
        Self::over(Link::serial(&format!("stage {path} (Zaber)"), path, baud, patience), axes)
    }

    /// A chain at the other end of `link`.
    pub fn over(link: Link, wiring: Vec<ZaberAxis>) -> Self {
        let axes = wiring.iter().map(|axis| axis.axis.clone()).collect();
        Self { link, axes, wiring, id: 0 }
    }

    fn name_of(&self, axis: &ZaberAxis) -> String {
        format!("{}, axis {}", self.link.device(), axis.axis.name)
    }

    fn wired(&self, axis: usize) -> Result<ZaberAxis, DeviceError> {
        self.wiring.get(axis).cloned().ok_or_else(|| DeviceError::Unsupported {
            device: self.link.device().to_owned(),
            reason: format!("there is no axis number {axis}"),
        })
    }

    /// Sends `words` once and returns the reply to them, refused or not.
    fn send(&mut self, axis: &ZaberAxis, words: &str) -> Result<Reply, DeviceError> {
        self.id = (self.id + 1) % 100;
        let id = self.id;
        self.link.send(&command(axis.device, axis.number, id, words))?;
        let deadline = self.link.deadline();
        loop {
            let line = self.link.receive(b"\n", deadline)?;
            match parse_line(&line).map_err(|e| e.of(self.link.device()))? {
                // Others are late replies to what was given up.
                Line::Reply(reply)
                    if reply.id == Some(id)
                        && reply.device == axis.device
                        && reply.axis == axis.number =>
                {
                    return Ok(reply);
                }
                _ => {}
            }
        }
    }

    /// [`send`](Self::send), and an error if it was refused or the axis is not well.
    fn tell(&mut self, axis: &ZaberAxis, words: &str) -> Result<Reply, DeviceError> {
        let reply = self.send(axis, words)?;
        let device = self.name_of(axis);
        if !reply.accepted {
            return Err(match reply.data.as_str() {
                "STATUSBUSY" => DeviceError::Busy { device },
                why => DeviceError::Unsupported {
                    device,
                    reason: format!("it refused {words:?}: {why}"),
                },
            });
        }
        match fault_text(&reply.warning) {
            Some(reason) => Err(DeviceError::Fault { device, reason }),
            None => Ok(reply),
        }
    }

    /// [`tell`](Self::tell), repeated where that may help, for words that change nothing.
    fn ask(&mut self, axis: &ZaberAxis, words: &str) -> Result<Reply, DeviceError> {
        let patience = self.link.patience();
        let mut pause = patience.pause;
        for _ in 1..patience.attempts {
            match self.tell(axis, words) {
                Err(error) if self.link.may_pass(&error) => {
                    std::thread::sleep(pause);
                    pause *= 2;
                }
                other => return other,
            }
        }
        self.tell(axis, words)
    }

    /// Waits until the axis rests, and stops it past the limit.
    fn rest(&mut self, axis: &ZaberAxis, limit: Duration) -> Result<(), DeviceError> {
        let started = Instant::now();
        while self.ask(axis, "")?.busy {
            if started.elapsed() >= limit {
                self.tell(axis, "stop")?;
                let device = self.name_of(axis);
                return Err(DeviceError::Timeout { device, waited_s: limit.as_secs_f64() });
            }
            std::thread::sleep(POLL);
        }
        Ok(())
    }

    fn steps(&mut self, axis: &ZaberAxis) -> Result<f64, DeviceError> {
        let reply = self.ask(axis, "get pos")?;
        let value = parse_position(reply.data.as_bytes()).map_err(|e| e.of(self.link.device()))?;
        if reply.warning == "WR" || reply.warning == "WH" {
            return Err(DeviceError::NotHomed { device: self.name_of(axis) });
        }
        Ok(value)
    }

    /// Sends each axis `words`, the others also where one fails.
    fn all(&mut self, words: &str) -> Result<(), DeviceError> {
        let mut outcome = Ok(());
        for axis in self.wiring.clone() {
            outcome = outcome.and(self.tell(&axis, words).map(drop));
        }
        outcome
    }
}

impl Stage for Zaber {
    fn name(&self) -> String {
        self.link.device().to_owned()
    }

    fn axes(&self) -> &[StageAxis] {
        &self.axes
    }

    fn position(&mut self, axis: usize) -> Result<Coordinate, DeviceError> {
        let axis = self.wired(axis)?;
        let steps = self.steps(&axis)?;
        Ok(axis.axis.range.ends().0.at(steps * axis.step))
    }

    fn move_to(&mut self, axis: usize, to: Coordinate, limit: Duration) -> Result<(), DeviceError> {
        let axis = self.wired(axis)?;
        let value = axis.axis.admit(self.link.device(), to)?;
        // Before: an axis that does not know where it is would go to a wrong place.
        self.steps(&axis)?;
        let target = (value / axis.step).round();
        self.tell(&axis, &format!("move abs {target:.0}"))?;
        self.rest(&axis, limit)?;
        let reached = self.steps(&axis)?;
        // A microstep of rounding on either side.
        if (reached - target).abs() > 2.0 {
            let reached = to.at(reached * axis.step);
            let reason = format!("it was sent to {to} and is at {reached}");
            return Err(DeviceError::Fault { device: self.name_of(&axis), reason });
        }
        Ok(())
    }

    fn hold(&mut self) -> Result<(), DeviceError> {
        self.all("stop")?;
        let limit = self.link.patience().reply;
        for axis in self.wiring.clone() {
            self.rest(&axis, limit)?;
        }
        Ok(())
    }

    fn halt(&mut self) -> Result<(), DeviceError> {
        self.all("estop")
    }

    fn home(&mut self, limit: Duration) -> Result<(), DeviceError> {
        for axis in self.wiring.clone() {
            self.tell(&axis, "home")?;
            self.rest(&axis, limit)?;
        }
        Ok(())
    }

    fn unlock(&mut self) -> Result<(), DeviceError> {
        for axis in self.wiring.clone() {
            // The reply still carries the warnings that it clears.
            self.send(&axis, "warnings clear")?;
        }
        Ok(())
    }
}

/// The bytes of a command.
fn command(device: u8, axis: u8, id: u8, words: &str) -> Vec<u8> {
    let body =
        format!("{device:02} {axis} {id:02}{}{words}", if words.is_empty() { "" } else { " " });
    format!("/{body}:{:02X}\n", checksum(body.as_bytes())).into_bytes()
}

#[cfg(test)]
mod tests {
    use super::super::scripted::{Step, scripted};
    use super::super::{Millimetres, Range};
    use super::*;
    use crate::DeviceErrorKind;

    fn axis() -> ZaberAxis {
        let range = Range::Linear(Millimetres(0.0), Millimetres(50.0));
        let axis = StageAxis { name: "x".into(), range, park: None };
        ZaberAxis { axis, device: 1, number: 1, step: 0.001 }
    }

    #[test]
    fn lines_are_what_the_manual_says() {
        let reply = |line: &[u8]| match parse_line(line).unwrap() {
            Line::Reply(reply) => reply,
            Line::Unasked => panic!("a reply"),
        };
        let busy = reply(b"@01 0 OK BUSY -- 5.5\r");
        assert!(busy.accepted && busy.busy && busy.id.is_none());
        assert_eq!(busy.data, "5.5");
        let refused = reply(b"@01 1 07 RJ IDLE WR BADDATA");
        assert!(!refused.accepted && refused.id == Some(7));
        assert_eq!(parse_line(b"!01 1 IDLE --").unwrap(), Line::Unasked);
        for bad in [&b""[..], b"@", b"@01 0 OK", b"@01 0 OK IDLE ---", b"@1 1 OK IDLE --:00", b"?"]
        {
            assert!(parse_line(bad).is_err(), "{}", bad.escape_ascii());
        }
    }

    #[test]
    fn checksums_are_sent_and_believed_only_if_right() {
        // Examples that others' programs send.
        assert_eq!(checksum(b"1 tools echo"), 0xBF);
        assert_eq!(checksum(b"2 0 5 get maxspeed"), 0x52);
        let sent = command(1, 1, 1, "get pos");
        assert_eq!(sent, b"/01 1 01 get pos:FB\n");
        assert!(parse_line(b"@01 1 01 OK IDLE -- 5:00").is_err());
    }

    #[test]
    fn late_replies_are_passed_over_and_faults_named() {
        let link = scripted(vec![
            Step::Expect(b"/01 1 01 get pos:FB\n"),
            Step::Reply(b"@01 1 99 OK IDLE -- 7\r\n!01 1 IDLE --\r\n@01 1 01 OK IDLE -- 2500\r\n"),
            Step::Expect(b"/01 1 02 get pos:FA\n"),
            Step::Reply(b"@01 1 02 OK IDLE FS 2500\r\n"),
            Step::Expect(b"/01 1 03 get pos:F9\n"),
            Step::Reply(b"@01 1 03 OK IDLE WR 0\r\n"),
        ]);
        let mut stage = Zaber::over(link, vec![axis()]);
        assert_eq!(stage.position(0).unwrap(), Coordinate::Linear(Millimetres(2.5)));
        let error = stage.position(0).unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Fault);
        assert!(error.to_string().contains("stalled"), "{error}");
        assert_eq!(stage.position(0).unwrap_err().kind(), DeviceErrorKind::NotHomed);
    }
}
