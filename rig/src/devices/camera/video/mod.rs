//! Cameras that Linux knows as `/dev/video0` and the like (V4L2): grey industrial modules, frame
//! grabbers, webcams.

mod find;
mod format;
mod node;
mod settings;
mod stream;

use std::path::Path;
use std::time::Duration;

use super::self_test::RETAKEN;
use super::{CameraChoice, FoundCamera};
use crate::{Camera, CameraInfo, DeviceError, Frame, Readback};
use find::device_error;
pub use find::{find, is_free, scan};
use format::Grey;
use node::{Layout, Node};
use settings::Refusal;
use stream::{Raw, Stream};

/// Which video device, and what it is set to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VideoSettings {
    /// Which camera.
    pub choice: CameraChoice,
    /// A pixel format by its four characters, such as `Y10`; `None` for the deepest that is
    /// understood.
    pub pixel_format: Option<String>,
    /// Width and height, pixels; `None` for the largest.
    pub size: Option<[u32; 2]>,
    /// Gain in the camera's own numbers; `None` for the lowest.
    pub gain: Option<i32>,
}

/// A video device that is given manual exposures; its pictures are grey.
///
/// It is switched on for each frame and off after it, so that no picture waits from before the
/// exposure was set. The first two frames are thrown away: the sensor may have begun the first
/// before it was told the exposure, and many have the exposure of the second fixed by then. A
/// frame with holes is taken again, up to three times; [`Camera::readback`] says `frames retaken`.
/// Frames that follow each other faster than the exposure lasts were exposed for less: they are
/// refused, where the driver says when frames came. A camera that is gone is looked for again
/// with every call.
pub struct V4l {
    settings: VideoSettings,
    /// The camera that was meant in the beginning; later it has to be that very one.
    found: FoundCamera,
    info: CameraInfo,
    open: Option<Connection>,
    retaken: u32,
}

/// An open camera.
struct Connection {
    node: Node,
    format: Grey,
    layout: Layout,
}

/// A frame, and how many had to be taken again before it.
type Taken = (Frame, u32);

/// Frames that may have been begun before the camera knew their exposure; see [`V4l`].
const STALE: u32 = 2;
/// From the end of the exposure to the last byte; webcams take long to begin.
const TRANSFER: Duration = Duration::from_secs(5);
/// A cable that loses parts of four frames in a row needs somebody.
const RETAKES: u32 = 3;
/// Frames may come this much faster than they were exposed, relative: clocks differ, and the times
/// are those of an interrupt.
const JITTER: f64 = 0.1;

impl V4l {
    /// Finds the camera and sets it up.
    ///
    /// # Errors
    /// There is none or more than one of that name, it is in use elsewhere, may not be opened, or
    /// cannot do what `settings` ask for.
    pub fn open(settings: VideoSettings) -> Result<Self, DeviceError> {
        let found = find(&settings.choice)?;
        let connection = Connection::open(&found, &settings)?;
        let info = connection.info(&found);
        Ok(Self { settings, found, info, open: Some(connection), retaken: 0 })
    }

    /// The camera, opened again if need be.
    fn connection(&mut self) -> Result<&Connection, DeviceError> {
        if self.open.is_none() {
            let device = self.found.to_string();
            // Whatever number it has now: it is the same by its serial number, or else by where
            // it is plugged in.
            let same = |camera: &FoundCamera| {
                let (serial, bus) = (&self.found.serial, &self.found.bus);
                camera.name == self.found.name
                    && if serial.is_some() { camera.serial == *serial } else { camera.bus == *bus }
            };
            let (mut back, _): (Vec<_>, Vec<_>) = scan().into_iter().partition(same);
            // Of one with two sensors both are at the same place.
            if back.len() > 1 {
                back.retain(|camera| camera.id == self.found.id);
            }
            let Some(found) = back.pop() else {
                return Err(DeviceError::Disconnected { device });
            };
            let connection = Connection::open(&found, &self.settings)?;
            let info = connection.info(&found);
            if info != self.info {
                let reason = format!("it came back as {info:?}, and was {:?}", self.info);
                return Err(DeviceError::Fault { device, reason });
            }
            (self.found, self.open) = (found, Some(connection));
        }
        let gone = || DeviceError::Disconnected { device: self.found.to_string() };
        self.open.as_ref().ok_or_else(gone)
    }

    /// After an error nobody knows what state the camera is in: it is opened anew the next time.
    fn give_up(&mut self, error: DeviceError) -> DeviceError {
        if !matches!(error, DeviceError::Unsupported { .. }) {
            self.open = None;
        }
        error
    }
}

impl Camera for V4l {
    fn info(&self) -> CameraInfo {
        self.info.clone()
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        self.connection()?;
        let found = &self.found;
        let Some(connection) = &self.open else {
            return Err(DeviceError::Disconnected { device: found.to_string() });
        };
        let taken = connection.take(found, exposure_s);
        let (frame, retaken) = taken.map_err(|error| self.give_up(error))?;
        self.retaken = retaken;
        Ok(frame)
    }

    fn readback(&mut self) -> Result<Readback, DeviceError> {
        let connection = self.connection()?;
        let told = settings::readback(&connection.node);
        let format = format::name(connection.layout.code);
        let told = told.map_err(|error| device_error(&self.found, &error));
        let told = told.map_err(|error| self.give_up(error))?;
        let told = told.into_iter().map(|(name, value)| (name.to_owned(), value.to_string()));
        let mut settings: std::collections::BTreeMap<_, _> = told.collect();
        settings.insert("pixelformat".into(), format);
        if self.retaken > 0 {
            settings.insert(RETAKEN.into(), self.retaken.to_string());
        }
        Ok(Readback { temperature_c: None, settings })
    }
}

