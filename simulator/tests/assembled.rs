//! A rig of devices behind their protocols carries a plan out, and stops by name when one of them
//! does: a projector that falls asleep, a stage that runs into its switch, a cable that is pulled.
#![cfg(unix)]

use std::cell::OnceCell;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use material::Face;
use rig::devices::{Parking, PowerState, ProjectorControl, Stage, StageAxis};
use rig::{
    Bench, Camera, DeviceError, DeviceErrorKind, Outcome, Pattern, Plan, Projector, Purpose, Rig,
    RigFile, RunError, RunOptions, Shot, SimulatedDevices, Step, StopStatus, Target, run,
};
use simulator::devices::{
    GrblEmulator, PjlinkEmulator, ProjectorSpec, SimulatedProjector, SimulatedStage, StageFailure,
    Wire,
};
use simulator::{SampleKind, SampleSpec, SimulatedRig};

/// The picture's way is in software, switching and moving go over wires.
#[derive(Default)]
struct Software(OnceCell<SimulatedRig>);

impl Software {
    fn rig(&self) -> Rig {
        let sample = SampleSpec { kind: SampleKind::Wax, seed: 1 };
        self.0.get_or_init(|| SimulatedRig::new(&sample, Face::Back).unwrap()).rig()
    }
}

impl SimulatedDevices for Software {
    fn camera(&self) -> Result<Box<dyn Camera>, DeviceError> {
        Ok(self.rig().camera)
    }
    fn display(&self) -> Result<Box<dyn Projector>, DeviceError> {
        Ok(self.rig().projector)
    }
    fn bench(&self) -> Result<Box<dyn Bench>, DeviceError> {
        Ok(self.rig().bench)
    }
    fn control(&self) -> Box<dyn ProjectorControl> {
        unreachable!("it is behind PJLink")
    }
    fn stage(&self, _: Vec<StageAxis>) -> Box<dyn Stage> {
        unreachable!("it is behind GRBL")
    }
}

struct Bed {
    rig: Rig,
    parking: Parking,
    projector: SimulatedProjector,
    stage: SimulatedStage,
    _wires: [Wire; 2],
}

/// Everything on, the stage where it happens to be.
fn bed() -> Bed {
    let spec = ProjectorSpec { warm_up: Duration::from_millis(100), ..ProjectorSpec::default() };
    let projector = SimulatedProjector::new(spec);
    let pjlink = Wire::tcp(0, PjlinkEmulator::new(projector.clone(), None)).unwrap();
    let (host, port) = ("127.0.0.1", pjlink.address().to_owned());
    let text = |serial: &str| {
        format!(
            r#"
version = 1
[camera]
driver = "simulated"
[projector.display]
driver = "simulated"
[projector.control]
driver = "pjlink"
host = "{host}"
port = {port}
input = "31"
[hands]
driver = "simulated"
[stage]
driver = "grbl"
port = "{serial}"
axes = [{{ name = "slide", letter = "X", unit = "mm", range = [0.0, 100.0], park = 7.5 }}]
[[places]]
target = "away"
at = {{ slide = 20.0 }}
[[places]]
target = "front-plane"
at = {{ slide = 30.0 }}
"#
        )
    };
    let axes = RigFile::parse(Path::new("rig.toml"), &text("unplugged")).unwrap();
    let stage = SimulatedStage::new(axes.stage.unwrap().axes(), 200.0);
    let grbl = Wire::serial(GrblEmulator::new(stage.clone())).unwrap();
    let file = RigFile::parse(Path::new("rig.toml"), &text(grbl.address())).unwrap();
    let mut waited = Vec::new();
    let software = Software::default();
    let opened = file.assemble(software.bench().unwrap(), &software, &mut |what| {
        waited.push(what.to_owned());
        true
    });
    let (rig, parking) = opened.unwrap();
    // It was off, and the capture began once it was on.
    assert!(waited.iter().any(|what| what.contains("projector off")), "{waited:?}");
    assert_eq!(projector.input(), "31");
    Bed { rig, parking, projector, stage, _wires: [pjlink, grbl] }
}

fn plan() -> Plan {
    let shot = |name: &str, target, pattern| Shot {
        name: name.into(),
        purpose: Purpose::Noise,
        exposures_s: vec![0.05, 0.1],
        repeats: 1,
        target,
        pattern,
    };
    Plan {
        shots: vec![
            shot("dark", Target::Dark, Pattern::Black),
            shot("sheet", Target::FaceSheet { face: Face::Front }, Pattern::White),
            shot("flat", Target::Flat, Pattern::Black),
        ],
    }
}

