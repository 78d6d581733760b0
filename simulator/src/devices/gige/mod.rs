//! A camera on a network: GigE Vision, played by Aravis' fake camera, with pictures of ours.

mod description;

use std::ffi::c_void;
use std::net::{Ipv4Addr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use aravis::glib::translate::ToGlibPtr;
use rig::{Camera, CameraInfo, DeviceError, Frame};

use description::{Description, EXPOSURES_US, FREEZING_MK, register};

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
    // Before what it points to.
    fake: aravis::GvFakeCamera,
    shared: Arc<Shared>,
}

/// What the thread that takes pictures and the one that sends them share.
struct Shared {
    ends: AtomicBool,
    width: u32,
    height: u32,
    /// Of a value.
    bytes: usize,
    /// The next picture, of the whole sensor, as it is sent.
    picture: Mutex<Vec<u8>>,
    /// What went wrong last.
    failure: Mutex<Option<DeviceError>>,
}

/// How often it is looked whether somebody wants a frame.
const LOOK: Duration = Duration::from_millis(1);
/// How often a second the fake looks whether there is one to be sent.
const SENDS_HZ: f64 = 1000.0;
/// Of a packet of the stream: what large Ethernet frames carry. The fewer there are the fewer get
/// lost where the receiver is slow.
const PACKET: u32 = 8192;
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
        require_free_port(interface)?;
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
            (register::TRIGGER_MODE, 1),
            (register::TRIGGER_SOURCE, 1),
            (register::PACKET_SIZE, PACKET),
        ] {
            registers.write_register(address, value);
        }
        write_text(&registers, register::MAKER, "Diaphane");
        write_text(&registers, register::MODEL, &info.name);
        registers.set_trigger_frequency(SENDS_HZ);
        let shared = Arc::new(Shared {
            ends: AtomicBool::new(false),
            width,
            height,
            bytes: if info.bit_depth == 8 { 1 } else { 2 },
            picture: Mutex::new(Vec::new()),
            failure: Mutex::new(None),
        });
        // SAFETY: `fill` takes what it is given for `Shared`, which outlives the fake's thread: the
        // fake is dropped first, and ends its thread then.
        unsafe {
            let data = Arc::as_ptr(&shared).cast_mut().cast();
            aravis_sys::arv_fake_camera_set_fill_pattern(
                registers.to_glib_none().0,
                Some(fill),
                data,
            );
        }
        let taker = {
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || take(camera.as_mut(), &registers, &shared))
        };
        Ok(Self { taker: Some(taker), fake, shared })
    }

    /// Has a share of all packets lost from now on, 0 to 1.
    pub fn lose(&self, share: f64) {
        self.fake.set_gvsp_lost_ratio(share.clamp(0.0, 1.0));
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

/// Fails where the interface has no address, or somebody has its port. The fake itself says that it
/// runs in either case.
fn require_free_port(interface: &str) -> Result<(), DeviceError> {
    let fake = aravis::GvFakeCamera::new(Some(interface), None);
    let address = fake.fake_camera().and_then(|there| there.read_register(register::ADDRESS));
    drop(fake);
    let Some(address) = address.filter(|&address| address != 0).map(Ipv4Addr::from_bits) else {
        return Err(DeviceError::NotFound { device: format!("network interface {interface}") });
    };
    match UdpSocket::bind((address, CONTROL_PORT)) {
        Ok(_) => Ok(()),
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

/// Takes a picture whenever somebody wants one. Not in the fake's own thread: a picture may take
/// longer than a camera may be silent.
fn take(camera: &mut dyn Camera, registers: &aravis::FakeCamera, shared: &Shared) {
    while !shared.ends.load(Ordering::Relaxed) {
        if registers.read_register(register::REQUEST) != Some(1) {
            std::thread::sleep(LOOK);
            continue;
        }
        registers.write_register(register::REQUEST, 0);
        let [shortest, longest] = EXPOSURES_US;
        let exposure_us =
            registers.read_register(register::EXPOSURE_US).unwrap_or(0).clamp(shortest, longest);
        let taken = camera
            .expose(f64::from(exposure_us) / 1e6)
            .and_then(|frame| Ok((frame, camera.readback()?.temperature_c)));
        match taken {
            Ok((frame, temperature_c)) => {
                if let Some(celsius) = temperature_c {
                    let thousandths = celsius * 1000.0 + FREEZING_MK;
                    registers.write_register(register::TEMPERATURE_MK, thousandths as u32);
                }
                *whole(&shared.picture) = bytes(&frame, shared.bytes);
                *whole(&shared.failure) = None;
                registers.write_register(register::SEND, 1);
            }
            Err(error) => *whole(&shared.failure) = Some(error),
        }
    }
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

/// Puts the wanted part of the picture into the fake's buffer.
unsafe extern "C" fn fill(
    buffer: *mut aravis_sys::ArvBuffer,
    data: *mut c_void,
    _exposure_us: u32,
    _gain: u32,
    _format: aravis_sys::ArvPixelFormat,
) {
    // SAFETY: `data` is what was given with this function, see `serve`.
    let shared = unsafe { &*data.cast::<Shared>() };
    let mut size = 0;
    let part = |ask: unsafe extern "C" fn(*mut aravis_sys::ArvBuffer) -> i32| {
        // SAFETY: the fake has just written into this buffer what is asked for.
        u32::try_from(unsafe { ask(buffer) }).unwrap_or(0)
    };
    let [left, top, width, height] = [
        aravis_sys::arv_buffer_get_image_x,
        aravis_sys::arv_buffer_get_image_y,
        aravis_sys::arv_buffer_get_image_width,
        aravis_sys::arv_buffer_get_image_height,
    ]
    .map(part);
    // SAFETY: a buffer that lives; the size that comes back is that of what was received, nothing.
    let to = unsafe { aravis_sys::arv_buffer_get_data(buffer, &mut size) };
    if to.is_null() {
        return;
    }
    let picture = whole(&shared.picture);
    let row = width as usize * shared.bytes;
    let within =
        |first: u32, count: u32, of: u32| first.checked_add(count).is_some_and(|e| e <= of);
    let inside = within(left, width, shared.width) && within(top, height, shared.height);
    for y in 0..height {
        // A part that is not inside of the picture stays dark.
        let line = inside.then(|| (top + y) as usize * shared.width as usize + left as usize);
        let line = line.map(|first| first * shared.bytes);
        let line = line.and_then(|from| picture.get(from..from + row));
        // SAFETY: the fake made the buffer for width x height values, of whose rows this is one.
        unsafe {
            let to = to.add(y as usize * row);
            match line {
                Some(line) => std::ptr::copy_nonoverlapping(line.as_ptr(), to, row),
                None => std::ptr::write_bytes(to, 0, row),
            }
        }
    }
}
