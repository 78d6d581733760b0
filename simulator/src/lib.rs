//! A whole rig in software: a seeded sample with known κ and μ, a projector, a camera with lens,
//! response and noise, and a bench that puts calibration targets in their places. It implements
//! the traits of `rig`, so everything above cannot tell it from hardware.

#[cfg(test)]
mod code_tests;
pub mod devices;
mod imperfections;
mod lens;
#[cfg(test)]
mod light_tests;
mod monte_carlo;
mod optical_setup;
mod sample;
mod scene;
mod sensor;
mod simulated_rig;
mod targets;
mod transport;

pub use imperfections::{ColourWheel, ImperfectionError, Imperfections, Lamp, ProjectorResponse};
pub use lens::Lens;
pub use monte_carlo::{Balance, MonteCarlo, TransportError, TransportMap};
pub use optical_setup::OpticalSetup;
pub use sample::{SampleKind, SampleSpec};
pub use sensor::{ResponseCurve, Sensor};
pub use simulated_rig::{SimulatedRig, Truth};
pub use targets::{BOARD_COLUMNS, BOARD_ROWS, ChartPatch, chart_patches};
pub use transport::Transport;

/// A frame as `calibration` takes it.
#[cfg(test)]
fn photo_of(frame: rig::Frame, name: String) -> calibration::Photo {
    calibration::Photo {
        width: frame.width as usize,
        height: frame.height as usize,
        channels: 3,
        max_value: frame.max_value(),
        data: frame.data,
        name,
    }
}
