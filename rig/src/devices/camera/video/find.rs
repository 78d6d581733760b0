//! Video devices that are there, and what their drivers' errors mean.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::node::Node;
use crate::DeviceError;
use crate::devices::camera::{CameraChoice, CameraDriver, FoundCamera};

/// Where Linux has its video devices, and where it describes them.
const NODES: &str = "/dev";
const DESCRIPTIONS: &str = "/sys/class/video4linux";

/// The video devices that send pictures, and those that this user may not ask whether they do.
pub fn scan() -> Vec<FoundCamera> {
    let entries = fs::read_dir(NODES).into_iter().flatten().flatten();
    let mut numbers: Vec<u32> =
        entries.filter_map(|entry| number(entry.file_name().to_str()?)).collect();
    numbers.sort_unstable();
    let nodes = numbers.into_iter().map(|n| Path::new(NODES).join(format!("video{n}")));
    nodes.filter_map(|node| look(&node).ok().flatten()).collect()
}

/// The number of a device, by the name of its node.
fn number(node: &str) -> Option<u32> {
    node.strip_prefix("video")?.parse().ok()
}

/// The camera at a node; `None` where it sends no pictures: one of two of a webcam sends data
/// about them.
fn look(node: &Path) -> Result<Option<FoundCamera>, DeviceError> {
    let folder = Path::new(DESCRIPTIONS).join(node.file_name().unwrap_or_default());
    let said = |file: &str| {
        let text = fs::read_to_string(folder.join(file)).ok()?;
        Some(text.trim().to_owned()).filter(|text| !text.is_empty())
    };
    let id = node.to_string_lossy().into_owned();
    let mut camera = FoundCamera {
        driver: CameraDriver::V4l,
        name: said("name").unwrap_or_else(|| id.clone()),
        id: id.clone(),
        // Of the USB device whose interface it belongs to.
        serial: said("device/../serial"),
        address: Some(id),
        bus: None,
        fake: false,
        problem: None,
    };
    let told = Node::open(node).and_then(|node| node.capability());
    match told.map_err(|error| device_error(&camera, &error)) {
        Ok(told) if !told.captures => return Ok(None),
        Ok(told) => {
            camera.fake = told.driver == "vivid";
            camera.bus = Some(told.bus).filter(|bus| !bus.is_empty());
            if !told.card.is_empty() {
                camera.name = told.card;
            }
        }
        // Which of its nodes sends pictures cannot be asked; it is the first.
        Err(DeviceError::NoPermission { .. }) if said("index").is_some_and(|n| n != "0") => {
            return Ok(None);
        }
        Err(problem @ (DeviceError::NoPermission { .. } | DeviceError::Busy { .. })) => {
            camera.problem = Some(problem);
        }
        Err(error) => return Err(error),
    }
    Ok(Some(camera))
}

/// The camera that is meant.
///
/// # Errors
/// There is none or more than one; what is named is no video device, or may not be opened.
pub fn find(choice: &CameraChoice) -> Result<FoundCamera, DeviceError> {
    let Some(path) = choice.device.as_deref().filter(|device| device.starts_with('/')) else {
        return choice.pick(scan());
    };
    // Names such as /dev/v4l/by-id/... are links to what they mean today.
    let Ok(node) = fs::canonicalize(path) else {
        let there = scan().iter().map(ToString::to_string).collect();
        return Err(DeviceError::NoneSuch { device: choice.to_string(), there });
    };
    match look(&node)? {
        Some(camera) => {
            let device = Some(camera.id.clone());
            CameraChoice { device, ..choice.clone() }.pick(vec![camera])
        }
        None => {
            let reason = "a video device that sends no pictures".into();
            Err(DeviceError::Unsupported { device: path.to_owned(), reason })
        }
    }
}

/// Whether nobody else has a camera set up to send pictures.
///
/// # Errors
/// Somebody has, or it may not be opened.
pub fn is_free(found: &FoundCamera) -> Result<(), DeviceError> {
    let claimed = Node::open(&PathBuf::from(&found.id)).and_then(|node| node.claim());
    claimed.map_err(|error| device_error(found, &error))
}

/// What a call's error means (V4L2: "Generic Error Codes", and `errno(3)`).
pub fn device_error(found: &FoundCamera, error: &io::Error) -> DeviceError {
    let device = found.to_string();
    match error.raw_os_error() {
        Some(libc::ENODEV | libc::ENXIO | libc::ESHUTDOWN) => DeviceError::Disconnected { device },
        Some(libc::ENOENT) => DeviceError::NotFound { device },
        Some(libc::EBUSY) => DeviceError::Busy { device },
        Some(libc::EACCES | libc::EPERM) => {
            DeviceError::NoPermission { device, path: found.id.clone() }
        }
        Some(libc::ENOTTY) => {
            DeviceError::Unsupported { device, reason: "it is no video device (V4L2)".into() }
        }
        Some(libc::ENOSPC) => DeviceError::Unsupported {
            device,
            reason:
                "the USB bus has no room for its pictures: a smaller size, or a port of its own"
                    .into(),
        },
        // What a cable does to a transfer; another attempt may do better.
        Some(libc::EIO | libc::EPROTO | libc::EPIPE | libc::EILSEQ | libc::ETIMEDOUT) => {
            DeviceError::Protocol {
                device,
                expected: "an answer of its driver".into(),
                bytes: error.to_string().into_bytes(),
            }
        }
        _ => DeviceError::Unsupported { device, reason: format!("its driver says: {error}") },
    }
}
