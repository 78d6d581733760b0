//! What to type to be allowed to open a device: groups, and rules of udev.

use ::rig::devices::{UsbAdapter, usb_adapter};

/// What to do to have a serial port opened.
pub(super) fn port_rule(path: &str) -> String {
    format!("{}\n{}", group("dialout"), udev_rule(path, usb_adapter(path).as_ref()))
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
        let told = port_rule("/dev/there-is-no-such-port");
        assert!(told.contains("dialout") && told.contains("udevadm"), "{told}");
    }
}
