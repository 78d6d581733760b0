//! Tethered still cameras (Canon, Nikon, Sony and others) by the library gphoto2.

mod picture;
mod shutter;

use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use gphoto2::error::ErrorKind;
use gphoto2::list::CameraDescriptor;
use gphoto2::widget::{RadioWidget, TextWidget};

use super::{CameraChoice, CameraDriver, FoundCamera};
use crate::{Camera, CameraInfo, DeviceError, Frame, Readback};
use picture::{Picture, decode};
use shutter::{nearest, seconds, within};

/// Which still camera, and what it is set to; its own words, as its display or the error that
/// lists them has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StillSettings {
    /// Which camera. Of two of a kind: the port, such as `usb:001,005`, as the name.
    pub choice: CameraChoice,
    /// Such as `f/8`; as it is set at the camera if left out.
    pub aperture: Option<String>,
    /// Such as `100`; as it is set at the camera if left out.
    pub iso: Option<String>,
    /// Such as `Large Fine JPEG` or `RAW`; as it is set at the camera if left out.
    pub image_format: Option<String>,
}

/// A still camera.
///
/// Its exposures are a list: the nearest is taken, by ratio, and its nominal time told (what a
/// camera calls 1/30 may be 1/32: the merge measures such steps where exposures overlap). Where a
/// raw file notes another time, that is told.
///
/// Pictures are JPEG, 8 bits through a curve that `calibrate response` finds, or camera raw files
/// (DNG, CR2, CR3, NEF, ARW): linear codes, black included, of as many bits as the sensor's white
/// needs, as [`superpixels`](super::superpixels) of half its width and height. What reaches white
/// becomes the largest number. One picture is taken when the camera is opened, to know their size
/// and bits.
///
/// The library keeps one thread for all that it does, which may hang for good with a camera; each
/// call here ends in time nevertheless.
pub struct Gphoto2 {
    settings: StillSettings,
    found: FoundCamera,
    info: CameraInfo,
    open: Option<gphoto2::Camera>,
    context: gphoto2::Context,
}

/// To look for cameras, to open one, to change a setting.
const ASK: Duration = Duration::from_secs(10);
/// From the end of the exposure to the last byte: writing to the card, and forty megabytes.
const TRANSFER: Duration = Duration::from_secs(20);
/// A camera that is busy for longer is not busy.
const BUSY: Duration = Duration::from_secs(10);
const AGAIN: Duration = Duration::from_millis(200);
/// Names of settings, by maker; the first that a camera has is taken.
const SHUTTER: [&str; 2] = ["shutterspeed2", "shutterspeed"];
const APERTURE: [&str; 2] = ["f-number", "aperture"];
const ISO: [&str; 1] = ["iso"];
const FORMAT: [&str; 2] = ["imagequality", "imageformat"];

/// The cameras that are plugged in, opened or not.
pub fn scan() -> Vec<FoundCamera> {
    let listed = bounded("still cameras", ASK, || {
        let list = gphoto2::Context::new()?.list_cameras().wait()?;
        Ok(list.collect::<Vec<CameraDescriptor>>())
    });
    let found = |camera: CameraDescriptor| FoundCamera {
        driver: CameraDriver::Gphoto2,
        name: camera.model,
        id: camera.port.clone(),
        serial: None,
        address: Some(camera.port),
        bus: None,
        fake: false,
        problem: None,
    };
    listed.unwrap_or_default().into_iter().map(found).collect()
}

impl Gphoto2 {
    /// Finds the camera, sets it up and takes a picture.
    ///
    /// # Errors
    /// There is none or more than one of that name, it is in use elsewhere, may not be opened, or
    /// cannot do what `settings` ask for.
    pub fn open(settings: StillSettings) -> Result<Self, DeviceError> {
        let found = settings.choice.pick(CameraDriver::Gphoto2.scan())?;
        let device = found.to_string();
        let context = bounded(&device, ASK, gphoto2::Context::new)?;
        let name = device.clone();
        let info = CameraInfo { name, width: 0, height: 0, channels: 3, bit_depth: 8 };
        let mut camera = Self { settings, found, info, open: None, context };
        camera.connect()?;
        let first = camera.photograph(Duration::from_secs(60));
        let first = first.map_err(|error| camera.give_up(error))?;
        (camera.info.width, camera.info.height) = (first.width, first.height);
        camera.info.bit_depth = first.bit_depth;
        Ok(camera)
    }

