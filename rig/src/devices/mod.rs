//! Cameras, projectors and stages behind their makers' protocols.
//!
//! A driver speaks over a [`Link`], which knows nothing of protocols; what comes back goes through
//! a parser that is a pure function of bytes. [`ProjectorControl`] and [`Stage`] are what the rest
//! of the program sees; `simulator` implements them too, and plays the devices on the other side
//! of the wire.

pub mod benq;
pub mod camera;
mod connection;
pub(crate) mod controlled;
pub mod display;
pub mod epson;
pub mod grbl;
pub(crate) mod hands;
mod link;
pub mod optoma;
mod parsers;
pub mod pjlink;
mod projector_control;
mod protocol_error;
mod scan;
#[cfg(test)]
mod scripted;
mod self_test;
mod stage;
mod transition;
pub mod zaber;

pub use benq::Benq;
pub use connection::Connection;
pub use controlled::Parking;
pub use display::{Monitor, find_monitor, list_monitors};
pub use epson::Epson;
pub use grbl::Grbl;
pub use hands::HandsProgram;
pub use link::{Link, Patience};
pub use optoma::Optoma;
pub use parsers::{Parser, parsers};
pub use pjlink::Pjlink;
pub use projector_control::{
    Fault, Part, PowerState, ProjectorControl, Severity, power_off, power_on,
};
pub use protocol_error::ProtocolError;
pub use scan::{SerialPort, UsbAdapter, scan_serial_ports, usb_adapter};
pub use self_test::{Check, CheckResult, test_display, test_projector_control, test_stage};
pub use stage::{Coordinate, Degrees, Millimetres, Range, Stage, StageAxis};
pub use zaber::Zaber;
