//! The way out where a port may not be opened, is in use, or is not there.

use ::rig::devices::{UsbAdapter, usb_adapter};
use ::rig::{Address, DeviceErrorKind};

/// What to do about a device at `address` that could not be used.
pub(super) fn advice(kind: DeviceErrorKind, address: Option<&Address>) -> Option<String> {
    let serial = match address {
        Some(Address::Serial(path)) => Some(path.as_str()),
        _ => None,
    };
    let monitor = matches!(address, Some(Address::Monitor(_)));
    Some(match (kind, serial) {
        (DeviceErrorKind::NotFound, None) if monitor => {
            "is the projector plugged in and switched on, and a desktop with X running (DISPLAY is its name)? What is there: diaphane rig list".into()
        }
        (DeviceErrorKind::MissingDriver, _) if monitor => {
            "build with it: cargo build --release (it is part of the default features, on Linux)".into()
        }
        (DeviceErrorKind::Unsupported, None) if monitor => {
            "a Vulkan driver has to be there; where the graphics device has none: sudo apt-get install mesa-vulkan-drivers".into()
        }
        (DeviceErrorKind::NoPermission, Some(path)) => {
            format!("{}\n{}", group("dialout"), udev_rule(path, usb_adapter(path).as_ref()))
        }
        (DeviceErrorKind::Busy, Some(path)) => {
            format!("another program has it; find out which: fuser {path}")
        }
        (DeviceErrorKind::NotFound, Some(_)) => {
            "plug it in; what is there: diaphane rig list".into()
        }
        (DeviceErrorKind::NotFound, None) => {
            "is it switched on, and its network control too? Is the address right?".into()
        }
        (DeviceErrorKind::Timeout | DeviceErrorKind::Protocol, Some(_)) => {
            "is it switched on, the cable the right one (crossed or not), and the speed that of the device's menu?".into()
        }
        (DeviceErrorKind::Fault, _) => {
            "look at the device; then home it, with --home, or if that cannot be: diaphane rig test RIG --unlock".into()
        }
        _ => return None,
    })
}

fn group(name: &str) -> String {
    format!(
        "add yourself to the group that may: sudo usermod -aG {name} $USER, and log in again; or add a rule"
    )
}

/// What to do to have a video device opened to whoever sits at the machine.
pub(super) fn video_rule(path: &str) -> String {
    let which = format!("KERNEL==\"{}\"", path.rsplit('/').next().unwrap_or(path));
    format!("{}\n{}", group("video"), rule("video4linux", &which))
}

/// What to type to have the port opened to whoever sits at the machine.
fn udev_rule(path: &str, usb: Option<&UsbAdapter>) -> String {
    let which = match usb {
        Some(usb) => format!(
            "ATTRS{{idVendor}}==\"{:04x}\", ATTRS{{idProduct}}==\"{:04x}\"",
            usb.vendor, usb.product
        ),
        None => format!("KERNEL==\"{}\"", path.rsplit('/').next().unwrap_or(path)),
    };
    rule("tty", &which)
}

/// What to type to have a device on USB, opened at `path`, opened to whoever sits at the machine.
pub(super) fn usb_rule(path: &str, usb: Option<&UsbAdapter>) -> String {
    let which = match usb {
        Some(usb) => format!(
            "ATTR{{idVendor}}==\"{:04x}\", ATTR{{idProduct}}==\"{:04x}\"",
            usb.vendor, usb.product
        ),
        // Their nodes are called by bus and number.
        None => format!("ENV{{DEVNAME}}==\"{path}\""),
    };
    rule("usb", &which)
}

fn rule(subsystem: &str, which: &str) -> String {
    format!(
        "echo 'SUBSYSTEM==\"{subsystem}\", {which}, MODE=\"0660\", TAG+=\"uaccess\"' | sudo tee -a /etc/udev/rules.d/70-diaphane.rules\n\
         sudo udevadm control --reload && sudo udevadm trigger"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rule_names_the_adapter_or_else_the_port() {
        let usb = UsbAdapter { vendor: 0x1a86, product: 0x7523, name: String::new() };
        let rule = udev_rule("/dev/ttyUSB0", Some(&usb));
        assert!(rule.contains(r#"ATTRS{idVendor}=="1a86", ATTRS{idProduct}=="7523""#), "{rule}");
        assert!(udev_rule("/dev/ttyS0", None).contains(r#"KERNEL=="ttyS0""#));
        let rule = usb_rule("/dev/bus/usb/002/007", Some(&usb));
        assert!(rule.contains(r#""usb", ATTR{idVendor}=="1a86""#), "{rule}");
        assert!(usb_rule("/dev/bus/usb/002/007", None).contains("usb/002/007"));
        let rule = video_rule("/dev/video2");
        assert!(rule.contains(r#""video4linux", KERNEL=="video2""#), "{rule}");
        assert!(rule.contains("usermod -aG video"), "{rule}");
        let port = Address::Serial("/dev/there-is-no-such-port".into());
        let told = advice(DeviceErrorKind::NoPermission, Some(&port)).unwrap_or_default();
        assert!(told.contains("dialout") && told.contains("udevadm"), "{told}");
    }
}
