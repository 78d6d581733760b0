//! `[camera]` of a rig file.

use serde::Deserialize;

use super::SimulatedDevices;
use super::check::{Problem, wrong};
#[cfg(all(feature = "aravis", target_os = "linux"))]
use crate::devices::camera::{Aravis, GenicamSettings};
use crate::devices::camera::{CameraChoice, CameraDriver, FoundCamera};
#[cfg(all(feature = "gphoto2", target_os = "linux"))]
use crate::devices::camera::{Gphoto2, StillSettings};
#[cfg(all(feature = "v4l", target_os = "linux"))]
use crate::devices::camera::{V4l, VideoSettings};
use crate::{Camera, DeviceError};

/// `[camera]`. All drivers are known, whether this program was built with them or not, so that a
/// file means the same everywhere.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum CameraConfig {
    /// The one of the simulated rig.
    Simulated {},
    /// A GenICam camera: GigE Vision, USB3 Vision.
    Aravis {
        /// A part of its maker and model; not needed where there is only one.
        name: Option<String>,
        /// Its serial number.
        serial: Option<String>,
        /// By its GenICam name, such as BayerRG12; the deepest that it has if left out.
        pixel_format: Option<String>,
        /// dB, or in the camera's own numbers where it counts otherwise; the lowest if left out.
        gain: Option<f64>,
        /// Left, top, width and height of the part of the sensor that is read, pixels; all of it
        /// if left out.
        roi: Option<[u32; 4]>,
    },
    /// A tethered still camera.
    Gphoto2 {
        /// A part of its maker and model, or its port; not needed where there is only one.
        name: Option<String>,
        /// In the camera's words, such as f/8; as it is set at the camera if left out.
        aperture: Option<String>,
        /// In the camera's words, such as 100; as it is set at the camera if left out.
        iso: Option<String>,
        /// In the camera's words, a JPEG or a raw one; as it is set at the camera if left out.
        image_format: Option<String>,
    },
    /// A video device of Linux.
    V4l {
        /// A part of what it is called; not needed where there is only one.
        name: Option<String>,
        /// Its path, such as /dev/video0 or /dev/v4l/by-id/..., or its bus.
        device: Option<String>,
        /// By its four characters, such as Y10; the deepest that is understood if left out.
        pixel_format: Option<String>,
        /// Width and height, pixels; the largest if left out.
        size: Option<[u32; 2]>,
        /// In the camera's own numbers; the lowest if left out.
        gain: Option<i32>,
    },
}

