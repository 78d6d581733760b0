//! A connection that plays a script, for tests of drivers without a device.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::{Connection, Link, Patience};

/// What happens next on the wire.
pub(super) enum Step {
    /// The driver has to send exactly this.
    Expect(&'static [u8]),
    /// The device sends this.
    Reply(&'static [u8]),
    /// Nothing comes for once.
    Silence,
    /// The connection is lost.
    Close,
}

struct Scripted {
    steps: Arc<Mutex<VecDeque<Step>>>,
    sent: Vec<u8>,
}

/// A link whose device does what `steps` say; connections that are opened again go on with them.
pub(super) fn scripted(steps: Vec<Step>) -> Link {
    let steps = Arc::new(Mutex::new(VecDeque::from(steps)));
    let patience =
        Patience { reply: Duration::from_millis(50), attempts: 3, pause: Duration::from_millis(1) };
    Link::new("scripted device", patience, move |_| {
        Ok(Box::new(Scripted { steps: Arc::clone(&steps), sent: Vec::new() }))
    })
}

impl Connection for Scripted {
    fn read(&mut self, into: &mut [u8], _: Duration) -> io::Result<usize> {
        let mut steps = self.steps.lock().unwrap();
        match steps.front() {
            Some(Step::Reply(bytes)) => {
                let n = bytes.len();
                into[..n].copy_from_slice(bytes);
                steps.pop_front();
                Ok(n)
            }
            Some(Step::Close) => {
                steps.pop_front();
                Err(io::ErrorKind::BrokenPipe.into())
            }
            Some(Step::Silence) => {
                steps.pop_front();
                Err(io::ErrorKind::TimedOut.into())
            }
            Some(Step::Expect(_)) | None => Err(io::ErrorKind::TimedOut.into()),
        }
    }

    fn write(&mut self, bytes: &[u8], _: Duration) -> io::Result<()> {
        let mut steps = self.steps.lock().unwrap();
        self.sent.extend(bytes);
        match steps.front() {
            Some(Step::Expect(expected)) if self.sent == *expected => {
                steps.pop_front();
                self.sent.clear();
            }
            Some(Step::Expect(expected)) if expected.starts_with(&self.sent) => {}
            _ => panic!("the driver sent \"{}\" out of turn", self.sent.escape_ascii()),
        }
        Ok(())
    }
}
