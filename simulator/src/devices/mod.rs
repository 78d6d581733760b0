//! Projectors and stages in software, twice over: as drivers that need no wire, and as devices
//! at the other end of one, which speak what their makers' manuals print.
//!
//! A [`Wire`] carries a [`Protocol`] over a TCP port or a pseudo-terminal, and can be told to go
//! wrong. What a device does apart from talking is a model, [`SimulatedProjector`] or
//! [`SimulatedStage`]; these can be told to fail as well.

mod benq;
mod epson;
#[cfg(all(feature = "aravis", target_os = "linux"))]
mod gige;
mod grbl;
mod optoma;
mod pjlink;
mod projector;
#[cfg(all(feature = "display", target_os = "linux"))]
mod screen;
mod stage;
#[cfg(all(feature = "aravis", feature = "display", target_os = "linux"))]
mod twin;
mod wire;
mod zaber;

pub use benq::BenqEmulator;
pub use epson::{EpsonEmulator, Prompt};
#[cfg(all(feature = "aravis", target_os = "linux"))]
pub use gige::{GigeCamera, GigeFault};
pub use grbl::GrblEmulator;
pub use optoma::OptomaEmulator;
pub use pjlink::PjlinkEmulator;
pub use projector::{ProjectorSpec, SimulatedProjector};
#[cfg(all(feature = "display", target_os = "linux"))]
pub use screen::{Screen, VirtualScreen};
pub use stage::{SimulatedStage, StageFailure};
#[cfg(all(feature = "aravis", feature = "display", target_os = "linux"))]
pub use twin::{Twin, TwinError, TwinSpec};
pub use wire::{Protocol, Wire, WireFault};
pub use zaber::ZaberEmulator;
