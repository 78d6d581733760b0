//! A camera on a network: GigE Vision, played by the registers of Aravis' fake camera, with pictures of ours.

mod description;
mod stream;

use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use aravis::glib::translate::ToGlibPtr;
use rig::{Camera, CameraInfo, DeviceError, Frame};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use description::{Description, EXPOSURES_US, FREEZING_MK, register};
use stream::{Picture, send};

/// A camera served over GigE Vision, for any program that speaks it.
///
/// It has one pixel format, `Mono` or `BayerRG` with the bits of the camera that is served (8, 10,
/// 12 or 16). Of three channels each pixel becomes a quad of a mosaic with the pixel's green in both
/// greens, so that taking it apart again gives exactly what was served. Exposures are whole
/// microseconds, a software trigger starts each, a part of the sensor may be chosen.
///
/// Only one such camera can be served at an address of a machine: the port is part of the
/// standard. Nobody announces frames over this protocol: whoever knows the plan announces them to
/// the rig that `camera` is of.
///
/// It ends when it is dropped.
pub struct GigeCamera {
    taker: Option<JoinHandle<()>>,
    shared: Arc<Shared>,
    /// Answers as long as it lives.
    _fake: aravis::GvFakeCamera,
}

/// What goes wrong on the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GigeFault {
    /// This share of all packets is lost, 0 to 1.
    Lose(f64),
    /// Frames say that they have another size than the camera was set to.
    OtherSize,
    /// Frames say that they have another pixel format.
    OtherFormat,
}

/// What the camera and the thread that takes its pictures share.
struct Shared {
    ends: AtomicBool,
    fault: Mutex<Option<GigeFault>>,
    /// What went wrong last.
    failure: Mutex<Option<DeviceError>>,
}

/// How often it is looked whether somebody wants a frame.
const LOOK: Duration = Duration::from_millis(1);
/// A format that this camera does not have, of as many bits as those that it has.
const YUV_422: u32 = 0x0210_001F;
/// Bytes a packet, if nobody asks for another: all Ethernet carries that.
const PACKET: u32 = 1400;
/// Packets are lost by chance, but alike each time.
const SEED: u64 = 1;
/// Where cameras are asked and told things.
const CONTROL_PORT: u16 = 3956;
/// Longest serial number and names of GigE Vision, less the zero at their end.
const SERIAL: usize = 15;
const NAME: usize = 31;

impl GigeCamera {
    /// Serves `camera` at a network interface, such as `lo`, under a serial number of up to 15
    /// letters and digits.
    ///
    /// # Errors
    /// There is no such interface, another camera is served there, or a camera of that kind cannot
    /// be.
    pub fn serve(
        camera: Box<dyn Camera>,
        interface: &str,
        serial: &str,
    ) -> Result<Self, DeviceError> {
        let mut camera = camera;
        let info = camera.info();
        let device = format!("{} as GigE camera {serial} at {interface}", info.name);
        let unsupported =
            |reason: String| DeviceError::Unsupported { device: device.clone(), reason };
        let good = (1..=SERIAL).contains(&serial.len())
            && serial.bytes().all(|byte| byte.is_ascii_alphanumeric());
        if !good {
            let wanted = format!("a serial number is 1 to {SERIAL} letters and digits");
            return Err(unsupported(format!("{wanted}, not {serial:?}")));
        }
        let thermometer = camera.readback()?.temperature_c;
        let description = describe(&info, thermometer.is_some()).map_err(&unsupported)?;
        let file = tempfile::NamedTempFile::new().and_then(|mut file| {
            use std::io::Write;
            file.write_all(description.xml().as_bytes()).map(|()| file)
        });
        let file = file.map_err(|e| unsupported(format!("its description: {e}")))?;
        let path = file.path().to_str().ok_or_else(|| unsupported("its description".into()))?;
        let address = free_address(interface)?;
        let socket = UdpSocket::bind((address, 0))
            .map_err(|error| unsupported(format!("a socket at {address}: {error}")))?;
        // It reads the file at once; nobody needs it afterwards.
        let fake = aravis::GvFakeCamera::new_full(Some(interface), Some(serial), Some(path));
        let registers = fake.fake_camera().ok_or_else(|| unsupported("no registers".into()))?;
        let Description { width, height, format: (_, code), .. } = description;
        for (address, value) in [
            (register::WIDTH, width),
            (register::HEIGHT, height),
            (register::SENSOR_WIDTH, width),
            (register::SENSOR_HEIGHT, height),
            (register::PIXEL_FORMAT, code),
            // Or the fake would send pictures of its own.
            (register::TRIGGER_MODE, 1),
            (register::TRIGGER_SOURCE, 1),
            (register::PACKET_SIZE, PACKET),
        ] {
            registers.write_register(address, value);
        }
        write_text(&registers, register::MAKER, "Diaphane");
        write_text(&registers, register::MODEL, &info.name);
        let shared = Arc::new(Shared {
            ends: AtomicBool::new(false),
            fault: Mutex::new(None),
            failure: Mutex::new(None),
        });
        let taker = Taker {
            camera,
            registers,
            socket,
            description,
            shared: Arc::clone(&shared),
            chance: ChaCha8Rng::seed_from_u64(SEED),
            number: 0,
        };
        let taker = Some(std::thread::spawn(|| taker.work()));
        Ok(Self { taker, shared, _fake: fake })
    }

