//! Bytes out, and bytes in before a deadline, over TCP or a serial port.

use std::time::{Duration, Instant};

use super::connection::{Connection, connect, is_timeout, open_serial};
use crate::DeviceError;

/// No reply of any protocol here is as long; whoever sends more without an end sends garbage.
const LONGEST: usize = 4096;

/// How long a driver waits for a device, and how often it asks again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// For one reply, and for a connection.
    pub reply: Duration,
    /// How often something is tried altogether, at least once.
    pub attempts: u32,
    /// Before the second attempt; twice as long before each further one.
    pub pause: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self { reply: Duration::from_secs(3), attempts: 3, pause: Duration::from_millis(250) }
    }
}

type Opener = Box<dyn FnMut(Duration) -> Result<Box<dyn Connection>, DeviceError> + Send>;

/// A connection that opens when it is needed and again after it was lost.
pub struct Link {
    device: String,
    open: Opener,
    connection: Option<Box<dyn Connection>>,
    /// Bytes that came and were not asked for yet.
    received: Vec<u8>,
    /// Whether there has been a connection.
    was_open: bool,
    patience: Patience,
}

impl Link {
    /// A link that `open` makes the connections of; it is given the longest time that may take.
    pub fn new(
        device: impl Into<String>,
        patience: Patience,
        open: impl FnMut(Duration) -> Result<Box<dyn Connection>, DeviceError> + Send + 'static,
    ) -> Self {
        Self {
            device: device.into(),
            open: Box::new(open),
            connection: None,
            received: Vec::new(),
            was_open: false,
            patience,
        }
    }

    /// A link to a TCP port.
    pub fn tcp(device: &str, host: &str, port: u16, patience: Patience) -> Self {
        let (name, host) = (device.to_owned(), host.to_owned());
        Self::new(device, patience, move |wait| connect(&name, &host, port, wait))
    }

    /// A link to a serial port: 8 data bits, no parity, 1 stop bit, no flow control.
    pub fn serial(device: &str, path: &str, baud: u32, patience: Patience) -> Self {
        let (name, path) = (device.to_owned(), path.to_owned());
        Self::new(device, patience, move |wait| open_serial(&name, &path, baud, wait))
    }

    /// The device at the other end, for messages.
    pub fn device(&self) -> &str {
        &self.device
    }

    /// How long it waits.
    pub fn patience(&self) -> Patience {
        self.patience
    }

    /// The same link, waiting otherwise.
    pub fn with_patience(self, patience: Patience) -> Self {
        Self { patience, ..self }
    }

    /// When the reply to something sent now has to be there.
    pub fn deadline(&self) -> Instant {
        Instant::now() + self.patience.reply
    }

    /// Opens the connection unless it is open. True if it is a new one.
    ///
    /// # Errors
    /// It cannot be opened; the kind says why.
    pub fn connect(&mut self) -> Result<bool, DeviceError> {
        if self.connection.is_some() {
            return Ok(false);
        }
        self.received.clear();
        self.connection = Some((self.open)(self.patience.reply)?);
        self.was_open = true;
        Ok(true)
    }

    /// Gives the connection up; the next use opens another.
    pub fn disconnect(&mut self) {
        self.connection = None;
        self.received.clear();
    }

    /// Sends `bytes`.
    ///
    /// # Errors
    /// The connection cannot be opened or is gone.
    pub fn send(&mut self, bytes: &[u8]) -> Result<(), DeviceError> {
        self.connect()?;
        let wait = self.patience.reply;
        let Some(connection) = &mut self.connection else { return Err(self.gone()) };
        match connection.write(bytes, wait) {
            Ok(()) => Ok(()),
            Err(error) if is_timeout(&error) => Err(self.late(wait)),
            Err(_) => Err(self.gone()),
        }
    }

    /// Forgets what came unasked: replies to a question that was given up.
    ///
    /// # Errors
    /// The connection is gone.
    pub fn discard(&mut self) -> Result<(), DeviceError> {
        while self.fill(Duration::from_millis(1))? {
            self.received.clear();
        }
        self.received.clear();
        Ok(())
    }

    /// The next bytes up to one of `ends`, without it.
    ///
    /// # Errors
    /// They are not there before `deadline`, there are more than 4096 without an end, or the
    /// connection is gone.
    pub fn receive(&mut self, ends: &[u8], deadline: Instant) -> Result<Vec<u8>, DeviceError> {
        self.receive_or_quiet(ends, None, deadline).map(|(line, _)| line)
    }

    /// Like [`receive`](Self::receive), but where a device ends some of its replies with nothing:
    /// after `quiet` without a further byte they count as complete. Also says whether there was
    /// an end.
    ///
    /// # Errors
    /// Those of `receive`.
    pub fn receive_until_quiet(
        &mut self,
        ends: &[u8],
        quiet: Duration,
        deadline: Instant,
    ) -> Result<(Vec<u8>, bool), DeviceError> {
        self.receive_or_quiet(ends, Some(quiet), deadline)
    }

    fn receive_or_quiet(
        &mut self,
        ends: &[u8],
        quiet: Option<Duration>,
        deadline: Instant,
    ) -> Result<(Vec<u8>, bool), DeviceError> {
        let given = deadline.saturating_duration_since(Instant::now());
        loop {
            if let Some(at) = self.received.iter().position(|b| ends.contains(b)) {
                let mut line: Vec<u8> = self.received.drain(..=at).collect();
                line.pop();
                return Ok((line, true));
            }
            if self.received.len() > LONGEST {
                let bytes = std::mem::take(&mut self.received);
                return Err(
                    super::ProtocolError::new("the end of a reply", &bytes).of(&self.device)
                );
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(self.late(given));
            }
            let wait = match quiet {
                Some(quiet) if !self.received.is_empty() => quiet.min(left),
                _ => left,
            };
            if !self.fill(wait)? && quiet.is_some() && !self.received.is_empty() {
                return Ok((std::mem::take(&mut self.received), false));
            }
        }
    }

