//! The person who puts things on the bench.

use crate::cli::STOP;
use rig::{Bench, DeviceError, Target};
use std::io::{BufRead, IsTerminal};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Between two looks at whether Ctrl-C was pressed.
const BLINK: Duration = Duration::from_millis(50);

/// A line that somebody types; `None` where they stop instead, by Ctrl-C, by Ctrl-D, or by q, or
/// their terminal is gone. Nothing more is begun then.
pub(crate) fn answer() -> Option<String> {
    // Reading cannot be ended, so that somebody else waits for it; the program ends without them.
    let (typed, line) = channel();
    std::thread::spawn(move || {
        let mut line = String::new();
        let read = std::io::stdin().lock().read_line(&mut line);
        // Who asked may have gone.
        let _ = typed.send(matches!(read, Ok(1..)).then(|| line.trim().to_owned()));
    });
    let line = loop {
        match line.recv_timeout(BLINK) {
            Ok(line) => break line,
            Err(RecvTimeoutError::Timeout) if STOP.load(Ordering::Relaxed) => break None,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break None,
        }
    };
    let line = line.filter(|line| line != "q");
    if line.is_none() {
        STOP.store(true, Ordering::Relaxed);
    }
    line
}

/// Asks on the terminal, and waits; not again for what was placed last.
#[derive(Default)]
pub(crate) struct Technician {
    placed: Option<Target>,
}

impl Bench for Technician {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        let declined =
            |reason: String| DeviceError::Declined { device: "technician".into(), reason };
        if self.placed == Some(*target) {
            return Ok(());
        }
        self.placed = None;
        if !std::io::stdin().is_terminal() {
            return Err(declined(format!(
                "somebody has to put {target} on the rig, and standard input is no terminal to ask on; a rig file can name a program: [hands]"
            )));
        }
        eprintln!("put on the rig: {target}; then press Enter (q and Enter stops)");
        match answer() {
            Some(_) => {
                self.placed = Some(*target);
                Ok(())
            }
            None => Err(declined(format!("stopped before {target} was on the rig"))),
        }
    }
}