impl CameraConfig {
    /// The driver's name in the file.
    pub fn driver(&self) -> &'static str {
        self.camera_driver().map_or("simulated", CameraDriver::name)
    }

    /// The driver; `None` for the simulated one, which needs none.
    pub fn camera_driver(&self) -> Option<CameraDriver> {
        match self {
            Self::Simulated {} => None,
            Self::Aravis { .. } => Some(CameraDriver::Aravis),
            Self::Gphoto2 { .. } => Some(CameraDriver::Gphoto2),
            Self::V4l { .. } => Some(CameraDriver::V4l),
        }
    }

    /// What it says about which camera it means.
    pub fn choice(&self) -> CameraChoice {
        match self {
            Self::Simulated {} => CameraChoice::default(),
            Self::Aravis { name, serial, .. } => {
                CameraChoice { name: name.clone(), serial: serial.clone(), device: None }
            }
            Self::Gphoto2 { name, .. } => {
                CameraChoice { name: name.clone(), ..CameraChoice::default() }
            }
            Self::V4l { name, device, .. } => {
                CameraChoice { name: name.clone(), device: device.clone(), serial: None }
            }
        }
    }

    /// The camera that it means, not opened yet; `None` for the simulated one.
    ///
    /// # Errors
    /// None is there, more than one may be meant, or this program was built without the driver.
    pub fn find(&self) -> Result<Option<FoundCamera>, DeviceError> {
        let Some(driver) = self.camera_driver() else { return Ok(None) };
        if !driver.is_built() {
            return Err(self.missing(driver));
        }
        driver.find(&self.choice()).map(Some)
    }

    /// The camera, ready to expose.
    ///
    /// # Errors
    /// It is not there, not free, cannot do what is asked of it, or this program was built without
    /// its driver.
    pub fn open(&self, simulated: &dyn SimulatedDevices) -> Result<Box<dyn Camera>, DeviceError> {
        match self {
            Self::Simulated {} => simulated.camera(),
            #[cfg(all(feature = "aravis", target_os = "linux"))]
            Self::Aravis { pixel_format, gain, roi, .. } => {
                let (pixel_format, choice) = (pixel_format.clone(), self.choice());
                let settings = GenicamSettings { choice, pixel_format, gain: *gain, roi: *roi };
                Ok(Box::new(Aravis::open(settings)?))
            }
            #[cfg(not(all(feature = "aravis", target_os = "linux")))]
            Self::Aravis { .. } => Err(self.missing(CameraDriver::Aravis)),
            #[cfg(all(feature = "gphoto2", target_os = "linux"))]
            Self::Gphoto2 { aperture, iso, image_format, .. } => {
                let (aperture, iso) = (aperture.clone(), iso.clone());
                let (choice, image_format) = (self.choice(), image_format.clone());
                let settings = StillSettings { choice, aperture, iso, image_format };
                Ok(Box::new(Gphoto2::open(settings)?))
            }
            #[cfg(not(all(feature = "gphoto2", target_os = "linux")))]
            Self::Gphoto2 { .. } => Err(self.missing(CameraDriver::Gphoto2)),
            #[cfg(all(feature = "v4l", target_os = "linux"))]
            Self::V4l { pixel_format, size, gain, .. } => {
                let (pixel_format, choice) = (pixel_format.clone(), self.choice());
                let settings = VideoSettings { choice, pixel_format, size: *size, gain: *gain };
                Ok(Box::new(V4l::open(settings)?))
            }
            #[cfg(not(all(feature = "v4l", target_os = "linux")))]
            Self::V4l { .. } => Err(self.missing(CameraDriver::V4l)),
        }
    }

    fn missing(&self, driver: CameraDriver) -> DeviceError {
        DeviceError::MissingDriver { device: self.choice().to_string(), driver: driver.name() }
    }

    pub(super) fn check(&self) -> Result<(), Problem> {
        let CameraChoice { name, serial, device } = self.choice();
        for (key, text) in
            [("camera.name", &name), ("camera.serial", &serial), ("camera.device", &device)]
        {
            if text.as_ref().is_some_and(|text| text.trim().is_empty()) {
                return wrong(key, "what the camera says of itself", "nothing");
            }
        }
        match self {
            Self::Simulated {} => {}
            Self::V4l { pixel_format, size, .. } => {
                if let Some(format) = pixel_format
                    && !(1..=4).contains(&format.trim().len())
                {
                    let expected = "four characters, such as GREY or Y10";
                    return wrong("camera.pixel_format", expected, format!("{format:?}"));
                }
                // Sensors of a hundred thousand pixels across are not made.
                if let Some(size) = size
                    && !size.iter().all(|side| (1..=100_000).contains(side))
                {
                    return wrong("camera.size", "width and height in pixels", format!("{size:?}"));
                }
            }
            Self::Gphoto2 { aperture, iso, image_format, .. } => {
                for (key, text) in
                    [("aperture", aperture), ("iso", iso), ("image_format", image_format)]
                {
                    if text.as_ref().is_some_and(|text| text.trim().is_empty()) {
                        return wrong(
                            format!("camera.{key}"),
                            "the camera's word for it",
                            "nothing",
                        );
                    }
                }
            }
            Self::Aravis { pixel_format, gain, roi, .. } => {
                if let Some(format) = pixel_format
                    && (format.is_empty() || !format.bytes().all(|b| b.is_ascii_alphanumeric()))
                {
                    let expected = "a GenICam name, such as BayerRG12";
                    return wrong("camera.pixel_format", expected, format!("{format:?}"));
                }
                if let Some(gain) = gain
                    && !gain.is_finite()
                {
                    return wrong("camera.gain", "a number", gain);
                }
                if let Some(roi @ [x, y, width, height]) = roi {
                    let ends = [x.checked_add(*width), y.checked_add(*height)];
                    // Sensors of a hundred thousand pixels across are not made.
                    let good = |end: &Option<u32>| end.is_some_and(|end| end <= 100_000);
                    if *width == 0 || *height == 0 || !ends.iter().all(good) {
                        let expected = "left, top, width and height in pixels";
                        return wrong("camera.roi", expected, format!("{roi:?}"));
                    }
                }
            }
        }
        Ok(())
    }
}
