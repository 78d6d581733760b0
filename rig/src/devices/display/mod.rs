//! The projector's picture in a window that covers one monitor: grey level v of the image is
//! (v, v, v) on the screen, pixel by pixel, whatever desktop there is.
//!
//! The window lives in a process of its own ([`run_window`]): libraries of the display server end
//! the process when their connection breaks, a window can be created only once in a process, and
//! neither must take a capture along. `Display` starts that process, hands it pictures through a
//! pipe and waits for what it says; when the capture is gone, its window goes too.
//!
//! Beside the window itself it sees to it that the picture stays: above all other windows, not
//! blanked by a screen saver, and not bent by a night light's or colour profile's table on its way
//! out, which is put back in the end.
//!
//! ## When a picture counts as shown
//! It was presented with vertical synchronisation ("Fifo"), the graphics device has finished
//! drawing it, and two periods of the monitor's refresh have passed since: the first may still show
//! the picture before, or a compositor may need it. What no computer is told is how long the
//! projector itself takes from its input to its light. [`SETTLE_S`] is waited for that, or what the
//! rig file says.

#[cfg(all(feature = "display", target_os = "linux"))]
mod desktop;
#[cfg(all(feature = "display", target_os = "linux"))]
mod gamma;
#[cfg(all(feature = "display", target_os = "linux"))]
mod messages;
#[cfg(all(feature = "display", target_os = "linux"))]
mod projector;
#[cfg(all(feature = "display", target_os = "linux"))]
mod surface;
#[cfg(all(feature = "display", target_os = "linux"))]
mod window;

use serde::Serialize;

#[cfg(all(feature = "display", target_os = "linux"))]
pub use projector::{Display, WindowProgram};

use crate::DeviceError;

/// Wait for a projector's own electronics where the rig file has no `settle_ms`, seconds: scalers
/// and keystone correction hold back a few frames, and six at 60 Hz is generous.
pub const SETTLE_S: f64 = 0.1;

/// The first argument by which a program that was started as `PROGRAM projector-window MONITOR`
/// knows that it is to be the window: it then calls [`run_window`] and does nothing else.
pub const WINDOW_COMMAND: &str = "projector-window";

/// A monitor, or a projector, as the display server sees it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Monitor {
    /// Of the connector, such as HDMI-1.
    pub name: String,
    /// Left edge on the desktop, pixels.
    pub x: i32,
    /// Upper edge on the desktop, pixels.
    pub y: i32,
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pictures a second, where the server knows.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refresh_hz: Option<f64>,
}

impl std::fmt::Display for Monitor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({} x {}", self.name, self.width, self.height)?;
        if let Some(hz) = self.refresh_hz {
            write!(f, ", {hz:.0} Hz")?;
        }
        f.write_str(")")
    }
}

/// The monitors that show a picture, in the order of the X display `server`, such as `:0`; `None`
/// is the one that the environment variable `DISPLAY` names.
///
/// # Errors
/// There is no X display server to ask, or this program was built without the feature `display`.
pub fn list_monitors(server: Option<&str>) -> Result<Vec<Monitor>, DeviceError> {
    #[cfg(all(feature = "display", target_os = "linux"))]
    return desktop::Desktop::connect(server)?.monitors();
    #[cfg(not(all(feature = "display", target_os = "linux")))]
    {
        let _ = server;
        Err(missing())
    }
}

/// The monitor of that name at a server, as in [`list_monitors`].
///
/// # Errors
/// Those of [`list_monitors`], and that there is none of that name; those that there are are
/// listed then.
pub fn find_monitor(server: Option<&str>, name: &str) -> Result<Monitor, DeviceError> {
    let monitors = list_monitors(server)?;
    monitors.iter().find(|monitor| monitor.name == name).cloned().ok_or_else(|| {
        DeviceError::NoneSuch {
            device: format!("monitor {name:?}"),
            there: monitors.iter().map(Monitor::to_string).collect(),
        }
    })
}

/// Makes this process the projector's window on the monitor of that name, at the server that
/// `DISPLAY` names, until standard input ends. Orders come in on standard input and are answered on
/// standard output.
///
/// # Errors
/// No window could be opened; whoever started it was told as well.
pub fn run_window(monitor: &str) -> Result<(), DeviceError> {
    #[cfg(all(feature = "display", target_os = "linux"))]
    return window::run(monitor);
    #[cfg(not(all(feature = "display", target_os = "linux")))]
    {
        let _ = monitor;
        Err(missing())
    }
}

/// What there is instead of a window in a program that was built without one.
#[cfg(not(all(feature = "display", target_os = "linux")))]
pub(crate) fn missing() -> DeviceError {
    DeviceError::MissingDriver { device: NAME.into(), driver: "display" }
}

/// In messages.
const NAME: &str = "projector window";