    fn connect(&mut self) -> Result<gphoto2::Camera, DeviceError> {
        if let Some(camera) = &self.open {
            return Ok(camera.clone());
        }
        let device = self.found.to_string();
        let (context, model, port) =
            (self.context.clone(), self.found.name.clone(), self.found.id.clone());
        let opened = bounded(&device, ASK, move || {
            context.get_camera(&CameraDescriptor { model, port }).wait()
        })?;
        self.open = Some(opened.clone());
        // Where the camera can, pictures do not fill its card. Many cannot.
        let _ = self.choose(&["capturetarget"], "Internal RAM");
        let StillSettings { aperture, iso, image_format, .. } = self.settings.clone();
        for (keys, wanted) in
            [(&APERTURE[..], aperture), (&ISO[..], iso), (&FORMAT[..], image_format)]
        {
            if let Some(wanted) = wanted {
                self.choose(keys, &wanted).map_err(|error| self.give_up(error))?;
            }
        }
        Ok(opened)
    }

    /// A setting that is chosen from a list, under the first of its names that the camera knows.
    fn radio(&mut self, keys: &[&'static str]) -> Result<RadioWidget, DeviceError> {
        let device = self.found.to_string();
        let Some(camera) = self.open.clone() else {
            return Err(DeviceError::Disconnected { device });
        };
        let owned = keys.to_vec();
        let found = bounded(&device, ASK, move || {
            let ask = |key: &&str| camera.config_key::<RadioWidget>(key).wait().ok();
            Ok(owned.iter().find_map(ask))
        })?;
        let reason = || format!("it has no setting \"{}\"", keys.join("\" or \""));
        found.ok_or_else(|| DeviceError::Unsupported { device, reason: reason() })
    }

    fn choose(&mut self, keys: &[&'static str], wanted: &str) -> Result<(), DeviceError> {
        let widget = self.radio(keys)?;
        if widget.choice() == wanted {
            return Ok(());
        }
        let choices: Vec<String> = widget.choices_iter().collect();
        let device = self.found.to_string();
        if !choices.iter().any(|choice| choice == wanted) {
            let reason =
                format!("no {} \"{wanted}\"; it has {}", widget.name(), choices.join(", "));
            return Err(DeviceError::Unsupported { device, reason });
        }
        let Some(camera) = self.open.clone() else {
            return Err(DeviceError::Disconnected { device });
        };
        let wanted = wanted.to_owned();
        bounded(&device, ASK, move || {
            widget.set_choice(&wanted)?;
            patiently(|| camera.set_config(&widget).wait())
        })
    }

    /// A picture as it is set.
    fn photograph(&mut self, limit: Duration) -> Result<Picture, DeviceError> {
        let device = self.found.to_string();
        let Some(camera) = self.open.clone() else {
            return Err(DeviceError::Disconnected { device });
        };
        let context = self.context.clone();
        let (name, bytes) = bounded(&device, limit, move || {
            let path = patiently(|| camera.capture_image().wait())?;
            let (folder, name) = (path.folder().into_owned(), path.name().into_owned());
            let file = patiently(|| camera.fs().download(&folder, &name).wait())?;
            let bytes = file.get_data(&context).wait()?;
            Ok((name, bytes))
        })?;
        decode(&device, &name, bytes.into_vec())
    }

    /// After an error the camera is opened anew the next time; one that hangs is left alone, since
    /// closing it would hang as well.
    fn give_up(&mut self, error: DeviceError) -> DeviceError {
        match (&error, self.open.take()) {
            (DeviceError::Unsupported { .. }, open) => self.open = open,
            (DeviceError::Timeout { .. }, Some(open)) => std::mem::forget(open),
            _ => {}
        }
        error
    }
}

impl Camera for Gphoto2 {
    fn info(&self) -> CameraInfo {
        self.info.clone()
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        self.connect()?;
        let taken = self.set_shutter(exposure_s).and_then(|shutter_s| {
            let limit = Duration::try_from_secs_f64(shutter_s).unwrap_or_default();
            Ok((shutter_s, self.photograph(limit + TRANSFER)?))
        });
        let (nominal_s, picture) = taken.map_err(|error| self.give_up(error))?;
        let Picture { width, height, bit_depth, data, exposure_s } = picture;
        let exposure_s = exposure_s.unwrap_or(nominal_s);
        Ok(Frame { width, height, channels: 3, bit_depth, data, exposure_s })
    }

    fn readback(&mut self) -> Result<Readback, DeviceError> {
        let camera = self.connect()?;
        let device = self.found.to_string();
        let settings = bounded(&device, ASK, move || {
            let keys = SHUTTER.iter().chain(&APERTURE).chain(&ISO).chain(&FORMAT);
            let ask = |key: &&str| {
                let value = camera.config_key::<RadioWidget>(key).wait().ok()?.choice();
                Some(((*key).to_owned(), value))
            };
            let mut told: std::collections::BTreeMap<_, _> = keys.filter_map(ask).collect();
            if let Ok(serial) = camera.config_key::<TextWidget>("serialnumber").wait() {
                told.insert("serialnumber".into(), serial.value());
            }
            Ok(told)
        });
        let settings = settings.map_err(|error| self.give_up(error))?;
        Ok(Readback { temperature_c: None, settings })
    }
}

impl Gphoto2 {
    /// The exposure that the camera has for `exposure_s`, set; seconds.
    fn set_shutter(&mut self, exposure_s: f64) -> Result<f64, DeviceError> {
        let choices: Vec<String> = self.radio(&SHUTTER)?.choices_iter().collect();
        let times = choices.iter().filter_map(|choice| Some((seconds(choice)?, choice)));
        let times: Vec<(f64, &String)> = times.collect();
        let device = self.found.to_string();
        let ends = times.iter().fold((f64::INFINITY, 0.0_f64), |(least, most), (time, _)| {
            (least.min(*time), most.max(*time))
        });
        let nearest = nearest(&times, exposure_s);
        let Some((time, choice)) = nearest.filter(|_| within(exposure_s, ends)) else {
            let reason = match times.is_empty() {
                true => "it offers no exposure times; set it to M".into(),
                false => {
                    format!("an exposure of {exposure_s} s: it has {} s to {} s", ends.0, ends.1)
                }
            };
            return Err(DeviceError::Unsupported { device, reason });
        };
        let choice = choice.clone();
        self.choose(&SHUTTER, &choice)?;
        Ok(time)
    }
}

/// The library's own errors, for as long as the camera says that it is busy.
fn patiently<T>(mut work: impl FnMut() -> gphoto2::Result<T>) -> gphoto2::Result<T> {
    let started = Instant::now();
    loop {
        match work() {
            Err(error) if error.kind() == ErrorKind::CameraBusy && started.elapsed() < BUSY => {
                std::thread::sleep(AGAIN);
            }
            outcome => return outcome,
        }
    }
}

/// Does `work` within `limit`; what takes longer is left to itself.
fn bounded<T: Send + 'static>(
    device: &str,
    limit: Duration,
    work: impl FnOnce() -> gphoto2::Result<T> + Send + 'static,
) -> Result<T, DeviceError> {
    let (done, wait) = channel();
    std::thread::spawn(move || {
        // Nobody listens any more where it took too long.
        let _ = done.send(work());
    });
    let device = device.to_owned();
    match wait.recv_timeout(limit) {
        Ok(outcome) => outcome.map_err(|error| device_error(device, &error)),
        Err(RecvTimeoutError::Timeout) => {
            Err(DeviceError::Timeout { device, waited_s: limit.as_secs_f64() })
        }
        Err(RecvTimeoutError::Disconnected) => {
            Err(DeviceError::Fault { device, reason: "the library that drives it gave up".into() })
        }
    }
}

fn device_error(device: String, error: &gphoto2::Error) -> DeviceError {
    match error.kind() {
        ErrorKind::CameraBusy | ErrorKind::IoUsbClaim | ErrorKind::IoLock => {
            DeviceError::Busy { device }
        }
        ErrorKind::ModelNotFound | ErrorKind::IoUsbFind => DeviceError::NotFound { device },
        ErrorKind::Io | ErrorKind::IoRead | ErrorKind::IoWrite => {
            DeviceError::Disconnected { device }
        }
        ErrorKind::Timeout => DeviceError::Timeout { device, waited_s: ASK.as_secs_f64() },
        ErrorKind::CorruptedData => DeviceError::Protocol {
            device,
            expected: "an answer in its protocol".into(),
            bytes: error.to_string().into_bytes(),
        },
        _ => DeviceError::Unsupported { device, reason: error.to_string() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DeviceErrorKind;

    #[test]
    fn what_hangs_ends_and_what_gives_up_is_told() {
        let slow = || {
            std::thread::sleep(Duration::from_secs(5));
            Ok(())
        };
        let error = bounded("x", Duration::from_millis(20), slow).unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Timeout);
        let broken = || -> gphoto2::Result<()> { std::panic::resume_unwind(Box::new(())) };
        let error = bounded("x", Duration::from_secs(5), broken).unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Fault);
    }
}
