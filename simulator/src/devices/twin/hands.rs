//! The hands of the twin: a program for a rig file's `[hands]`, and who does what it is told.

use std::fs;
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use material::{FileError, Overwrite, atomic_write};
use rig::{Bench, Target};

/// Waits until the twin has taken the order, and fails if it could not be carried out.
const PROGRAM: &str = "#!/bin/sh
cd \"$(dirname \"$0\")\" || exit 1
rm -f refused
printf '%s' \"$1\" > order.new && mv order.new order || exit 1
while [ -e order ]; do sleep 0.02; done
[ ! -e refused ]
";

/// Between two looks for an order.
const LOOK: Duration = Duration::from_millis(5);

/// Ends when it is dropped.
pub(super) struct Hands {
    program: PathBuf,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Hands {
    /// Writes the program into `folder`, and puts on `bench` what it is called with from now on.
    pub(super) fn start(folder: &Path, mut bench: Box<dyn Bench>) -> Result<Self, FileError> {
        let program = folder.join("hands");
        let io = |action| {
            let path = program.clone();
            move |source| FileError::Io { path, action, source }
        };
        atomic_write(&program, Overwrite::Replace, |file| file.write_all(PROGRAM.as_bytes()))?;
        let rights = fs::Permissions::from_mode(0o755);
        fs::set_permissions(&program, rights).map_err(io("make a program of"))?;
        let ends = Arc::new(AtomicBool::new(false));
        let (order, refused) = (folder.join("order"), folder.join("refused"));
        // Left over from a twin before this one.
        for file in [&order, &refused] {
            let _ = fs::remove_file(file);
        }
        let stop = Arc::clone(&ends);
        let thread = std::thread::spawn(move || {
            while !stop.load(Ordering::Relaxed) {
                if let Ok(text) = fs::read(&order) {
                    let placed = place(&text, bench.as_mut());
                    if placed.is_err() {
                        // The program that waits looks for nothing but the file.
                        let _ = fs::write(&refused, b"");
                    }
                    let _ = fs::remove_file(&order);
                }
                std::thread::sleep(LOOK);
            }
        });
        Ok(Self { program, ends, thread: Some(thread) })
    }

    /// The program.
    pub(super) fn program(&self) -> &Path {
        &self.program
    }
}

fn place(order: &[u8], bench: &mut dyn Bench) -> io::Result<()> {
    let target: Target = serde_json::from_slice(order)?;
    bench.place(&target).map_err(io::Error::other)
}

impl Drop for Hands {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in there has been reported; there is nothing to add.
            let _ = thread.join();
        }
    }
}
