//! The simulated rig as hardware: nothing of what a capture on a real rig does is left out, only
//! the light is not real.

mod camera;
mod hands;

use std::io::Write;
use std::path::{Path, PathBuf};

use material::{Face, FileError, Overwrite, atomic_write};
use rig::DeviceError;
use rig::devices::{Coordinate, Degrees, Millimetres, Range, StageAxis};

use super::{
    GigeCamera, GrblEmulator, OptomaEmulator, PjlinkEmulator, ProjectorSpec, Screen,
    SimulatedProjector, SimulatedStage, VirtualScreen, Wire,
};
use crate::{Imperfections, SampleSpec, SimulatedRig, Transport};
use camera::TwinCamera;
use hands::Hands;

/// What a twin is to be.
#[derive(Clone, Debug)]
pub struct TwinSpec {
    /// What lies on the rig.
    pub sample: SampleSpec,
    /// The face that the projector lights.
    pub lit: Face,
    /// How light gets through what lies there.
    pub transport: Transport,
    /// The monitor that the projector is: X server (`None` for that of `DISPLAY`) and name. Without
    /// one, a screen in memory of the projector's size.
    pub monitor: Option<(Option<String>, String)>,
    /// Where its rig file goes, and what belongs to it.
    pub folder: PathBuf,
}

/// Why there is no twin.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// A part of it.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// Its folder.
    #[error(transparent)]
    File(#[from] FileError),
    /// A port, a pseudo-terminal or a program of the system.
    #[error("{what}: {source}")]
    System {
        /// What could not be had.
        what: &'static str,
        /// Why.
        source: std::io::Error,
    },
}

/// A simulated rig behind the protocols of real devices: a GigE Vision camera on the loopback
/// interface, a projector that is a monitor and is switched over PJLink or, at a serial port, in
/// Optoma's words, a stage with GRBL at another, and hands. The sample is lit by what really stands on the monitor, while the lamp
/// burns. The stage moves; nothing stands on it.
///
/// Exposures are whole microseconds, as the camera counts. Nobody tells the camera which frame of a
/// plan comes next, so that each frame is lit and noisy as the first one of its kind.
///
/// It ends when this is dropped.
pub struct Twin {
    // It looks at the screen, so it goes first.
    camera: GigeCamera,
    stand: SimulatedStage,
    lamp: SimulatedProjector,
    optoma: Wire,
    _parts: (Hands, Wire, Wire, Option<VirtualScreen>),
    rig_file: PathBuf,
}

/// How the camera is told from others.
const SERIAL: &str = "TWIN";
/// Of the stage, mm or degrees a second.
const SPEED: f64 = 200.0;

