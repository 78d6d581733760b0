//! What the library Aravis needs on top of its bindings: a list of cameras that believes no
//! pointer, and errors in our words.

use std::ffi::{CStr, c_char, c_uint};
use std::sync::Mutex;

use aravis::glib;
use aravis::glib::translate::{ToGlibPtr, from_glib_full};
use aravis::{DeviceError as Kind, Stream};

use crate::DeviceError;
use crate::devices::camera::{CameraDriver, FoundCamera};

/// The library keeps one list of devices a process, which is read entry by entry.
static LIST: Mutex<()> = Mutex::new(());

/// All cameras that answer on any network interface or USB port; takes about a second.
pub fn scan() -> Vec<FoundCamera> {
    let _guard = LIST.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    // SAFETY: the list changes in `arv_update_device_list` alone, which the guard keeps to one
    // thread of this program at a time; the texts belong to the list and are copied at once.
    unsafe {
        aravis_sys::arv_update_device_list();
        (0..aravis_sys::arv_get_n_devices()).filter_map(|number| entry(number)).collect()
    }
}

/// # Safety
/// The list must not change meanwhile.
unsafe fn entry(number: c_uint) -> Option<FoundCamera> {
    // SAFETY: the functions take any number, and give a text that ends or a null pointer.
    let text = |ask: unsafe extern "C" fn(c_uint) -> *const c_char| unsafe { copy(ask(number)) };
    let id = text(aravis_sys::arv_get_device_id)?;
    let words = [aravis_sys::arv_get_device_vendor, aravis_sys::arv_get_device_model];
    let words: Vec<String> = words.into_iter().filter_map(text).collect();
    let protocol = text(aravis_sys::arv_get_device_protocol);
    Some(FoundCamera {
        driver: CameraDriver::Aravis,
        name: if words.is_empty() { id.clone() } else { words.join(" ") },
        // Aravis' own fakes, on a wire or not, and the simulated rig behind one of them.
        bus: None,
        fake: protocol.as_deref() == Some("Fake") || words == ["Aravis", "Fake"] || is_twin(&words),
        serial: text(aravis_sys::arv_get_device_serial_nbr),
        address: text(aravis_sys::arv_get_device_address),
        id,
        problem: None,
    })
}

fn is_twin(words: &[String]) -> bool {
    words.first().is_some_and(|maker| maker == "Diaphane")
}

/// # Safety
/// `text` is null or ends with a zero.
pub unsafe fn copy(text: *const c_char) -> Option<String> {
    if text.is_null() {
        return None;
    }
    // SAFETY: as above.
    let text = unsafe { CStr::from_ptr(text) }.to_string_lossy().trim().to_owned();
    (!text.is_empty()).then_some(text)
}

/// A feature in the camera's own words; `None` where it has none for it.
pub fn feature_text(camera: &aravis::Camera, feature: &str) -> Result<Option<String>, glib::Error> {
    let mut error = std::ptr::null_mut();
    // SAFETY: both pointers live until the call returns; the text, which may be null against what
    // the bindings believe, is copied before anything else is asked.
    unsafe {
        let name = feature.to_glib_none();
        let camera: *mut aravis_sys::ArvCamera = camera.to_glib_none().0;
        let text = aravis_sys::arv_camera_get_string(camera, name.0, &mut error);
        if error.is_null() { Ok(copy(text)) } else { Err(from_glib_full(error)) }
    }
}

/// A stream of frames; `None` where the library has none and no reason either.
pub fn create_stream(camera: &aravis::Camera) -> Result<Option<Stream>, glib::Error> {
    let mut error = std::ptr::null_mut();
    // SAFETY: the camera lives until the call returns; what comes is ours, or null.
    unsafe {
        let camera: *mut aravis_sys::ArvCamera = camera.to_glib_none().0;
        let stream =
            aravis_sys::arv_camera_create_stream(camera, None, std::ptr::null_mut(), &mut error);
        if !error.is_null() {
            return Err(from_glib_full(error));
        }
        Ok((!stream.is_null()).then(|| from_glib_full(stream)))
    }
}

/// The bytes of a frame, and how many follow each of its rows.
pub fn image(buffer: &aravis::Buffer) -> Option<(Vec<u8>, usize)> {
    let mut size = 0;
    // SAFETY: the buffer lives until the bytes are copied; a null pointer or none of them is no
    // picture.
    let bytes = unsafe {
        let data = aravis_sys::arv_buffer_get_image_data(buffer.to_glib_none().0, &mut size);
        if data.is_null() || size == 0 || isize::try_from(size).is_err() {
            return None;
        }
        std::slice::from_raw_parts(data, size).to_vec()
    };
    let (padding, _) = buffer.image_padding();
    Some((bytes, usize::try_from(padding).ok()?))
}

/// What the library says went wrong, in our words.
pub fn device_error(device: &str, error: &glib::Error) -> DeviceError {
    let device = device.to_owned();
    match error.kind::<Kind>() {
        Some(Kind::Timeout) => DeviceError::Timeout { device, waited_s: ANSWER_S },
        Some(Kind::NotFound) => DeviceError::NotFound { device },
        Some(Kind::NotConnected) => DeviceError::Disconnected { device },
        Some(Kind::NotController | Kind::ProtocolErrorAccessDenied | Kind::ProtocolErrorBusy) => {
            DeviceError::Busy { device }
        }
        Some(Kind::ProtocolError | Kind::TransferError) => DeviceError::Protocol {
            device,
            expected: "an answer in its protocol".into(),
            bytes: error.message().as_bytes().to_vec(),
        },
        _ => DeviceError::Unsupported { device, reason: error.message().to_owned() },
    }
}

/// The library asks five times and waits half a second for each answer.
const ANSWER_S: f64 = 2.5;
