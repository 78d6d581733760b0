//! A capture through the twin, with the drivers that speak to hardware, against the simulated rig
//! itself.
#![cfg(all(feature = "aravis", feature = "display", target_os = "linux"))]

use material::{Face, Overwrite};
use rig::devices::display::{Display, WindowProgram};
use rig::devices::{PowerState, ProjectorControl, Stage, StageAxis};
use rig::{
    Axis, Bench, Camera, DeviceError, DisplayConfig, Outcome, Pattern, Plan, Projector, Purpose,
    Rig, RigFile, RunOptions, Shot, SimulatedDevices, Target, frame_path, read_frame, run,
};
use simulator::devices::{Twin, TwinSpec};
use simulator::{SampleKind, SampleSpec, SimulatedRig, Transport};
use std::fs::File;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

const SAMPLE: SampleSpec = SampleSpec { kind: SampleKind::Wax, seed: 1 };

/// One of each kind that a capture knows, at two exposures of whole microseconds: the camera counts
/// those.
fn plan() -> Plan {
    let back = Face::Back;
    let wave = Pattern::Phase { axis: Axis::X, period_px: 32, step: 1, steps: 4 };
    let code = Pattern::GrayCode { axis: Axis::X, bit: 3, inverse: true };
    let shots = [
        ("region", Target::Sample, Pattern::region(2, 2, 1)),
        ("wave", Target::FaceSheet { face: back }, wave),
        ("black", Target::FaceSheet { face: back }, Pattern::Black),
        ("code", Target::Board { pose: 1 }, code),
    ];
    let shot = |(name, target, pattern): (&str, Target, Pattern)| Shot {
        name: name.into(),
        purpose: Purpose::Fit,
        exposures_s: vec![0.033_334, 0.25],
        repeats: 1,
        target,
        pattern,
    };
    Plan { shots: shots.into_iter().map(shot).collect() }
}

/// Takes the whole plan.
fn capture(rig: &mut Rig, session: &Path) {
    // Somewhere askew on the block.
    let face = |[x, y]: [f64; 2]| Some([(x - 300.0) / 400.0, (y - 200.0) / 380.0 + x / 9000.0]);
    let stop = AtomicBool::new(false);
    let options = RunOptions { face_map: Some(&face), ..RunOptions::new(&stop) };
    let outcome = run(&plan(), rig, session, options, &mut |_| {}).unwrap();
    assert_eq!(outcome, Outcome { taken: 8, kept: 0, missing: 0 });
}

/// Values that differ between the frames of two sessions.
fn differences(a: &Path, b: &Path) -> Vec<(String, usize)> {
    let mut out = Vec::new();
    for shot in plan().shots {
        for exposure in 0..shot.exposures_s.len() {
            let file = frame_path(&shot.name, exposure, 0);
            let (left, _) = read_frame(&a.join(&file)).unwrap();
            let (right, _) = read_frame(&b.join(&file)).unwrap();
            assert_eq!(left.exposure_s, right.exposure_s, "{file}");
            assert_eq!((left.width, left.channels), (right.width, right.channels), "{file}");
            assert_eq!(left.data.len(), right.data.len(), "{file}");
            out.push((file, left.data.iter().zip(&right.data).filter(|(l, r)| l != r).count()));
        }
    }
    out
}

/// The window of the rig file, which in this program has to be another one's.
struct Window(DisplayConfig);

impl SimulatedDevices for Window {
    fn display(&self) -> Result<Box<dyn Projector>, DeviceError> {
        let DisplayConfig::Window { monitor, server, settle_ms } = &self.0 else { panic!() };
        let program = WindowProgram::at(Path::new(env!("CARGO_BIN_EXE_diaphane")));
        let settle = Duration::from_secs_f64(settle_ms / 1e3);
        Ok(Box::new(Display::open(server.as_deref(), monitor, settle, &program)?))
    }

    fn camera(&self) -> Result<Box<dyn Camera>, DeviceError> {
        panic!("a simulated camera")
    }

    fn bench(&self) -> Result<Box<dyn Bench>, DeviceError> {
        panic!("simulated hands")
    }

    fn control(&self) -> Box<dyn ProjectorControl> {
        panic!("a simulated remote control")
    }

    fn stage(&self, _: Vec<StageAxis>) -> Box<dyn Stage> {
        panic!("a simulated stage")
    }
}

/// Nobody.
struct Nobody;

impl Bench for Nobody {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        panic!("{target} was to be placed by a person")
    }
}

#[test]
fn frames_through_real_drivers_are_those_of_the_simulated_rig() {
    // There can be one GigE Vision camera at an address: tests of cameras wait for each other.
    let lock = std::env::temp_dir().join("diaphane-gige-tests.lock");
    let lock = File::options().create(true).truncate(false).write(true).open(lock).unwrap();
    lock.lock().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir(&path).unwrap();
        path
    };
    let (direct, through) = (at("direct"), at("through"));
    capture(&mut SimulatedRig::new(&SAMPLE, Face::Back).unwrap().rig(), &direct);

    let spec = TwinSpec {
        sample: SAMPLE,
        lit: Face::Back,
        transport: Transport::Diffusion,
        monitor: None,
        folder: at("twin"),
    };
    let twin = Twin::start(&spec, Overwrite::Refuse).unwrap();
    let mut file = RigFile::read(twin.rig_file()).unwrap();
    let window = file.projector.display.replace(DisplayConfig::Simulated {}).unwrap();
    let (mut rig, parking) =
        file.assemble(Box::new(Nobody), &Window(window), &mut |_| true).unwrap();
    capture(&mut rig, &through);
    for (file, count) in differences(&direct, &through) {
        assert_eq!(count, 0, "{file}: values that differ");
    }
    assert!(twin.failure().is_none());
    // The last thing that was photographed was held, far from where blocks lie.
    assert_eq!((twin.stage().at(0), twin.stage().at(1)), (10.0, 90.0));
    assert_eq!(twin.lamp().input(), "31");
    // The same lamp, over its other wire.
    let patience = rig::devices::Patience::default();
    let mut serial = rig::devices::Optoma::new(twin.optoma_port(), 9600, 0, patience);
    assert_eq!(serial.power_state().unwrap(), PowerState::On);
    assert_eq!(parking.park(Duration::from_secs(20)).len(), 0);
    assert_eq!(twin.stage().at(0), 0.0);
    let mut lamp = twin.lamp().clone();
    assert_ne!(lamp.power_state().unwrap(), PowerState::On);
}
