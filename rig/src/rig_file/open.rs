//! From a rig file to drivers.

use std::time::Duration;

use super::{ControlConfig, DisplayConfig, HandsConfig, Letter, StageConfig};
#[cfg(all(feature = "display", target_os = "linux"))]
use crate::devices::display::{Display, WindowProgram};
use crate::devices::zaber::ZaberAxis;
use crate::devices::{
    Benq, Epson, Grbl, HandsProgram, Optoma, Patience, Pjlink, ProjectorControl, Stage, StageAxis,
    Zaber,
};
use crate::{Bench, Camera, DeviceError, Projector};

/// Where a device is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// At a serial port.
    Serial(String),
    /// At a TCP port of a host.
    Tcp(String, u16),
    /// A monitor of this computer.
    Monitor(String),
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Serial(path) => f.write_str(path),
            Self::Monitor(name) => f.write_str(name),
            Self::Tcp(host, port) => write!(f, "{host}:{port}"),
        }
    }
}

/// Makes the devices that a rig file calls simulated: they live above this crate.
pub trait SimulatedDevices {
    /// A camera.
    ///
    /// # Errors
    /// There is none.
    fn camera(&self) -> Result<Box<dyn Camera>, DeviceError>;
    /// What shows a picture.
    ///
    /// # Errors
    /// There is none.
    fn display(&self) -> Result<Box<dyn Projector>, DeviceError>;
    /// Hands that put things on the bench.
    ///
    /// # Errors
    /// There are none.
    fn bench(&self) -> Result<Box<dyn Bench>, DeviceError>;
    /// A projector's remote control.
    fn control(&self) -> Box<dyn ProjectorControl>;
    /// A stage with these axes.
    fn stage(&self, axes: Vec<StageAxis>) -> Box<dyn Stage>;
}

impl DisplayConfig {
    /// The driver's name in the file.
    pub fn driver(&self) -> &'static str {
        match self {
            Self::Simulated {} => "simulated",
            Self::Window { .. } => "window",
        }
    }

    /// Where it is; `None` for one in software.
    pub fn address(&self) -> Option<Address> {
        match self {
            Self::Simulated {} => None,
            Self::Window { monitor, .. } => Some(Address::Monitor(monitor.clone())),
        }
    }

    /// What shows pictures, dark until it is given one. A window is a process of its own: this
    /// program once more, which has to see to it ([`crate::devices::display::WINDOW_COMMAND`]).
    ///
    /// # Errors
    /// It is not there, not free, or this program was built without its driver.
    pub fn open(
        &self,
        simulated: &dyn SimulatedDevices,
    ) -> Result<Box<dyn Projector>, DeviceError> {
        match self {
            Self::Simulated {} => simulated.display(),
            #[cfg(all(feature = "display", target_os = "linux"))]
            Self::Window { monitor, server, settle_ms } => {
                // What is not a duration was refused when the file was read.
                let settle = Duration::try_from_secs_f64(settle_ms / 1e3).unwrap_or_default();
                let program = WindowProgram::this();
                Ok(Box::new(Display::open(server.as_deref(), monitor, settle, &program)?))
            }
            #[cfg(not(all(feature = "display", target_os = "linux")))]
            Self::Window { .. } => Err(crate::devices::display::missing()),
        }
    }
}

