//! Cameras on USB that this user may not open. Their drivers do not see them: what a camera is
//! called can only be asked once it is open.

use super::{CameraDriver, FoundCamera};
use crate::DeviceError;
use crate::devices::UsbAdapter;
use std::fs;
use std::path::{Path, PathBuf};

/// A class of USB interfaces: class, subclass, protocol.
pub(super) type UsbClass = [u8; 3];

/// The control interface of USB3 Vision (USB3 Vision 1.0, section 2.2).
pub(super) const USB3_VISION: UsbClass = [0xEF, 0x05, 0x00];

/// Still image capture, PTP (USB Still Image Capture Device Definition 1.0, section 4).
pub(super) const STILL_IMAGE: UsbClass = [0x06, 0x01, 0x01];

/// Whether a camera that its driver has at a port such as `usb:002,007` is that of a node such as
/// `/dev/bus/usb/002/007`.
pub(super) fn is_at(camera: &FoundCamera, node: &str) -> bool {
    let port = camera.id.strip_prefix("usb:").and_then(|port| port.split_once(','));
    port.is_some_and(|(bus, device)| node == format!("{NODES}/{bus}/{device}"))
}

/// Where Linux describes what is plugged in, and where it is opened.
const DESCRIPTIONS: &str = "/sys/bus/usb/devices";
const NODES: &str = "/dev/bus/usb";

/// The cameras of a class that this user may not open; none where the system has no USB.
pub(super) fn closed(class: UsbClass, driver: CameraDriver) -> Vec<FoundCamera> {
    closed_below(Path::new(DESCRIPTIONS), Path::new(NODES), class, driver)
}

/// The USB device at a path below `/dev/bus/usb`, for the rule that opens it.
pub fn usb_device(path: &str) -> Option<UsbAdapter> {
    devices(Path::new(DESCRIPTIONS))
        .find(|folder| node(folder, Path::new(NODES)).is_some_and(|node| node == Path::new(path)))
        .map(|folder| adapter(&folder))
}

fn closed_below(
    descriptions: &Path,
    nodes: &Path,
    class: UsbClass,
    driver: CameraDriver,
) -> Vec<FoundCamera> {
    devices(descriptions)
        .filter(|folder| has_interface(folder, class))
        .filter_map(|folder| {
            let path = node(&folder, nodes)?;
            let opened = fs::OpenOptions::new().read(true).write(true).open(&path);
            let refused = opened.is_err_and(|e| e.kind() == std::io::ErrorKind::PermissionDenied);
            refused.then(|| {
                let name = adapter(&folder).name;
                let address = path.to_string_lossy().into_owned();
                let problem =
                    DeviceError::NoPermission { device: name.clone(), path: address.clone() };
                FoundCamera {
                    driver,
                    name,
                    id: address.clone(),
                    serial: text(&folder, "serial"),
                    address: Some(address),
                    bus: None,
                    fake: false,
                    problem: Some(problem),
                }
            })
        })
        .collect()
}

fn devices(descriptions: &Path) -> impl Iterator<Item = PathBuf> {
    let mut folders: Vec<PathBuf> =
        fs::read_dir(descriptions).into_iter().flatten().flatten().map(|e| e.path()).collect();
    folders.sort();
    folders.into_iter()
}

fn text(folder: &Path, file: &str) -> Option<String> {
    let text = fs::read_to_string(folder.join(file)).ok()?;
    let text = text.trim();
    (!text.is_empty()).then(|| text.to_owned())
}

fn hexadecimal(folder: &Path, file: &str) -> Option<u16> {
    u16::from_str_radix(&text(folder, file)?, 16).ok()
}

fn adapter(folder: &Path) -> UsbAdapter {
    let words: Vec<String> =
        ["manufacturer", "product"].into_iter().filter_map(|file| text(folder, file)).collect();
    UsbAdapter {
        vendor: hexadecimal(folder, "idVendor").unwrap_or(0),
        product: hexadecimal(folder, "idProduct").unwrap_or(0),
        name: if words.is_empty() { "USB camera".into() } else { words.join(" ") },
    }
}

