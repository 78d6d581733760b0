//! The capture's side of the window.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use super::messages::{Order, Reply};
use super::{Monitor, NAME, WINDOW_COMMAND, find_monitor};
use crate::{DeviceError, Projector, ProjectorImage, ProjectorInfo};

/// Starting a graphics driver takes a second or two, on a busy machine more.
const START: Duration = Duration::from_secs(30);
/// For one picture.
const ANSWER: Duration = Duration::from_secs(10);
/// For a window that was told to go.
const END: Duration = Duration::from_secs(2);

/// The program that is started as `PROGRAM projector-window MONITOR` and then calls
/// [`super::run_window`].
#[derive(Clone, Debug)]
pub struct WindowProgram(PathBuf);

impl WindowProgram {
    /// This program itself, even when its file has been replaced meanwhile.
    pub fn this() -> Self {
        Self("/proc/self/exe".into())
    }

    /// Another one.
    pub fn at(path: &Path) -> Self {
        Self(path.into())
    }
}

/// A projector as one of the computer's monitors.
pub struct Display {
    server: Option<String>,
    monitor: Monitor,
    settle: Duration,
    program: WindowProgram,
    /// Not there before the first picture that follows a disconnection.
    window: Option<Process>,
}

impl Display {
    /// Opens a black window that covers the monitor of that name at a server, as in
    /// [`super::list_monitors`]. After each picture `settle` is waited, for the projector's own
    /// electronics ([`super::SETTLE_S`]).
    ///
    /// # Errors
    /// No X display server, no such monitor (those that there are are listed), or nothing that can
    /// draw on it.
    pub fn open(
        server: Option<&str>,
        monitor: &str,
        settle: Duration,
        program: &WindowProgram,
    ) -> Result<Self, DeviceError> {
        let monitor = find_monitor(server, monitor)?;
        let window = Some(Process::start(program, server, &monitor.name)?);
        Ok(Self {
            server: server.map(str::to_owned),
            monitor,
            settle,
            program: program.clone(),
            window,
        })
    }

    /// The monitor.
    pub fn monitor(&self) -> &Monitor {
        &self.monitor
    }

    /// Asks the window, which is opened again if it was lost before.
    fn order(&mut self, order: Order) -> Result<(), DeviceError> {
        if self.window.is_none() {
            self.window = Some(self.again()?);
        }
        let Some(window) = &self.window else { return Err(disconnected()) };
        let outcome = window.order(order).and_then(|()| window.answer(ANSWER));
        if outcome.as_ref().is_err_and(|error| !matches!(error, DeviceError::Busy { .. })) {
            self.window = None;
        }
        outcome
    }

    fn again(&self) -> Result<Process, DeviceError> {
        let server = self.server.as_deref();
        let now = find_monitor(server, &self.monitor.name)?;
        if (now.width, now.height) != (self.monitor.width, self.monitor.height) {
            return Err(DeviceError::Unsupported {
                device: NAME.into(),
                reason: format!("the monitor was {}, now it is {now}", self.monitor),
            });
        }
        Process::start(&self.program, server, &now.name)
    }
}

impl Projector for Display {
    fn info(&self) -> ProjectorInfo {
        let Monitor { name, width, height, .. } = &self.monitor;
        ProjectorInfo { name: format!("monitor {name}"), width: *width, height: *height }
    }

    fn show(&mut self, image: &ProjectorImage) -> Result<(), DeviceError> {
        let Monitor { width, height, .. } = self.monitor;
        let pixels = width as usize * height as usize;
        if (image.width, image.height) != (width, height) || image.data.len() != pixels {
            return Err(DeviceError::Unsupported {
                device: NAME.into(),
                reason: format!(
                    "an image of {} x {} on {width} x {height} pixels",
                    image.width, image.height
                ),
            });
        }
        self.order(Order::Show(image.clone()))?;
        std::thread::sleep(self.settle);
        Ok(())
    }

    fn still_shows(&mut self) -> Result<(), DeviceError> {
        // A window that is opened again now has shown nothing.
        if self.window.is_none() {
            return Err(disconnected());
        }
        self.order(Order::Confirm)
    }

    fn park(&mut self) -> Result<(), DeviceError> {
        self.window = None;
        Ok(())
    }
}

fn disconnected() -> DeviceError {
    DeviceError::Disconnected { device: NAME.into() }
}

/// The running window.
struct Process {
    child: Child,
    /// Dropped first in the end: the window's input then ends, and the window with it.
    orders: Option<Sender<Order>>,
    replies: Receiver<Reply>,
}

impl Process {
    fn start(
        program: &WindowProgram,
        server: Option<&str>,
        monitor: &str,
    ) -> Result<Self, DeviceError> {
        use std::os::unix::process::CommandExt;
        let started = Command::new(&program.0)
            .envs(server.map(|server| ("DISPLAY", server)))
            .args([WINDOW_COMMAND, monitor])
            // Pixels are pixels, whatever a desktop holds for readable.
            .env("WINIT_X11_SCALE_FACTOR", "1")
            // Ctrl-C is for the capture, which ends the window when it is done with it.
            .process_group(0)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let mut child = started.map_err(|error| DeviceError::Unsupported {
            device: NAME.into(),
            reason: format!("{} cannot be started: {error}", program.0.display()),
        })?;
        let (Some(mut input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(disconnected());
        };
        let errors = child.stderr.take();
        // Drivers chatter; only the last words of a window that never opens are of interest.
        let last_words = std::thread::spawn(move || {
            let lines = errors.into_iter().flat_map(|pipe| BufReader::new(pipe).lines());
            lines.map_while(Result::ok).filter(|line| !line.trim().is_empty()).last()
        });
        // Threads, so that a window that hangs holds nobody up: whoever waits does so for a while.
        let (orders, coming) = channel::<Order>();
        std::thread::spawn(move || {
            while let Ok(order) = coming.recv() {
                if order.write(&mut input).is_err() {
                    return;
                }
            }
        });
        let (said, replies) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                // What is not for us is what a driver prints.
                if let Ok(reply) = serde_json::from_str(&line)
                    && said.send(reply).is_err()
                {
                    return;
                }
            }
        });
        let window = Self { child, orders: Some(orders), replies };
        match window.answer(START) {
            Ok(()) => Ok(window),
            Err(DeviceError::Disconnected { device }) => {
                drop(window);
                let words = last_words.join().ok().flatten().unwrap_or_default();
                let reason = format!("the process that opens it ended: {words}");
                Err(DeviceError::Unsupported { device, reason })
            }
            Err(error) => Err(error),
        }
    }

    fn order(&self, order: Order) -> Result<(), DeviceError> {
        let orders = self.orders.as_ref().ok_or_else(disconnected)?;
        orders.send(order).map_err(|_| disconnected())
    }

    fn answer(&self, limit: Duration) -> Result<(), DeviceError> {
        let device = || NAME.to_owned();
        match self.replies.recv_timeout(limit) {
            Ok(Reply::Done) => Ok(()),
            Ok(Reply::Disturbed) => Err(DeviceError::Busy {
                device: format!("{NAME} (something had covered the picture or bent its levels)"),
            }),
            Ok(Reply::Unable(reason)) => Err(DeviceError::Unsupported { device: device(), reason }),
            Ok(Reply::Gone) | Err(RecvTimeoutError::Disconnected) => Err(disconnected()),
            Err(RecvTimeoutError::Timeout) => {
                Err(DeviceError::Timeout { device: device(), waited_s: limit.as_secs_f64() })
            }
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.orders = None;
        let told = Instant::now();
        while told.elapsed() < END {
            if !matches!(self.child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        // It is gone already, or it will be.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