impl ControlConfig {
    /// The driver's name in the file.
    pub fn driver(&self) -> &'static str {
        match self {
            Self::Simulated { .. } => "simulated",
            Self::Pjlink { .. } => "pjlink",
            Self::Optoma { .. } => "optoma",
            Self::Epson { .. } => "epson",
            Self::Benq { .. } => "benq",
        }
    }

    /// Where it is; `None` for one in software.
    pub fn address(&self) -> Option<Address> {
        match self {
            Self::Simulated { .. } => None,
            Self::Pjlink { host, port, .. } => Some(Address::Tcp(host.clone(), *port)),
            Self::Optoma { port, .. } | Self::Epson { port, .. } | Self::Benq { port, .. } => {
                Some(Address::Serial(port.clone()))
            }
        }
    }

    /// The input to select, by the projector's own code.
    pub fn input(&self) -> Option<&str> {
        match self {
            Self::Simulated { input, .. }
            | Self::Pjlink { input, .. }
            | Self::Optoma { input, .. }
            | Self::Epson { input, .. }
            | Self::Benq { input, .. } => input.as_deref(),
        }
    }

    /// The longest time that it may take to warm up.
    pub fn warm_up(&self) -> Duration {
        // What is not a duration was refused when the file was read.
        Duration::try_from_secs_f64(self.warm_up_s()).unwrap_or_default()
    }

    pub(super) fn warm_up_s(&self) -> f64 {
        match self {
            Self::Simulated { warm_up_s, .. }
            | Self::Pjlink { warm_up_s, .. }
            | Self::Optoma { warm_up_s, .. }
            | Self::Epson { warm_up_s, .. }
            | Self::Benq { warm_up_s, .. } => *warm_up_s,
        }
    }

    /// The driver; nothing is sent yet.
    pub fn open(&self, simulated: &dyn SimulatedDevices) -> Box<dyn ProjectorControl> {
        let patience = Patience::default();
        match self {
            Self::Simulated { .. } => simulated.control(),
            Self::Pjlink { host, port, password, .. } => {
                Box::new(Pjlink::new(host, *port, password.clone(), patience))
            }
            Self::Optoma { port, baud, id, .. } => {
                Box::new(Optoma::new(port, *baud, *id, patience))
            }
            Self::Epson { port, baud, .. } => Box::new(Epson::new(port, *baud, patience)),
            Self::Benq { port, baud, .. } => Box::new(Benq::new(port, *baud, patience)),
        }
    }
}

impl HandsConfig {
    /// The program that puts things on the bench, which is not called yet; `None` where a person
    /// does, or the simulator.
    pub fn program(&self) -> Option<HandsProgram> {
        match self {
            Self::Person {} | Self::Simulated {} => None,
            Self::Program { program, limit_s } => {
                // What is not a duration was refused when the file was read.
                let limit = Duration::try_from_secs_f64(*limit_s).unwrap_or(Duration::MAX);
                Some(HandsProgram::new(program, limit))
            }
        }
    }
}

impl StageConfig {
    /// The driver's name in the file.
    pub fn driver(&self) -> &'static str {
        match self {
            Self::Simulated { .. } => "simulated",
            Self::Grbl { .. } => "grbl",
            Self::Zaber { .. } => "zaber",
        }
    }

    /// Where it is; `None` for one in software.
    pub fn address(&self) -> Option<Address> {
        match self {
            Self::Simulated { .. } => None,
            Self::Grbl { port, .. } | Self::Zaber { port, .. } => {
                Some(Address::Serial(port.clone()))
            }
        }
    }

    /// The driver; nothing is sent yet.
    pub fn open(&self, simulated: &dyn SimulatedDevices) -> Box<dyn Stage> {
        let patience = Patience::default();
        let axes = self.axes();
        match self {
            Self::Simulated { .. } => simulated.stage(axes),
            Self::Grbl { port, baud, axes: configs } => {
                let letters = configs.iter().map(|config| match config.letter {
                    Letter::X => 0,
                    Letter::Y => 1,
                    Letter::Z => 2,
                });
                Box::new(Grbl::new(port, *baud, axes.into_iter().zip(letters).collect(), patience))
            }
            Self::Zaber { port, baud, axes: configs } => {
                let wired = axes.into_iter().zip(configs).map(|(axis, config)| ZaberAxis {
                    axis,
                    device: config.device,
                    number: config.axis,
                    step: config.step,
                });
                Box::new(Zaber::new(port, *baud, wired.collect(), patience))
            }
        }
    }
}