/// Interfaces are folders inside of that of their device.
fn has_interface(folder: &Path, class: UsbClass) -> bool {
    devices(folder).any(|interface| {
        let found = ["bInterfaceClass", "bInterfaceSubClass", "bInterfaceProtocol"]
            .map(|file| hexadecimal(&interface, file));
        found == class.map(|value| Some(u16::from(value)))
    })
}

fn node(folder: &Path, nodes: &Path) -> Option<PathBuf> {
    let number = |file| text(folder, file)?.parse::<u16>().ok();
    let (bus, device) = (number("busnum")?, number("devnum")?);
    Some(nodes.join(format!("{bus:03}/{device:03}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a USB3 Vision camera on bus 2 looks like below /sys.
    fn plug_in(folder: &Path) {
        let device = folder.join("sys/2-1");
        let interface = device.join("2-1:1.0");
        fs::create_dir_all(&interface).unwrap();
        for (file, text) in [
            ("busnum", "2\n"),
            ("devnum", "7\n"),
            ("idVendor", "2676\n"),
            ("idProduct", "ba02\n"),
            ("manufacturer", "Basler\n"),
            ("product", "ace\n"),
            ("serial", "40012345\n"),
        ] {
            fs::write(device.join(file), text).unwrap();
        }
        for (file, text) in
            [("bInterfaceClass", "ef"), ("bInterfaceSubClass", "05"), ("bInterfaceProtocol", "00")]
        {
            fs::write(interface.join(file), text).unwrap();
        }
        // Something that is no camera.
        fs::create_dir_all(folder.join("sys/1-1")).unwrap();
    }

    #[test]
    fn a_camera_is_recognised_by_its_interface() {
        let folder = tempfile::tempdir().unwrap();
        plug_in(folder.path());
        let device = folder.path().join("sys/2-1");
        assert!(has_interface(&device, USB3_VISION));
        assert!(!has_interface(&device, [0x06, 0x01, 0x01]));
        assert!(!has_interface(&folder.path().join("sys/1-1"), USB3_VISION));
        let found = adapter(&device);
        assert_eq!((found.vendor, found.product, &*found.name), (0x2676, 0xba02, "Basler ace"));
        let nodes = folder.path().join("dev");
        assert_eq!(node(&device, &nodes).unwrap(), nodes.join("002/007"));
    }

    #[test]
    fn a_port_and_a_node_are_one_place() {
        let at = |port: &str| FoundCamera {
            driver: CameraDriver::Gphoto2,
            name: "x".into(),
            id: port.into(),
            serial: None,
            address: None,
            bus: None,
            fake: false,
            problem: None,
        };
        assert!(is_at(&at("usb:002,007"), "/dev/bus/usb/002/007"));
        assert!(!is_at(&at("usb:002,008"), "/dev/bus/usb/002/007"));
        assert!(!is_at(&at("Aravis-Fake"), "/dev/bus/usb/002/007"));
    }

    #[test]
    fn only_what_may_not_be_opened_is_told() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        plug_in(folder.path());
        let (sys, nodes) = (folder.path().join("sys"), folder.path().join("dev"));
        let closed = || closed_below(&sys, &nodes, USB3_VISION, CameraDriver::Aravis);
        assert!(closed().is_empty(), "it is not there any more");
        let node = nodes.join("002/007");
        fs::create_dir_all(nodes.join("002")).unwrap();
        fs::write(&node, "").unwrap();
        assert!(closed().is_empty(), "it may be opened");
        fs::set_permissions(&node, fs::Permissions::from_mode(0o000)).unwrap();
        if fs::OpenOptions::new().write(true).open(&node).is_ok() {
            println!("SKIPPED: whoever runs this test may open everything");
            return;
        }
        let found = closed();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].serial.as_deref(), Some("40012345"));
        assert!(matches!(found[0].problem, Some(DeviceError::NoPermission { .. })));
    }
}
