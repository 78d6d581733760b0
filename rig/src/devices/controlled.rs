//! A projector's picture and its remote control as one.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};

use crate::devices::{PowerState, ProjectorControl, Stage};
use crate::{DeviceError, Projector, ProjectorImage, ProjectorInfo};

/// A device that somebody else may want to put away meanwhile.
pub(crate) type Shared<T> = Arc<Mutex<Box<T>>>;

/// Nobody leaves a driver half done when it panics: it speaks in whole requests.
pub(crate) fn lock<T: ?Sized>(shared: &Mutex<Box<T>>) -> MutexGuard<'_, Box<T>> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Shows pictures, and knows whether there is light behind them.
pub(crate) struct ControlledProjector {
    pub display: Box<dyn Projector>,
    pub control: Shared<dyn ProjectorControl>,
}

impl Projector for ControlledProjector {
    fn info(&self) -> ProjectorInfo {
        self.display.info()
    }

    fn show(&mut self, image: &ProjectorImage) -> Result<(), DeviceError> {
        self.display.show(image)
    }

    /// Asks the projector itself: a lamp that has gone out is seen by nobody else.
    fn still_shows(&mut self) -> Result<(), DeviceError> {
        self.display.still_shows()?;
        let mut control = lock(&self.control);
        let why = match control.power_state()? {
            // Whoever cools down or warms up answers nothing else.
            PowerState::On if control.av_mute()? == Some(true) => "it is muted".to_owned(),
            PowerState::On => return Ok(()),
            state => format!("it is {state}"),
        };
        let device = control.name().unwrap_or_else(|_| "projector".into());
        Err(DeviceError::Fault { device, reason: format!("{why}, in the middle of a capture") })
    }

    fn park(&mut self) -> Result<(), DeviceError> {
        self.display.park()?;
        lock(&self.control).set_power(false)
    }
}

/// Puts a rig's devices away while somebody else is using it.
#[derive(Clone, Default)]
pub struct Parking {
    pub(crate) stage: Option<Shared<dyn Stage>>,
    pub(crate) control: Option<Shared<dyn ProjectorControl>>,
}

/// The longest that parking waits for a device that is in the middle of something.
const MOST_BUSY: Duration = Duration::from_secs(10);

impl Parking {
    /// Sends the stage to its parking places, `limit` for each, and switches the projector off
    /// without waiting until it is cool. Returns what went wrong; one device's trouble does not
    /// keep the other.
    pub fn park(&self, limit: Duration) -> Vec<DeviceError> {
        let stage = self
            .stage
            .as_ref()
            .map(|stage| within(stage, "stage").and_then(|mut stage| stage.park(limit)));
        let control = self.control.as_ref().map(|control| {
            within(control, "projector").and_then(|mut control| control.set_power(false))
        });
        [stage, control].into_iter().flatten().filter_map(Result::err).collect()
    }
}

fn within<'a, T: ?Sized>(
    shared: &'a Shared<T>,
    device: &str,
) -> Result<MutexGuard<'a, Box<T>>, DeviceError> {
    let until = Instant::now() + MOST_BUSY;
    loop {
        match shared.try_lock() {
            Ok(guard) => return Ok(guard),
            Err(TryLockError::Poisoned(poisoned)) => return Ok(poisoned.into_inner()),
            Err(TryLockError::WouldBlock) if Instant::now() >= until => {
                return Err(DeviceError::Busy { device: device.into() });
            }
            Err(TryLockError::WouldBlock) => std::thread::sleep(Duration::from_millis(20)),
        }
    }
}