    /// Reads once. False if nothing came within `wait`.
    fn fill(&mut self, wait: Duration) -> Result<bool, DeviceError> {
        let Some(connection) = &mut self.connection else { return Err(self.gone()) };
        let mut buffer = [0; 512];
        // A wait of nothing means "for ever" to sockets.
        match connection.read(&mut buffer, wait.max(Duration::from_millis(1))) {
            Ok(n) if n > 0 => {
                self.received.extend(buffer.iter().take(n));
                Ok(true)
            }
            Err(error) if is_timeout(&error) => Ok(false),
            Ok(_) | Err(_) => Err(self.gone()),
        }
    }

    /// Whether the same may succeed a moment later. A path that vanishes is a plug that was pulled
    /// and may be put back; one that never was there is a slip of the pen.
    pub fn may_pass(&self, error: &DeviceError) -> bool {
        match error {
            DeviceError::Disconnected { .. } => true,
            DeviceError::NotFound { .. } => self.was_open,
            error => error.kind().is_transient(),
        }
    }

    /// Does `action`, and again after a longer and longer pause, each time over a new connection,
    /// while it fails in a way that may pass. `action` has to be harmless when repeated.
    ///
    /// # Errors
    /// The last one of `action`.
    pub fn retry<T>(
        &mut self,
        mut action: impl FnMut(&mut Self) -> Result<T, DeviceError>,
    ) -> Result<T, DeviceError> {
        let mut pause = self.patience.pause;
        let mut attempt = 1;
        loop {
            let error = match action(self) {
                Ok(done) => return Ok(done),
                Err(error) => error,
            };
            if !self.may_pass(&error) || attempt >= self.patience.attempts {
                return Err(error);
            }
            // "Busy" is an answer: the connection is good.
            if !(matches!(error, DeviceError::Busy { .. }) && self.connection.is_some()) {
                self.disconnect();
            }
            std::thread::sleep(pause);
            pause *= 2;
            attempt += 1;
        }
    }

    fn gone(&mut self) -> DeviceError {
        self.disconnect();
        DeviceError::Disconnected { device: self.device.clone() }
    }

    fn late(&self, waited: Duration) -> DeviceError {
        // Tenths: what was sent took its time, and more digits are noise in a message.
        let waited_s = (waited.as_secs_f64() * 10.0).round() / 10.0;
        DeviceError::Timeout { device: self.device.clone(), waited_s }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scripted::{Step, scripted};
    use super::*;
    use crate::DeviceErrorKind;

    #[test]
    fn lines_come_one_by_one_however_they_arrive() {
        let mut link = scripted(vec![
            Step::Expect(b"a\r"),
            Step::Reply(b"on"),
            Step::Reply(b"e\rtwo\rth"),
            Step::Reply(b"ree\r"),
        ]);
        link.send(b"a\r").unwrap();
        let deadline = link.deadline();
        assert_eq!(link.receive(b"\r", deadline).unwrap(), b"one");
        assert_eq!(link.receive(b"\r", deadline).unwrap(), b"two");
        assert_eq!(link.receive(b"\r", deadline).unwrap(), b"three");
    }

    #[test]
    fn a_reply_without_an_end_is_complete_when_it_falls_quiet() {
        let mut link = scripted(vec![Step::Expect(b"a"), Step::Reply(b"P"), Step::Silence]);
        link.send(b"a").unwrap();
        let deadline = link.deadline();
        let reply = link.receive_until_quiet(b"\r", Duration::from_millis(5), deadline);
        assert_eq!(reply.unwrap(), (b"P".to_vec(), false));
    }

    #[test]
    fn endless_garbage_is_an_error_and_not_memory() {
        let mut script = vec![Step::Expect(b"a")];
        script.extend((0..20).map(|_| Step::Reply(&[b'x'; 500])));
        let mut link = scripted(script);
        link.send(b"a").unwrap();
        let deadline = link.deadline();
        let error = link.receive(b"\r", deadline).unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Protocol);
    }

    #[test]
    fn what_passes_is_tried_again_and_what_does_not_is_not() {
        let script =
            vec![Step::Expect(b"a"), Step::Close, Step::Expect(b"a"), Step::Reply(b"ok\r")];
        let mut link = scripted(script);
        let mut tries = 0;
        let ask = |link: &mut Link| {
            tries += 1;
            link.send(b"a")?;
            let deadline = link.deadline();
            link.receive(b"\r", deadline)
        };
        assert_eq!(link.retry(ask).unwrap(), b"ok");
        assert_eq!(tries, 2);
        let mut tries = 0;
        let error = link.retry(|link| -> Result<(), _> {
            tries += 1;
            let device = link.device().to_owned();
            Err(DeviceError::Unsupported { device, reason: "no".into() })
        });
        assert_eq!((error.unwrap_err().kind(), tries), (DeviceErrorKind::Unsupported, 1));
        let mut tries = 0;
        let error = link.retry(|link| -> Result<(), _> {
            tries += 1;
            Err(link.late(Duration::ZERO))
        });
        assert_eq!((error.unwrap_err().kind(), tries), (DeviceErrorKind::Timeout, 3));
    }
}