impl Connection {
    fn open(found: &FoundCamera, settings: &VideoSettings) -> Result<Self, DeviceError> {
        let wrong = |error: std::io::Error| device_error(found, &error);
        let cannot = |reason| DeviceError::Unsupported { device: found.to_string(), reason };
        let node = Node::open(Path::new(&found.id)).map_err(wrong)?;
        node.claim().map_err(wrong)?;
        let mut offers = Vec::new();
        for code in node.formats().map_err(wrong)? {
            offers.push((code, node.sizes(code).map_err(wrong)?));
        }
        let wanted = settings.pixel_format.as_deref();
        let (format, size) = format::choose(&offers, wanted, settings.size).map_err(cannot)?;
        let layout = node.set_format(format.number(), size).map_err(wrong)?;
        check(format, &layout, settings.size).map_err(cannot)?;
        settings::apply(&node, settings.gain).map_err(|refusal| of_refusal(found, refusal))?;
        Ok(Self { node, format, layout })
    }

    fn info(&self, found: &FoundCamera) -> CameraInfo {
        let Layout { width, height, .. } = self.layout;
        let bit_depth = self.format.bits;
        CameraInfo { name: found.to_string(), width, height, channels: 1, bit_depth }
    }

    fn take(&self, found: &FoundCamera, exposure_s: f64) -> Result<Taken, DeviceError> {
        let wrong = |error: std::io::Error| device_error(found, &error);
        let offers = self.node.intervals(&self.layout);
        // Where it cannot be set the camera keeps its own; what comes too fast is seen below.
        let _ = self.node.set_interval(settings::interval(&offers, exposure_s));
        let told_s = settings::set_exposure(&self.node, exposure_s)
            .map_err(|refusal| of_refusal(found, refusal))?;
        let limit = Duration::from_secs_f64(told_s) + TRANSFER;
        let stream = Stream::start(&self.node).map_err(wrong)?;
        let next = || {
            stream.next(limit).map_err(|error| match error.kind() {
                std::io::ErrorKind::TimedOut => DeviceError::Timeout {
                    device: found.to_string(),
                    waited_s: limit.as_secs_f64(),
                },
                _ => wrong(error),
            })
        };
        let mut before = None;
        for _ in 0..STALE {
            before = Some(next()?);
        }
        let mut retaken = 0;
        loop {
            let raw = next()?;
            if let Some(apart_s) = before.as_ref().and_then(|before| apart(before, &raw))
                && apart_s < told_s * (1.0 - JITTER)
            {
                let reason = format!(
                    "it says that it exposes for {told_s} s, but sends a frame every {apart_s:.4} \
                     s: it cannot expose for longer than that"
                );
                return Err(DeviceError::Unsupported { device: found.to_string(), reason });
            }
            match self.read(&raw, told_s) {
                Ok(frame) => return Ok((frame, retaken)),
                Err(_) if retaken < RETAKES => retaken += 1,
                Err((expected, found_instead)) => {
                    return Err(DeviceError::BadFrame {
                        device: found.to_string(),
                        expected,
                        found: found_instead,
                    });
                }
            }
            before = Some(raw);
        }
    }

    /// What was expected and what came, where it is no whole picture.
    fn read(&self, raw: &Raw, exposure_s: f64) -> Result<Frame, (String, String)> {
        let whole = || format!("a whole frame in {} attempts", RETAKES + 1);
        if raw.broken {
            return Err((whole(), "frames that the driver calls broken".into()));
        }
        let data = self.format.decode(&self.layout, &raw.bytes);
        let data = data.map_err(|error| (error.expected, error.found))?;
        let Layout { width, height, .. } = self.layout;
        let bit_depth = self.format.bits;
        let frame = Frame { width, height, channels: 1, bit_depth, data, exposure_s };
        match frame.check() {
            Ok(()) => Ok(frame),
            Err(error) => Err((format!("values of {bit_depth} bits"), error.to_string())),
        }
    }
}

/// Whether a device does what it was told.
fn check(format: Grey, layout: &Layout, size: Option<[u32; 2]>) -> Result<(), String> {
    let now = format::name(layout.code);
    if layout.code != format.number() {
        return Err(format!("told to send {}, it sends {now}", format::name(format.number())));
    }
    let Layout { width, height, .. } = *layout;
    if let Some([w, h]) = size.filter(|size| *size != [width, height]) {
        return Err(format!(
            "no pictures of {w} x {h} in {now}; the nearest is {width} x {height}"
        ));
    }
    // Sensors of a hundred thousand pixels across are not made.
    if ![width, height].iter().all(|side| (1..=100_000).contains(side)) {
        return Err(format!("it says that its pictures are {width} x {height}"));
    }
    if !layout.progressive {
        return Err("its pictures are interlaced: odd and even rows are not of one moment".into());
    }
    Ok(())
}

fn of_refusal(found: &FoundCamera, refusal: Refusal) -> DeviceError {
    match refusal {
        Refusal::System(error) => device_error(found, &error),
        Refusal::Cannot(reason) => DeviceError::Unsupported { device: found.to_string(), reason },
    }
}

/// Seconds from frame to frame, as the driver stamped two.
fn apart(before: &Raw, after: &Raw) -> Option<f64> {
    let frames = after.sequence.checked_sub(before.sequence).filter(|&frames| frames > 0)?;
    Some(after.at?.checked_sub(before.at?)?.as_secs_f64() / f64::from(frames))
}

#[cfg(test)]
mod tests;