    /// Has something go wrong from now on, or nothing any more.
    pub fn set_fault(&self, fault: Option<GigeFault>) {
        *whole(&self.shared.fault) = fault;
    }

    /// Why there was no frame when one was asked for last, if there was none: on the wire one that
    /// does not come is all that can be told.
    pub fn failure(&self) -> Option<DeviceError> {
        whole(&self.shared.failure).take()
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::Relaxed);
        if let Some(taker) = self.taker.take() {
            // A panic in there has been reported; there is nothing to add.
            let _ = taker.join();
        }
    }
}

/// What a lock holds is replaced as a whole: a panic cannot have left half of it.
fn whole<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// The address of an interface, if nobody serves a camera there. The fake itself says that it runs
/// also where it got no port.
fn free_address(interface: &str) -> Result<Ipv4Addr, DeviceError> {
    let fake = aravis::GvFakeCamera::new(Some(interface), None);
    let address = fake.fake_camera().and_then(|there| there.read_register(register::ADDRESS));
    drop(fake);
    let Some(address) = address.filter(|&address| address != 0).map(Ipv4Addr::from_bits) else {
        return Err(DeviceError::NotFound { device: format!("network interface {interface}") });
    };
    match UdpSocket::bind((address, CONTROL_PORT)) {
        Ok(_) => Ok(address),
        Err(_) => Err(DeviceError::Busy {
            device: format!("port {CONTROL_PORT} (GigE Vision) of {address}"),
        }),
    }
}

fn describe(info: &CameraInfo, thermometer: bool) -> Result<Description, String> {
    let &CameraInfo { width, height, channels, bit_depth, .. } = info;
    // Codes of the Pixel Format Naming Convention.
    let code = match (channels, bit_depth) {
        (1, 8) => 0x0108_0001,
        (1, 10) => 0x0110_0003,
        (1, 12) => 0x0110_0005,
        (1, 16) => 0x0110_0007,
        (3, 8) => 0x0108_0009,
        (3, 10) => 0x0110_000D,
        (3, 12) => 0x0110_0011,
        (3, 16) => 0x0110_002F,
        _ => return Err(format!("there is no format for {channels} channels of {bit_depth} bits")),
    };
    let (kind, step) = if channels == 1 { ("Mono", 1) } else { ("BayerRG", 2) };
    let sides = [width, height].map(|side| side.checked_mul(step).filter(|&side| side > 0));
    let [Some(width), Some(height)] = sides else {
        return Err(format!("pictures of {width} x {height} pixels"));
    };
    let format = (format!("{kind}{bit_depth}"), code);
    Ok(Description { width, height, format, step, thermometer })
}

/// At most 31 bytes of text, and a zero.
fn write_text(registers: &aravis::FakeCamera, address: u32, text: &str) {
    let mut field = [0_u8; NAME + 1];
    for (to, from) in field[..NAME].iter_mut().zip(text.bytes()) {
        *to = from;
    }
    // SAFETY: the field is as long as is said, and lies within the fake's registers.
    unsafe {
        aravis_sys::arv_fake_camera_write_memory(
            registers.to_glib_none().0,
            address,
            field.len() as u32,
            field.as_mut_ptr().cast(),
        );
    }
}

