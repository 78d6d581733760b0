//! From a rig file to a rig that is ready to work.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::{HandsConfig, PlaceConfig, RigFile};
use crate::devices::controlled::ControlledProjector;
use crate::devices::hands::{Places, StagedBench};
use crate::devices::{Coordinate, Parking, PowerState, Stage, power_on};
use crate::{Bench, DeviceError, Rig, SimulatedDevices};

/// The slowest stages need a minute or two.
const HOMING: Duration = Duration::from_secs(180);

impl RigFile {
    /// Opens the devices, switches the projector on and waits until it is, and sends a stage that has
    /// places to go to its switches: `progress` hears what is being waited for, and says whether to
    /// go on. `person` puts things on the bench where the
    /// file names nobody else.
    ///
    /// # Errors
    /// A device that is not there, not free or not well, or a file without a camera or without
    /// something that shows pictures.
    pub fn assemble(
        &self,
        person: Box<dyn Bench>,
        simulated: &dyn SimulatedDevices,
        progress: &mut dyn FnMut(&str) -> bool,
    ) -> Result<(Rig, Parking), DeviceError> {
        let lacks = |what: &str| DeviceError::Unsupported {
            device: "the rig file".into(),
            reason: format!("it has no {what}, which a capture needs"),
        };
        let camera = self.camera.as_ref().ok_or_else(|| lacks("[camera]"))?;
        let display =
            self.projector.display.as_ref().ok_or_else(|| lacks("[projector.display]"))?;
        let hands = self.hands.program();
        if let Some(program) = &hands {
            // Before the lamp, which takes minutes.
            program.find()?;
        }
        let mut parking = Parking::default();
        // The lamp first: it takes minutes, and has to be steady.
        if let Some(config) = &self.projector.control {
            let mut control = config.open(simulated);
            power_on(control.as_mut(), config.warm_up(), &mut |state: PowerState, passed| {
                progress(&format!("projector {state}, {:.0} s", passed.as_secs_f64()))
            })?;
            if let Some(input) = config.input() {
                control.select_input(input)?;
            }
            if control.av_mute()? == Some(true) {
                control.set_av_mute(false)?;
            }
            parking.control = Some(Arc::new(Mutex::new(control)));
        }
        let camera = camera.open(simulated)?;
        let mut projector = display.open(simulated)?;
        if let Some(control) = &parking.control {
            let control = Arc::clone(control);
            projector = Box::new(ControlledProjector { display: projector, control });
        }
        let mut bench: Box<dyn Bench> = match (hands, &self.hands) {
            (Some(program), _) => Box::new(program),
            (None, HandsConfig::Simulated {}) => simulated.bench()?,
            (None, _) => person,
        };
        if let Some(config) = &self.stage {
            let mut stage = config.open(simulated);
            let places = places(&self.places, stage.as_ref())?;
            // Many controllers forget where they are when they are opened; who has no switches
            // takes where it stands for its reference.
            if !places.is_empty() {
                progress("the stage goes to its switches");
                match stage.home(HOMING) {
                    Ok(()) | Err(DeviceError::Unsupported { .. }) => {}
                    Err(error) => return Err(error),
                }
            }
            let stage = Arc::new(Mutex::new(stage));
            parking.stage = Some(Arc::clone(&stage));
            bench = Box::new(StagedBench { hands: bench, stage, places });
        }
        Ok((Rig { camera, projector, bench }, parking))
    }
}

/// The places of a rig file by number of the axis.
fn places(configs: &[PlaceConfig], stage: &dyn Stage) -> Result<Places, DeviceError> {
    let mut places = Places::new();
    for config in configs {
        let mut moves = Vec::new();
        // In the order of the file's axes, so that nothing depends on how a map is sorted.
        for (number, axis) in stage.axes().iter().enumerate() {
            if let Some(&value) = config.at.get(&axis.name) {
                let to = match axis.range.ends().0 {
                    Coordinate::Linear(_) => Coordinate::Linear(crate::devices::Millimetres(value)),
                    Coordinate::Rotary(_) => Coordinate::Rotary(crate::devices::Degrees(value)),
                };
                axis.admit(&stage.name(), to)?;
                moves.push((number, to));
            }
        }
        places.insert(config.target.name(), moves);
    }
    Ok(places)
}
