//! The serial ports of this machine.

use super::connection::open_serial;
use super::{Patience, grbl};
use crate::DeviceError;

/// A serial port.
#[derive(Debug)]
pub struct SerialPort {
    /// Its path.
    pub path: String,
    /// Of the adapter: vendor, product, and what it calls itself.
    pub usb: Option<UsbAdapter>,
    /// What kept it from being opened, if anything did.
    pub problem: Option<DeviceError>,
}

/// A USB adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbAdapter {
    /// Vendor.
    pub vendor: u16,
    /// Product.
    pub product: u16,
    /// Maker and name, as far as it tells.
    pub name: String,
}

/// The adapter at a serial port, if it is one.
pub fn usb_adapter(path: &str) -> Option<UsbAdapter> {
    // Rig files name ports by links that stay the same.
    let real = std::fs::canonicalize(path).map(|p| p.to_string_lossy().into_owned());
    let real = real.unwrap_or_else(|_| path.to_owned());
    let ports = serialport::available_ports().unwrap_or_default();
    ports.into_iter().find(|port| port.port_name == real).and_then(|port| adapter(port.port_type))
}

/// Lists the serial ports and opens each for a moment; nothing is sent. Boards with GRBL restart
/// when that happens.
pub fn scan_serial_ports() -> Vec<SerialPort> {
    let wait = Patience::default().reply;
    let ports = serialport::available_ports().unwrap_or_default();
    let look = |port: serialport::SerialPortInfo| {
        let path = port.port_name;
        let problem = open_serial(&path, &path, grbl::BAUD, wait).err();
        // Systems list ports that the board has no plug for; they do not open.
        if matches!(problem, Some(DeviceError::Unsupported { .. })) {
            return None;
        }
        Some(SerialPort { path, usb: adapter(port.port_type), problem })
    };
    let mut found: Vec<_> = ports.into_iter().filter_map(look).collect();
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

fn adapter(kind: serialport::SerialPortType) -> Option<UsbAdapter> {
    let serialport::SerialPortType::UsbPort(usb) = kind else { return None };
    let words: Vec<String> = [usb.manufacturer, usb.product].into_iter().flatten().collect();
    Some(UsbAdapter { vendor: usb.vid, product: usb.pid, name: words.join(" ") })
}