impl Twin {
    /// Starts everything, and writes `rig.toml` into the folder last.
    ///
    /// # Errors
    /// A part cannot be had: another twin runs on this machine, Xvfb is not installed, or the
    /// monitor is not there or not of the projector's size; or there is a rig file already.
    pub fn start(spec: &TwinSpec, overwrite: Overwrite) -> Result<Self, TwinError> {
        let path = spec.folder.join("rig.toml");
        if overwrite == Overwrite::Refuse && path.exists() {
            return Err(FileError::Exists { path }.into());
        }
        let system = |what| move |source| TwinError::System { what, source };
        let plain = Imperfections::default();
        let rig = SimulatedRig::with(&spec.sample, spec.lit, &plain, spec.transport)?;
        let [width, height] = rig.projector_px();
        let (screen, server, monitor) = match &spec.monitor {
            Some((server, monitor)) => (None, server.clone(), Some(monitor.as_str())),
            None => {
                let screen = VirtualScreen::start(width, height)
                    .map_err(system("Xvfb, the screen in memory"))?;
                let server = screen.server().to_owned();
                (Some(screen), Some(server), None)
            }
        };
        let seen = Screen::open(server.as_deref(), monitor)?;
        let monitor = seen.monitor().name.clone();
        let lamp = SimulatedProjector::new(ProjectorSpec::default());
        let control = Wire::tcp(0, PjlinkEmulator::new(lamp.clone(), None))
            .map_err(system("port for PJLink"))?;
        let optoma = Wire::serial(OptomaEmulator::new(lamp.clone()))
            .map_err(system("pseudo-terminal of the projector"))?;
        let stand = SimulatedStage::new(axes(), SPEED);
        let stage = Wire::serial(GrblEmulator::new(stand.clone()))
            .map_err(system("pseudo-terminal of the stage"))?;
        let devices = rig.rig();
        let eye = TwinCamera::new(devices.camera, devices.projector, seen, lamp.clone())?;
        let camera = GigeCamera::serve(Box::new(eye), "lo", SERIAL)?;
        // Last, so that nothing is left of a twin that could not be.
        std::fs::create_dir_all(&spec.folder).map_err(system("folder of the twin"))?;
        // The rig file is used from other places than where it lies.
        let folder = spec.folder.canonicalize().map_err(system("folder of the twin"))?;
        let rig_file = folder.join("rig.toml");
        let hands = Hands::start(&folder, devices.bench)?;
        let server = server.map_or(String::new(), |server| format!("server = {server:?}\n"));
        let text = format!(
            "# A twin: it is there while diaphane rig twin runs.\n\
             version = 1\n\n\
             [camera]\ndriver = \"aravis\"\nserial = \"{SERIAL}\"\n\n\
             [projector.display]\ndriver = \"window\"\nmonitor = {monitor:?}\n{server}\
             # No electronics between the screen and its light.\nsettle_ms = 0.0\n\n\
             [projector.control]\ndriver = \"pjlink\"\nhost = \"127.0.0.1\"\nport = {port}\n\
             input = \"31\"\n\
             # The same projector at its serial port:\n\
             # driver = \"optoma\"\n# port = {serial:?}\n# input = \"1\"\n\n\
             [hands]\ndriver = \"program\"\nprogram = {hands:?}\nlimit_s = 30.0\n\n\
             [stage]\ndriver = \"grbl\"\nport = {stage:?}\n\n\
             [[stage.axes]]\nname = \"slide\"\nletter = \"X\"\nunit = \"mm\"\n\
             range = [0.0, 200.0]\npark = 0.0\n\n\
             [[stage.axes]]\nname = \"turntable\"\nletter = \"Y\"\nunit = \"deg\"\n\
             range = [-180.0, 180.0]\n\n\
             [[places]]\ntarget = \"sample\"\nat = {{ slide = 120.0, turntable = 0.0 }}\n\n\
             [[places]]\ntarget = \"back-plane\"\nat = {{ slide = 130.0 }}\n\n\
             [[places]]\ntarget = \"front-plane\"\nat = {{ slide = 110.0 }}\n\n\
             [[places]]\ntarget = \"held\"\nat = {{ slide = 10.0, turntable = 90.0 }}\n",
            port = control.address(),
            serial = optoma.address(),
            hands = hands.program(),
            stage = stage.address(),
        );
        atomic_write(&rig_file, overwrite, |file| file.write_all(text.as_bytes()))?;
        Ok(Self { camera, stand, lamp, optoma, _parts: (hands, control, stage, screen), rig_file })
    }

    /// The rig file that describes it, from the root.
    pub fn rig_file(&self) -> &Path {
        &self.rig_file
    }

    /// The stage itself, wherever its controller says that it is.
    pub fn stage(&self) -> &SimulatedStage {
        &self.stand
    }

    /// What the projector's remote control switches.
    pub fn lamp(&self) -> &SimulatedProjector {
        &self.lamp
    }

    /// The projector's serial port, where it understands Optoma's words.
    pub fn optoma_port(&self) -> &str {
        self.optoma.address()
    }

    /// Why the camera gave no frame when it was asked for one last, if it gave none.
    pub fn failure(&self) -> Option<DeviceError> {
        self.camera.failure()
    }
}

/// A slide and a turntable.
fn axes() -> Vec<StageAxis> {
    let slide = Range::Linear(Millimetres(0.0), Millimetres(200.0));
    let turn = Range::Rotary(Degrees(-180.0), Degrees(180.0));
    vec![
        StageAxis {
            name: "slide".into(),
            range: slide,
            park: Some(Coordinate::Linear(Millimetres(0.0))),
        },
        StageAxis { name: "turntable".into(), range: turn, park: None },
    ]
}
