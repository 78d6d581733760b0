//! What the tests of cameras, of projectors and of stages share; none needs all of it.
#![allow(dead_code, reason = "each test program uses a part")]

use std::time::Duration;

use rig::devices::Patience;
use rig::{Camera, CameraInfo, DeviceError, Frame, Readback};

/// A second is much for an answer of a few bytes, and little for a machine with other things to do.
pub const PATIENCE: Patience =
    Patience { reply: Duration::from_secs(1), attempts: 3, pause: Duration::from_millis(30) };

/// Waiting is most of what these tests do, so they wait for all protocols at once.
pub fn for_each_protocol(protocols: &[&'static str], test: impl Fn(&'static str) + Sync) {
    std::thread::scope(|scope| {
        for protocol in protocols {
            let test = &test;
            scope.spawn(move || test(protocol));
        }
    });
}

/// A camera whose every value is known.
#[derive(Clone)]
pub struct TestCamera {
    pub info: CameraInfo,
    pub temperature_c: Option<f64>,
    /// Takes no pictures.
    pub fails: bool,
}

impl TestCamera {
    pub fn new(width: u32, height: u32, channels: u8, bit_depth: u8) -> Self {
        let info = CameraInfo { name: "test camera".into(), width, height, channels, bit_depth };
        Self { info, temperature_c: None, fails: false }
    }
}

impl Camera for TestCamera {
    fn info(&self) -> CameraInfo {
        self.info.clone()
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        if self.fails {
            let device = self.info.name.clone();
            return Err(DeviceError::Fault { device, reason: "told to fail".into() });
        }
        let CameraInfo { width, height, channels, bit_depth, .. } = self.info;
        let count = width as usize * height as usize * usize::from(channels);
        let microseconds = (exposure_s * 1e6).round() as u64;
        // Each value another, and other ones for another exposure.
        let value = |i: u64| (i * 40_503 + microseconds * 7) % (1 << bit_depth);
        let data = (0..count as u64).map(|i| value(i) as u16).collect();
        Ok(Frame { width, height, channels, bit_depth, data, exposure_s })
    }

    fn readback(&mut self) -> Result<Readback, DeviceError> {
        Ok(Readback { temperature_c: self.temperature_c, ..Readback::default() })
    }
}
