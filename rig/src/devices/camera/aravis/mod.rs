//! GenICam cameras (GigE Vision, USB3 Vision) by the library Aravis.

mod library;
mod settings;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use aravis::glib::object::Cast;
use aravis::prelude::*;
use aravis::{
    Buffer, BufferPayloadType, BufferStatus, GvDevice, GvStream, GvStreamOption,
    GvStreamSocketBuffer,
};

use super::self_test::RETAKEN;
use super::{FoundCamera, PixelFormat};
use crate::{Camera, CameraInfo, DeviceError, Frame, Readback};
use library::device_error;
pub use library::scan;
pub use settings::GenicamSettings;
use settings::{Refusal, Set, Start};

/// A GenICam camera.
///
/// It takes one frame at a time: by software trigger where the camera has that, else in its
/// single-frame mode. Mosaics become pictures of half the width and height, see
/// [`superpixels`](super::superpixels). A frame that arrives with holes is taken again, up to
/// three times; how often is told by [`Camera::readback`] as `frames retaken`. A camera that is
/// gone is looked for again with every call.
pub struct Aravis {
    settings: GenicamSettings,
    /// The camera that was meant in the beginning; later it has to be that very one.
    found: FoundCamera,
    info: CameraInfo,
    connection: Option<Connection>,
    retaken: u32,
}

/// An open camera. The stream goes before the camera that it is of.
struct Connection {
    stream: aravis::Stream,
    camera: aravis::Camera,
    set: Set,
    running: bool,
    lost: Arc<AtomicBool>,
}

/// Why there is no frame.
enum Failed {
    /// The camera took one, but it did not arrive as a whole: in the library's words.
    Incomplete(String),
    Device(DeviceError),
}

/// From the end of the exposure to the last byte: three hundred megabytes over Gigabit Ethernet.
const TRANSFER: Duration = Duration::from_secs(3);
/// How often it is looked whether the camera is still there while it exposes.
const LOOK: Duration = Duration::from_millis(100);
/// A network that loses parts of four frames in a row needs somebody.
const RETAKES: u32 = 3;
/// Room for packets that is asked for at least, bytes.
const SOCKET: i32 = 4 << 20;
/// One is filled while the other is looked at.
const BUFFERS: usize = 2;

impl Aravis {
    /// Finds the camera and sets it up.
    ///
    /// # Errors
    /// There is none or more than one of that name, it is in use elsewhere, may not be opened, or
    /// cannot do what `settings` ask for.
    pub fn open(settings: GenicamSettings) -> Result<Self, DeviceError> {
        let found = settings.choice.pick(super::CameraDriver::Aravis.scan())?;
        let connection = Connection::open(&found, &settings)?;
        let info = connection.info(&found);
        Ok(Self { settings, found, info, connection: Some(connection), retaken: 0 })
    }

    /// The camera, opened again if need be.
    fn connection(&mut self) -> Result<&mut Connection, DeviceError> {
        let lost = |c: &Connection| c.lost.load(Ordering::Relaxed);
        if self.connection.as_ref().is_some_and(lost) {
            self.connection = None;
        }
        if self.connection.is_none() {
            if !self.is_there() {
                return Err(self.gone());
            }
            let connection = Connection::open(&self.found, &self.settings)?;
            let info = connection.info(&self.found);
            if info != self.info {
                let reason = format!("it came back as {info:?}, and was {:?}", self.info);
                return Err(DeviceError::Fault { device: self.found.to_string(), reason });
            }
            self.connection = Some(connection);
        }
        self.connection
            .as_mut()
            .ok_or_else(|| DeviceError::Disconnected { device: self.found.to_string() })
    }

    fn is_there(&self) -> bool {
        scan().iter().any(|camera| camera.id == self.found.id)
    }

    fn gone(&self) -> DeviceError {
        DeviceError::Disconnected { device: self.found.to_string() }
    }

    /// After an error nobody knows what state the camera is in: it is opened anew the next time.
    /// One that did not answer, and does not answer when all cameras are asked either, is gone.
    fn give_up(&mut self, error: DeviceError) -> DeviceError {
        if matches!(error, DeviceError::Unsupported { .. }) {
            return error;
        }
        if let Some(connection) = self.connection.take() {
            let silent = matches!(
                error,
                DeviceError::Timeout { .. }
                    | DeviceError::Protocol { .. }
                    | DeviceError::NotFound { .. }
            );
            let lost = &connection.lost;
            if lost.load(Ordering::Relaxed) || (silent && !self.is_there()) {
                lost.store(true, Ordering::Relaxed);
                return self.gone();
            }
        }
        error
    }
}

