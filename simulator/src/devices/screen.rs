//! What stands on a monitor, as a projector would throw it at the sample; and a monitor in memory.

use std::io::{self, BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::channel;
use std::time::Duration;

use rig::devices::{Monitor, find_monitor, list_monitors};
use rig::{DeviceError, ProjectorImage};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ConnectionExt, ImageFormat, ImageOrder, Window};
use x11rb::rust_connection::RustConnection;

/// An X server whose one monitor is a piece of memory: Xvfb. It goes when this is dropped.
pub struct VirtualScreen {
    child: Child,
    server: String,
}

/// It starts in a fraction of a second.
const START: Duration = Duration::from_secs(20);

impl VirtualScreen {
    /// Starts one, on a free display number.
    ///
    /// # Errors
    /// Xvfb is not installed or does not start.
    pub fn start(width: u32, height: u32) -> io::Result<Self> {
        let mut child = Command::new("Xvfb")
            .args(["-displayfd", "1", "-nolisten", "tcp", "-noreset"])
            .args(["-screen", "0", &format!("{width}x{height}x24")])
            // Ctrl-C is for whoever started it.
            .process_group(0)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()?;
        let output = child.stdout.take();
        // From here on it is ended on every way out.
        let mut screen = Self { child, server: String::new() };
        let (said, number) = channel();
        std::thread::spawn(move || {
            let mut line = String::new();
            let read = output.map(|output| BufReader::new(output).read_line(&mut line));
            if matches!(read, Some(Ok(1..))) {
                let _ = said.send(line);
            }
        });
        let number = number.recv_timeout(START).map_err(|_| io::ErrorKind::TimedOut)?;
        screen.server = format!(":{}", number.trim());
        Ok(screen)
    }

    /// The server's name, such as `:1`.
    pub fn server(&self) -> &str {
        &self.server
    }
}

impl Drop for VirtualScreen {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Looks at one monitor.
pub struct Screen {
    connection: RustConnection,
    root: Window,
    monitor: Monitor,
}

impl Screen {
    /// Looks at a monitor of an X server, each as in [`list_monitors`]; at the first one where
    /// none is named.
    ///
    /// # Errors
    /// There is no such server or monitor, or its pixels are not of 8 bits a colour.
    pub fn open(server: Option<&str>, monitor: Option<&str>) -> Result<Self, DeviceError> {
        let monitor = match monitor {
            Some(name) => find_monitor(server, name)?,
            None => list_monitors(server)?
                .into_iter()
                .next()
                .ok_or_else(|| DeviceError::NotFound { device: "monitor".into() })?,
        };
        let failed = |error: &dyn std::fmt::Display| unsupported(error.to_string());
        let (connection, number) = x11rb::connect(server).map_err(|error| failed(&error))?;
        let setup = connection.setup();
        let screen = setup.roots.get(number).ok_or_else(|| failed(&"no such screen"))?;
        let (root, depth) = (screen.root, screen.root_depth);
        let formats = &setup.pixmap_formats;
        let bits = formats.iter().find(|format| format.depth == depth).map(|f| f.bits_per_pixel);
        if (depth, bits, setup.image_byte_order) != (24, Some(32), ImageOrder::LSB_FIRST) {
            return Err(unsupported(format!(
                "a screen of 24 bits a pixel in 32 is needed, this has {depth} in {}",
                bits.unwrap_or_default()
            )));
        }
        Ok(Self { connection, root, monitor })
    }

    /// The monitor.
    pub fn monitor(&self) -> &Monitor {
        &self.monitor
    }

    /// What stands there now. The simulated projector knows grey alone: of a colour it gets the
    /// mean.
    ///
    /// # Errors
    /// The server is gone.
    pub fn picture(&self) -> Result<ProjectorImage, DeviceError> {
        let Monitor { x, y, width, height, .. } = self.monitor;
        let gone = || DeviceError::Disconnected { device: NAME.into() };
        let size = |n: u32| u16::try_from(n).map_err(|_| gone());
        let place = |n: i32| i16::try_from(n).map_err(|_| gone());
        let (x, y, columns, rows) = (place(x)?, place(y)?, size(width)?, size(height)?);
        let pixels = ImageFormat::Z_PIXMAP;
        let asked = self.connection.get_image(pixels, self.root, x, y, columns, rows, u32::MAX);
        let image = asked.map_err(|_| gone())?.reply().map_err(|_| gone())?;
        let grey = |pixel: &[u8]| {
            let sum: u32 = pixel.iter().take(3).map(|&level| u32::from(level)).sum();
            ((sum + 1) / 3) as u8
        };
        let data: Vec<u8> = image.data.chunks_exact(4).map(grey).collect();
        if data.len() != width as usize * height as usize {
            return Err(gone());
        }
        Ok(ProjectorImage { width, height, data })
    }
}

const NAME: &str = "screen of the twin";

fn unsupported(reason: String) -> DeviceError {
    DeviceError::Unsupported { device: NAME.into(), reason }
}
