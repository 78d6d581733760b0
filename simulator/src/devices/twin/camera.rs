//! The camera of the twin.

use rig::devices::PowerState;
use rig::{Camera, CameraInfo, DeviceError, Frame, Projector, ProjectorImage, Readback};

use crate::devices::{Screen, SimulatedProjector};

/// The simulated camera, looking at a sample that is lit by what really stands on a monitor, while
/// the projector is on and not muted.
pub(super) struct TwinCamera {
    camera: Box<dyn Camera>,
    projector: Box<dyn Projector>,
    screen: Screen,
    lamp: SimulatedProjector,
}

impl TwinCamera {
    /// `camera` and `projector` are those of one simulated rig, `lamp` is what its remote control
    /// switches.
    ///
    /// # Errors
    /// The monitor has another size than the projector's picture.
    pub(super) fn new(
        camera: Box<dyn Camera>,
        projector: Box<dyn Projector>,
        screen: Screen,
        lamp: SimulatedProjector,
    ) -> Result<Self, DeviceError> {
        let info = projector.info();
        let monitor = screen.monitor();
        if (monitor.width, monitor.height) != (info.width, info.height) {
            let reason = format!(
                "its picture has {} x {} pixels, the monitor is {monitor}",
                info.width, info.height
            );
            return Err(DeviceError::Unsupported { device: info.name, reason });
        }
        Ok(Self { camera, projector, screen, lamp })
    }
}

impl Camera for TwinCamera {
    fn info(&self) -> CameraInfo {
        self.camera.info()
    }

    fn announce(&mut self, number: usize, repeat: u32) {
        self.camera.announce(number, repeat);
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        let mut image: ProjectorImage = self.screen.picture()?;
        if self.lamp.power() != PowerState::On || self.lamp.mute() {
            image.data.fill(0);
        }
        self.projector.show(&image)?;
        self.camera.expose(exposure_s)
    }

    fn readback(&mut self) -> Result<Readback, DeviceError> {
        self.camera.readback()
    }
}