impl Camera for Aravis {
    fn info(&self) -> CameraInfo {
        self.info.clone()
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        self.retaken = 0;
        let device = self.found.to_string();
        loop {
            let taken = self.connection()?.take(&device, exposure_s);
            match taken {
                Ok(frame) => return Ok(frame),
                Err(Failed::Incomplete(_)) if self.retaken < RETAKES => self.retaken += 1,
                Err(Failed::Incomplete(what)) => {
                    let expected = format!("a whole frame in {} attempts", RETAKES + 1);
                    let bytes = what.into_bytes();
                    return Err(self.give_up(DeviceError::Protocol { device, expected, bytes }));
                }
                Err(Failed::Device(error)) => return Err(self.give_up(error)),
            }
        }
    }

    fn readback(&mut self) -> Result<Readback, DeviceError> {
        let retaken = self.retaken;
        let device = self.found.to_string();
        let connection = self.connection()?;
        let told = settings::readback(&connection.camera, connection.set.start);
        let mut told = told.map_err(|error| self.give_up(device_error(&device, &error)))?;
        if retaken > 0 {
            told.settings.insert(RETAKEN.into(), retaken.to_string());
        }
        Ok(told)
    }
}

/// Whether nobody else has a camera; it is not told anything.
///
/// # Errors
/// Somebody has, or it may not be opened.
pub fn is_free(found: &FoundCamera) -> Result<(), DeviceError> {
    let device = found.to_string();
    let camera = aravis::Camera::new(Some(&found.id)).map_err(|e| device_error(&device, &e))?;
    let inner = camera.device();
    match inner.as_ref().and_then(|inner| inner.downcast_ref::<GvDevice>()) {
        Some(gige) if !gige.is_controller() => Err(DeviceError::Busy { device }),
        _ => Ok(()),
    }
}

impl Connection {
    fn open(found: &FoundCamera, settings: &GenicamSettings) -> Result<Self, DeviceError> {
        let device = found.to_string();
        let wrong = |error: &aravis::glib::Error| device_error(&device, error);
        let camera = aravis::Camera::new(Some(&found.id)).map_err(|error| wrong(&error))?;
        let lost = Arc::new(AtomicBool::new(false));
        if let Some(inner) = camera.device() {
            let flag = Arc::clone(&lost);
            inner.connect_control_lost(move |_| flag.store(true, Ordering::Relaxed));
            if let Some(gige) = inner.downcast_ref::<GvDevice>() {
                // Another program that has the camera lets us look, but not touch.
                if !gige.is_controller() {
                    return Err(DeviceError::Busy { device });
                }
                // Sockets of that kind are for those who may do everything; nothing is as fast
                // here that it would need them.
                gige.set_stream_options(GvStreamOption::PACKET_SOCKET_DISABLED);
            }
        }
        let set = settings::apply(&camera, settings).map_err(|refusal| match refusal {
            Refusal::Library(error) => wrong(&error),
            Refusal::Cannot(reason) => DeviceError::Unsupported { device: device.clone(), reason },
        })?;
        let payload = camera.payload().map_err(|error| wrong(&error))?;
        let stream = library::create_stream(&camera).map_err(|error| wrong(&error))?;
        let Some(stream) = stream else { return Err(DeviceError::Busy { device }) };
        if let Some(gige) = stream.downcast_ref::<GvStream>() {
            // Room for a whole frame and some, as far as the system allows: the camera does not
            // wait while this program has no turn.
            let room = i32::try_from(payload).unwrap_or(i32::MAX).max(SOCKET);
            gige.set_socket_buffer(GvStreamSocketBuffer::Fixed);
            gige.set_socket_buffer_size(room);
        }
        for _ in 0..BUFFERS {
            stream.push_buffer(Buffer::new_allocate(payload as usize));
        }
        Ok(Self { stream, camera, set, running: false, lost })
    }

    fn info(&self, found: &FoundCamera) -> CameraInfo {
        let Set { format, width, height, .. } = self.set;
        let [width, height] = format.size(width, height);
        let (channels, bit_depth) = (format.channels(), format.bits);
        CameraInfo { name: found.to_string(), width, height, channels, bit_depth }
    }

