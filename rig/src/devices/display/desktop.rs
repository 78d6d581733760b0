//! What the display server tells of its monitors, and what it is asked for beyond a window.

use x11rb::connection::Connection;
use x11rb::errors::ReplyError;
use x11rb::protocol::Event;
use x11rb::protocol::randr::{ConnectionExt as _, Crtc, ModeFlag, ModeInfo};
use x11rb::protocol::screensaver::ConnectionExt as _;
use x11rb::protocol::xproto::{
    ChangeWindowAttributesAux, ConfigureWindowAux, ConnectionExt as _, EventMask, StackMode,
    Visibility, Window,
};
use x11rb::rust_connection::RustConnection;

use super::{Monitor, NAME};
use crate::DeviceError;

/// A connection of our own to the X server: one that returns errors where others end the process.
pub(super) struct Desktop {
    pub(super) connection: RustConnection,
    root: Window,
}

impl Desktop {
    /// Connects to a server, such as `:0`; `None` is the one that `DISPLAY` names.
    pub(super) fn connect(server: Option<&str>) -> Result<Self, DeviceError> {
        let named = std::env::var("DISPLAY").ok().filter(|name| !name.is_empty());
        let Some(name) = server.map(str::to_owned).or(named) else {
            let device = "X display server (DISPLAY is not set)".into();
            return Err(DeviceError::NotFound { device });
        };
        let not_there = |why: &dyn std::fmt::Display| DeviceError::NotFound {
            device: format!("X display server {name} ({why})"),
        };
        let connected = x11rb::connect(Some(&name));
        let (connection, screen) = connected.map_err(|error| not_there(&error))?;
        let root = connection.setup().roots.get(screen).map(|screen| screen.root);
        let root = root.ok_or_else(|| not_there(&"it has no such screen"))?;
        Ok(Self { connection, root })
    }

    pub(super) fn monitors(&self) -> Result<Vec<Monitor>, DeviceError> {
        let outputs = self.outputs().map_err(|error| DeviceError::Unsupported {
            device: NAME.into(),
            reason: format!("the display server does not tell its monitors: {error}"),
        })?;
        Ok(outputs.into_iter().map(|(_, monitor)| monitor).collect())
    }

    /// Monitors, and what makes their picture.
    pub(super) fn outputs(&self) -> Result<Vec<(Crtc, Monitor)>, ReplyError> {
        let connection = &self.connection;
        // Servers before 1.3 do not know the request that does not probe anew.
        connection.randr_query_version(1, 3)?.reply()?;
        let resources = connection.randr_get_screen_resources_current(self.root)?.reply()?;
        let mut monitors = Vec::new();
        for &output in &resources.outputs {
            let at = resources.config_timestamp;
            let output = connection.randr_get_output_info(output, at)?.reply()?;
            // Nothing is shown there.
            if output.crtc == 0 {
                continue;
            }
            let shown = connection.randr_get_crtc_info(output.crtc, at)?.reply()?;
            let mode = resources.modes.iter().find(|mode| mode.id == shown.mode);
            let monitor = Monitor {
                name: String::from_utf8_lossy(&output.name).into_owned(),
                x: shown.x.into(),
                y: shown.y.into(),
                width: shown.width.into(),
                height: shown.height.into(),
                refresh_hz: mode.and_then(refresh_hz),
            };
            monitors.push((output.crtc, monitor));
        }
        Ok(monitors)
    }

    /// Takes care of a window from now on: it is told when something covers it, and the screen
    /// is not blanked or switched off while this connection lasts.
    pub(super) fn look_after(&self, window: Window) {
        let events = ChangeWindowAttributesAux::new().event_mask(EventMask::VISIBILITY_CHANGE);
        // Where the server does not know one of these the window does without.
        let _ = self.connection.change_window_attributes(window, &events);
        let _ = self.connection.screensaver_query_version(1, 1);
        let _ = self.connection.screensaver_suspend(1);
        let _ = self.connection.flush();
    }

    /// Puts the window above all others.
    pub(super) fn raise(&self, window: Window) {
        let above = ConfigureWindowAux::new().stack_mode(StackMode::ABOVE);
        let _ = self.connection.configure_window(window, &above);
        let _ = self.connection.flush();
    }

    /// Whether something covered the window, or a part of it, since this was last asked.
    pub(super) fn was_covered(&self) -> bool {
        // A round trip: what happened before it has arrived afterwards.
        let _ = self.connection.get_input_focus().map(|cookie| cookie.reply());
        let mut covered = false;
        while let Ok(Some(event)) = self.connection.poll_for_event() {
            if let Event::VisibilityNotify(event) = event {
                covered |= event.state != Visibility::UNOBSCURED;
            }
        }
        covered
    }
}

/// Pictures a second; `None` where the server has made the mode up.
fn refresh_hz(mode: &ModeInfo) -> Option<f64> {
    let mut lines = f64::from(mode.vtotal);
    if mode.mode_flags.contains(ModeFlag::INTERLACE) {
        lines /= 2.0;
    }
    if mode.mode_flags.contains(ModeFlag::DOUBLE_SCAN) {
        lines *= 2.0;
    }
    let hz = f64::from(mode.dot_clock) / (f64::from(mode.htotal) * lines);
    (hz.is_finite() && hz > 0.0).then_some(hz)
}
