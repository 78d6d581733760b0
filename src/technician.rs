//! The person who puts things on the bench.

use rig::{Bench, DeviceError, Target};
use std::io::{BufRead, IsTerminal};

/// Asks on the terminal, and waits; not again for what was placed last.
#[derive(Default)]
pub(crate) struct Technician {
    placed: Option<Target>,
}

impl Bench for Technician {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        let declined = |reason: &str| DeviceError::Declined {
            device: "technician".into(),
            reason: reason.into(),
        };
        if self.placed == Some(*target) {
            return Ok(());
        }
        self.placed = None;
        let stdin = std::io::stdin();
        if !stdin.is_terminal() {
            return Err(declined(&format!(
                "somebody has to put {target} on the rig, and standard input is no terminal to ask on; a rig file can name a program: [hands]"
            )));
        }
        eprintln!("put on the rig: {target}; then press Enter (q and Enter stops)");
        let mut line = String::new();
        match stdin.lock().read_line(&mut line) {
            Ok(0) => Err(declined("nobody is there any more")),
            Ok(_) if line.trim() == "q" => {
                Err(declined("stopped; the same command goes on from here"))
            }
            Ok(_) => {
                self.placed = Some(*target);
                Ok(())
            }
            Err(error) => Err(declined(&error.to_string())),
        }
    }
}