    /// One frame, as a whole.
    fn take(&mut self, device: &str, exposure_s: f64) -> Result<Frame, Failed> {
        let wrong = |error: aravis::glib::Error| Failed::Device(device_error(device, &error));
        let exposure_us = self.set_exposure(device, exposure_s)?;
        // What is late from an earlier exposure is not this frame.
        while let Some(stale) = self.stream.try_pop_buffer() {
            self.stream.push_buffer(stale);
        }
        if !self.running {
            self.camera.start_acquisition().map_err(wrong)?;
            self.running = true;
        }
        if self.set.start == Start::SoftwareTrigger {
            self.camera.software_trigger().map_err(wrong)?;
        }
        let limit = Duration::from_secs_f64(exposure_us / 1e6) + TRANSFER;
        let buffer = self.wait(device, limit)?;
        let frame = self.read(device, &buffer, exposure_us / 1e6);
        self.stream.push_buffer(buffer);
        if self.set.start == Start::SingleFrame {
            self.running = false;
            self.camera.stop_acquisition().map_err(wrong)?;
        }
        frame
    }

    /// The exposure that the camera made of it, microseconds.
    fn set_exposure(&self, device: &str, exposure_s: f64) -> Result<f64, Failed> {
        let wrong = |error: aravis::glib::Error| Failed::Device(device_error(device, &error));
        let unsupported = |reason: String| {
            Failed::Device(DeviceError::Unsupported { device: device.to_owned(), reason })
        };
        let (shortest, longest) = self.camera.exposure_time_bounds().map_err(wrong)?;
        let asked = exposure_s * 1e6;
        // By less than a microsecond outside is a matter of rounding: cameras count in those.
        if !(shortest - 1.0..=longest + 1.0).contains(&asked) {
            let (shortest, longest) = (shortest / 1e6, longest / 1e6);
            return Err(unsupported(format!(
                "an exposure of {exposure_s} s: it has {shortest} s to {longest} s"
            )));
        }
        self.camera.set_exposure_time(asked.clamp(shortest, longest)).map_err(wrong)?;
        let told = self.camera.exposure_time().map_err(wrong)?;
        // An hour is the longest that anybody waits; beyond is nonsense.
        if !(told > 0.0 && told <= 3.6e9) {
            return Err(unsupported(format!(
                "asked for an exposure of {exposure_s} s, it says that it has one of {told} us"
            )));
        }
        Ok(told)
    }

    fn wait(&self, device: &str, limit: Duration) -> Result<Buffer, Failed> {
        let started = Instant::now();
        loop {
            if let Some(buffer) = self.stream.timeout_pop_buffer(LOOK.as_micros() as u64) {
                return Ok(buffer);
            }
            let device = device.to_owned();
            if self.lost.load(Ordering::Relaxed) {
                return Err(Failed::Device(DeviceError::Disconnected { device }));
            }
            if started.elapsed() > limit {
                let waited_s = limit.as_secs_f64();
                return Err(Failed::Device(DeviceError::Timeout { device, waited_s }));
            }
        }
    }

    fn read(&self, device: &str, buffer: &Buffer, exposure_s: f64) -> Result<Frame, Failed> {
        let status = buffer.status();
        if status != BufferStatus::Success {
            return Err(Failed::Incomplete(format!("{status:?}")));
        }
        let nonsense = |expected: String, found: String| {
            let bytes = found.into_bytes();
            Failed::Device(DeviceError::Protocol { device: device.to_owned(), expected, bytes })
        };
        let payload = buffer.payload_type();
        if !matches!(payload, BufferPayloadType::Image | BufferPayloadType::ExtendedChunkData) {
            return Err(nonsense("a picture".into(), format!("{payload:?}")));
        }
        let Set { format, width, height, .. } = self.set;
        let [w, h] = [buffer.image_width(), buffer.image_height()];
        if [w, h].map(i64::from) != [width, height].map(i64::from) {
            return Err(nonsense(format!("{width} x {height} pixels"), format!("{w} x {h}")));
        }
        let code = buffer.image_pixel_format().raw();
        if PixelFormat::of_code(code) != Some(format) {
            return Err(nonsense(format!("{format:?}"), format!("pixel format {code:#010x}")));
        }
        let Some((bytes, padding)) = library::image(buffer) else {
            return Err(nonsense("a picture".into(), "no bytes".into()));
        };
        let pixels = format
            .decode(width, height, padding, &bytes)
            .map_err(|error| nonsense(error.expected, error.found))?;
        let frame = Frame {
            width: pixels.width,
            height: pixels.height,
            channels: pixels.channels,
            bit_depth: format.bits,
            data: pixels.data,
            exposure_s,
        };
        match frame.check() {
            Ok(()) => Ok(frame),
            Err(error) => Err(nonsense("a picture of the stated depth".into(), error.to_string())),
        }
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        // One that is gone would only be waited for.
        if self.running && !self.lost.load(Ordering::Relaxed) {
            // It is closed in the next moment; there is nobody left to tell.
            let _ = self.camera.stop_acquisition();
        }
    }
}
