//! The process that is the projector's window.

use std::io::{BufReader, Write};
use std::sync::Arc;
use std::time::Duration;

use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop, OwnedDisplayHandle};
use winit::platform::x11::{EventLoopBuilderExtX11, WindowAttributesExtX11};
use winit::raw_window_handle::{HasWindowHandle, RawWindowHandle};
use winit::window::{Window, WindowId, WindowLevel};

use super::desktop::Desktop;
use super::gamma::Table;
use super::messages::{Order, Reply};
use super::surface::Picture;
use super::{Monitor, NAME, find_monitor};
use crate::DeviceError;

/// Refresh of a monitor that does not tell: the slowest in use, so that the wait is long enough.
const SLOWEST_HZ: f64 = 24.0;

/// `None` is the end of the orders.
type Next = Option<Order>;

pub(super) fn run(name: &str) -> Result<(), DeviceError> {
    let unable = |reason: String| {
        answer(&Reply::Unable(reason.clone()));
        DeviceError::Unsupported { device: NAME.into(), reason }
    };
    let desktop = Desktop::connect(None).map_err(|error| unable(error.to_string()))?;
    let monitor = find_monitor(None, name).map_err(|error| unable(error.to_string()))?;
    let events = EventLoop::<Next>::with_user_event().with_x11().build();
    let events = events.map_err(|error| unable(error.to_string()))?;
    let orders = events.create_proxy();
    let display = events.owned_display_handle();
    std::thread::spawn(move || {
        let mut pipe = BufReader::new(std::io::stdin());
        while let Ok(order) = Order::read(&mut pipe) {
            if orders.send_event(Some(order)).is_err() {
                return;
            }
        }
        let _ = orders.send_event(None);
    });
    let mut projection =
        Projection { desktop, monitor, display, shown: None, bent: None, failed: None };
    let ended = events.run_app(&mut projection);
    if let Some(table) = &projection.bent {
        projection.desktop.set_table(table);
    }
    match projection.failed {
        Some(reason) => Err(unable(reason)),
        None => ended.map_err(|error| unable(error.to_string())),
    }
}

/// One answer. If nobody listens any more the end of the orders is near.
fn answer(reply: &Reply) {
    if let Ok(line) = serde_json::to_string(reply) {
        let mut pipe = std::io::stdout().lock();
        let _ = writeln!(pipe, "{line}").and_then(|()| pipe.flush());
    }
}

struct Shown {
    window: Arc<Window>,
    /// The window's number at the server.
    number: u32,
    picture: Picture,
}

struct Projection {
    desktop: Desktop,
    monitor: Monitor,
    display: OwnedDisplayHandle,
    shown: Option<Shown>,
    /// How levels went out before, if not straight.
    bent: Option<Table>,
    /// Why there is no window.
    failed: Option<String>,
}

impl Projection {
    fn open(&mut self, events: &ActiveEventLoop) -> Result<(), String> {
        let Monitor { x, y, width, height, .. } = self.monitor;
        // Window managers place, decorate and resize; and without one "full screen" is nobody's
        // business. So it is kept out.
        let attributes = Window::default_attributes()
            .with_title("diaphane projector")
            .with_decorations(false)
            .with_resizable(false)
            .with_window_level(WindowLevel::AlwaysOnTop)
            .with_position(PhysicalPosition::new(x, y))
            .with_inner_size(PhysicalSize::new(width, height))
            .with_override_redirect(true);
        let window = events.create_window(attributes).map_err(|error| error.to_string())?;
        let window = Arc::new(window);
        window.set_cursor_visible(false);
        let number = match window.window_handle().map(|handle| handle.as_raw()) {
            Ok(RawWindowHandle::Xlib(handle)) => u32::try_from(handle.window).unwrap_or_default(),
            Ok(RawWindowHandle::Xcb(handle)) => handle.window.get(),
            _ => return Err("the window is none of an X server".into()),
        };
        self.desktop.look_after(number);
        let picture = Picture::new(Arc::clone(&window), self.display.clone(), [width, height])?;
        self.shown = Some(Shown { window, number, picture });
        self.present()
    }

    /// Presents the picture on top of all windows and waits until it stands on the screen.
    fn present(&mut self) -> Result<(), String> {
        self.straighten();
        let Some(shown) = &self.shown else { return Ok(()) };
        self.desktop.raise(shown.number);
        shown.picture.present()?;
        let hz = self.monitor.refresh_hz.unwrap_or(SLOWEST_HZ);
        std::thread::sleep(Duration::from_secs_f64(2.0 / hz.max(SLOWEST_HZ)));
        // What covered the picture before does not count against it now.
        self.desktop.was_covered();
        Ok(())
    }

    /// Whether the table of levels was bent; it no longer is.
    fn straighten(&mut self) -> bool {
        let found = self.desktop.straighten(&self.monitor);
        let bent = found.is_some();
        // The first is what was there before us.
        self.bent = self.bent.take().or(found);
        bent
    }

    /// Whether the monitor is where it was and the window covers it.
    fn in_place(&self) -> bool {
        let Some(shown) = &self.shown else { return false };
        let size = shown.window.inner_size();
        (size.width, size.height) == (self.monitor.width, self.monitor.height)
            && self.desktop.monitors().is_ok_and(|now| now.contains(&self.monitor))
    }

    fn carry_out(&mut self, order: Order) -> Reply {
        if !self.in_place() {
            return Reply::Gone;
        }
        let outcome = match order {
            Order::Show(image) => match &mut self.shown {
                Some(shown) => shown.picture.set(&image).and_then(|()| self.present()),
                None => return Reply::Gone,
            },
            Order::Confirm => {
                // Both: each mends what it finds.
                let (covered, bent) = (self.desktop.was_covered(), self.straighten());
                if !(covered || bent) {
                    return Reply::Done;
                }
                return match self.present() {
                    Ok(()) => Reply::Disturbed,
                    Err(reason) => Reply::Unable(reason),
                };
            }
        };
        match outcome {
            Ok(()) => Reply::Done,
            Err(reason) => Reply::Unable(reason),
        }
    }
}

impl ApplicationHandler<Next> for Projection {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        match self.open(events) {
            Ok(()) => answer(&Reply::Done),
            Err(reason) => {
                self.failed = Some(reason);
                events.exit();
            }
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, order: Next) {
        let Some(order) = order else {
            events.exit();
            return;
        };
        let reply = self.carry_out(order);
        if reply == Reply::Gone {
            events.exit();
        }
        answer(&reply);
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            // Something that lay above it has gone.
            WindowEvent::RedrawRequested => {
                if let Some(shown) = &self.shown {
                    // If it fails, the next order will, and is answered.
                    let _ = shown.picture.present();
                }
            }
            // Unless it is us who end it.
            WindowEvent::CloseRequested | WindowEvent::Destroyed if !events.exiting() => {
                answer(&Reply::Gone);
                events.exit();
            }
            _ => {}
        }
    }
}
