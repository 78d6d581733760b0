//! From a session to its devices: the simulated rig, or those that its rig file names.

use crate::Failure;
use crate::cli::{PARK, STOP};
use crate::output::Progress;
use crate::session::{RigConfig, Session};
use crate::technician::Technician;
use material::Face;
use rig::devices::{ProjectorControl, Stage, StageAxis};
use rig::{Bench, Camera, DeviceError, Projector, Rig, RigFile, SimulatedDevices};
use simulator::devices::{ProjectorSpec, SimulatedProjector, SimulatedStage};
use simulator::{SampleKind, SampleSpec, SimulatedRig};
use std::sync::OnceLock;
use std::sync::atomic::Ordering;

/// The rig file of a session, relative to it.
pub(crate) const RIG_FILE: &str = "rig.toml";

/// The devices of a session, ready to work.
pub(crate) fn open(session: &Session) -> Result<Rig, Failure> {
    match &session.config.rig {
        RigConfig::Simulated { .. } => match session.simulated()? {
            Some(simulated) => Ok(simulated.rig()),
            None => Err(session.nothing_to_capture()),
        },
        RigConfig::Devices { .. } => assemble(
            &RigFile::read(&session.path(RIG_FILE))?,
            &session.folder().display().to_string(),
        ),
        RigConfig::Imported => Err(session.nothing_to_capture()),
    }
}

/// The devices of a rig file, which was called `name` or is that of a session called so, ready to
/// work; a second Ctrl-C parks them from here on.
pub(crate) fn assemble(file: &RigFile, name: &str) -> Result<Rig, Failure> {
    let mut progress = Progress::new("rig", 0);
    let person: Box<dyn Bench> = Box::new(Technician::default());
    let opened = file.assemble(person, &Simulated::default(), &mut |what| {
        progress.set(0, what);
        !STOP.load(Ordering::Relaxed)
    });
    let (rig, parking) = opened.map_err(|error| {
        if STOP.load(Ordering::Relaxed) {
            let error =
                format!("interrupted before the rig was ready, no picture was taken: {error}");
            return Failure::other(error).hint("the same command goes on from here");
        }
        Failure::other(error)
            .hint(format!("what is there, and what is in the way: diaphane rig list {name}"))
    })?;
    progress.finish("ready");
    *PARK.lock().unwrap_or_else(std::sync::PoisonError::into_inner) = Some(parking);
    Ok(rig)
}

/// Of a simulated stage, mm or degrees a second: about that of a small real one.
const SPEED: f64 = 20.0;

/// The devices that a rig file calls simulated: those around the block of the demo.
#[derive(Default)]
pub(crate) struct Simulated {
    rig: OnceLock<SimulatedRig>,
}

impl Simulated {
    fn devices(&self) -> Result<Rig, DeviceError> {
        if let Some(rig) = self.rig.get() {
            return Ok(rig.rig());
        }
        let sample = SampleSpec { kind: SampleKind::Wax, seed: 1 };
        let rig = SimulatedRig::new(&sample, Face::Back)?;
        Ok(self.rig.get_or_init(|| rig).rig())
    }
}

impl SimulatedDevices for Simulated {
    fn camera(&self) -> Result<Box<dyn Camera>, DeviceError> {
        Ok(self.devices()?.camera)
    }

    fn display(&self) -> Result<Box<dyn Projector>, DeviceError> {
        Ok(self.devices()?.projector)
    }

    fn bench(&self) -> Result<Box<dyn Bench>, DeviceError> {
        Ok(self.devices()?.bench)
    }

    fn control(&self) -> Box<dyn ProjectorControl> {
        Box::new(SimulatedProjector::new(ProjectorSpec::default()))
    }

    fn stage(&self, axes: Vec<StageAxis>) -> Box<dyn Stage> {
        Box::new(SimulatedStage::new(axes, SPEED))
    }
}