/// Runs the plan; `at` hears of everything that happens.
fn go(
    rig: &mut Rig,
    session: &Path,
    mut at: impl FnMut(usize, &Step),
) -> Result<Outcome, RunError> {
    let stop = AtomicBool::new(false);
    let options = RunOptions { retry_wait: Duration::from_millis(20), ..RunOptions::new(&stop) };
    run(&plan(), rig, session, options, &mut |p| at(p.done, &p.step))
}

fn last_words(session: &Path) -> (StopStatus, String) {
    let journal = rig::read_journal(&session.join("journal.jsonl")).unwrap();
    match journal.entries.into_iter().next_back().unwrap().event {
        rig::Event::Stopped { status, reason } => (status, reason),
        other => panic!("{other:?}"),
    }
}

#[test]
fn devices_behind_wires_carry_a_plan_out_and_are_put_away() {
    let folder = tempfile::tempdir().unwrap();
    let mut bed = bed();
    let mut seen = Vec::new();
    let stage = bed.stage.clone();
    let outcome = go(&mut bed.rig, folder.path(), |_, step| {
        if *step == Step::Taken {
            seen.push(stage.at(0).round());
        }
    });
    assert_eq!(outcome.unwrap(), Outcome { taken: 6, kept: 0, missing: 0 });
    // Frames of a placement are all told before the next: the stage stands where they belong.
    assert_eq!(seen, [20.0, 20.0, 30.0, 30.0, 20.0, 20.0]);
    assert!(bed.parking.park(Duration::from_secs(10)).is_empty());
    // GRBL counts in steps of a hundredth of a millimetre or so.
    assert!((bed.stage.at(0) - 7.5).abs() < 0.01, "{}", bed.stage.at(0));
    assert_ne!(bed.projector.power_state().unwrap(), PowerState::On);
    // The rig's own way of parking does the same.
    let mut bed = self::bed();
    bed.rig.bench.park().unwrap();
    bed.rig.projector.park().unwrap();
    assert!((bed.stage.at(0) - 7.5).abs() < 0.01);
    assert_ne!(bed.projector.power_state().unwrap(), PowerState::On);
}

#[test]
fn a_projector_that_falls_asleep_leaves_no_dark_frame() {
    let folder = tempfile::tempdir().unwrap();
    let mut bed = bed();
    let mut projector = bed.projector.clone();
    let error = go(&mut bed.rig, folder.path(), |done, step| {
        if (done, step) == (2, &Step::Placing(Target::FaceSheet { face: Face::Front })) {
            projector.set_power(false).unwrap();
        }
    })
    .unwrap_err();
    let RunError::Device { shot, source } = &error else { panic!("{error}") };
    assert_eq!((shot.as_str(), source.kind()), ("sheet", DeviceErrorKind::Fault), "{error}");
    assert!(error.to_string().contains("in the middle of a capture"), "{error}");
    let (status, reason) = last_words(folder.path());
    assert!(status == StopStatus::Failed && reason.contains("sheet"), "{reason}");
    assert!(!folder.path().join("frames/sheet/sheet-e0-r0.png").exists());

    // Switched on again, it goes on from there.
    let mut bed = self::bed();
    let outcome = go(&mut bed.rig, folder.path(), |_, _| ()).unwrap();
    assert_eq!(outcome, Outcome { taken: 4, kept: 2, missing: 0 });

    let folder = tempfile::tempdir().unwrap();
    let mut projector = bed.projector.clone();
    let error = go(&mut bed.rig, folder.path(), |done, step| {
        if done == 2 && *step == Step::Taken {
            projector.set_av_mute(true).unwrap();
        }
    })
    .unwrap_err();
    assert!(error.to_string().contains("muted"), "{error}");
}

#[test]
fn a_stage_alarm_stops_the_capture_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut bed = bed();
    let stage = bed.stage.clone();
    let error = go(&mut bed.rig, folder.path(), |done, step| {
        if done == 2 && *step == Step::Taken {
            stage.fail(StageFailure::HitLimit);
        }
    })
    .unwrap_err();
    let RunError::Device { shot, source } = &error else { panic!("{error}") };
    assert_eq!((shot.as_str(), source.kind()), ("sheet", DeviceErrorKind::Fault), "{error}");
    // It does not move by itself after an alarm, not even to be parked.
    assert_eq!(bed.parking.park(Duration::from_secs(10)).len(), 1);
    assert_ne!(
        bed.projector.power_state().unwrap(),
        PowerState::On,
        "the lamp is off all the same"
    );
    assert_eq!(last_words(folder.path()).0, StopStatus::Failed);
}