/// What the thread works with that takes pictures and sends them. The fake, in its own thread, only
/// answers questions: a picture may take longer than a camera may be silent.
struct Taker {
    camera: Box<dyn Camera>,
    registers: aravis::FakeCamera,
    socket: UdpSocket,
    description: Description,
    shared: Arc<Shared>,
    chance: ChaCha8Rng,
    /// Of the frame; it is never 0.
    number: u16,
}

impl Taker {
    /// Takes and sends a picture whenever somebody wants one.
    fn work(mut self) {
        while !self.shared.ends.load(Ordering::Relaxed) {
            if self.registers.read_register(register::REQUEST) != Some(1) {
                std::thread::sleep(LOOK);
                continue;
            }
            self.registers.write_register(register::REQUEST, 0);
            *whole(&self.shared.failure) = self.answer().err();
        }
    }

    fn register(&self, address: u32) -> u32 {
        self.registers.read_register(address).unwrap_or(0)
    }

    fn answer(&mut self) -> Result<(), DeviceError> {
        let [shortest, longest] = EXPOSURES_US;
        let exposure_us = self.register(register::EXPOSURE_US).clamp(shortest, longest);
        let frame = self.camera.expose(f64::from(exposure_us) / 1e6)?;
        if let Some(celsius) = self.camera.readback()?.temperature_c {
            let thousandths = celsius * 1000.0 + FREEZING_MK;
            self.registers.write_register(register::TEMPERATURE_MK, thousandths as u32);
        }
        if self.register(register::ACQUISITION) == 0 {
            // Nobody wants it any more.
            return Ok(());
        }
        let part = [register::OFFSET_X, register::OFFSET_Y, register::WIDTH, register::HEIGHT];
        let [x, y, mut width, height] = part.map(|address| self.register(address));
        let each = if self.description.format.1 >> 16 & 0xFF == 8 { 1 } else { 2 };
        let sent = bytes(&frame, each);
        let sent = cut(&sent, self.description.width as usize * each, [x, y, width, height], each);
        let mut format = self.description.format.1;
        let fault = *whole(&self.shared.fault);
        let lost = match fault {
            Some(GigeFault::Lose(share)) => share,
            _ => 0.0,
        };
        match fault {
            Some(GigeFault::OtherSize) => width += 2,
            Some(GigeFault::OtherFormat) => format = YUV_422,
            _ => {}
        }
        let picture = Picture { format, width, height, offset: [x, y], bytes: &sent };
        let address = Ipv4Addr::from_bits(self.register(register::STREAM_ADDRESS));
        let to = SocketAddrV4::new(address, self.register(register::STREAM_PORT) as u16);
        let size = self.register(register::PACKET_SIZE) as u16;
        self.number = self.number.checked_add(1).unwrap_or(1);
        let sent = send(
            &self.socket,
            to,
            self.number,
            usize::from(size),
            &picture,
            lost,
            &mut self.chance,
        );
        sent.map_err(|error| DeviceError::Unsupported {
            device: format!("stream to {to}"),
            reason: error.to_string(),
        })
    }
}

/// Part of a picture with rows of `stride` bytes: left, top, width and height. What lies outside
/// of it is left out.
fn cut(picture: &[u8], stride: usize, part: [u32; 4], each: usize) -> Vec<u8> {
    let [left, top, width, height] = part.map(|value| value as usize);
    let rows = picture.chunks_exact(stride.max(1)).skip(top).take(height);
    let columns = left.saturating_mul(each)..left.saturating_add(width).saturating_mul(each);
    rows.filter_map(|row| row.get(columns.clone())).flatten().copied().collect()
}

/// The picture as it is sent: values of one or two bytes, the low one first.
fn bytes(frame: &Frame, each: usize) -> Vec<u8> {
    let columns = frame.width as usize;
    let mut out = Vec::with_capacity(frame.data.len() * each * 4);
    let mut put = |value: u16| out.extend_from_slice(&value.to_le_bytes()[..each]);
    if frame.channels == 1 {
        frame.data.iter().copied().for_each(put);
        return out;
    }
    for row in frame.data.chunks_exact(3 * columns.max(1)) {
        for (upper, lower) in [(0, 1), (1, 2)] {
            for pixel in row.chunks_exact(3) {
                put(pixel[upper]);
                put(pixel[lower]);
            }
        }
    }
    out
}
