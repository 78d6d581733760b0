//! Every call that a plan makes to a device goes wrong once, in every way: the run goes on to the
//! same frames, or stops by name and goes on later.

mod common;

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use common::*;
use rig::{
    Bench, Camera, CameraInfo, DeviceError, Event, Frame, Outcome, Projector, ProjectorImage,
    ProjectorInfo, Readback, Rig, RunError, RunOptions, Step, StopStatus, Target, run,
};

/// What a device does at one call, instead of what it should.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrong {
    NotFound,
    NoPermission,
    Busy,
    Disconnected,
    Timeout,
    Garbage,
    Unsupported,
    Fault,
    Declined,
    /// Of a camera alone: a picture of another size, with too few values, beyond its bits, and one
    /// that was never exposed.
    Size,
    Short,
    Bits,
    Never,
    /// Of a projector: the picture goes dark under the camera, and only asking shows it.
    Dark,
}

const ERRORS: [Wrong; 9] = [
    Wrong::NotFound,
    Wrong::NoPermission,
    Wrong::Busy,
    Wrong::Disconnected,
    Wrong::Timeout,
    Wrong::Garbage,
    Wrong::Unsupported,
    Wrong::Fault,
    Wrong::Declined,
];
const FRAME_FAULTS: [Wrong; 4] = [Wrong::Size, Wrong::Short, Wrong::Bits, Wrong::Never];

impl Wrong {
    /// Whether a repetition may help, so that the run should not end.
    fn passes(self) -> bool {
        use Wrong::*;
        matches!(
            self,
            NotFound | Busy | Disconnected | Timeout | Garbage | Size | Short | Never | Dark
        )
    }

    fn error(self) -> Option<DeviceError> {
        let device = || "faulty".to_owned();
        let reason = || "as the test wants it".to_owned();
        Some(match self {
            Self::NotFound => DeviceError::NotFound { device: device() },
            Self::NoPermission => {
                DeviceError::NoPermission { device: device(), path: "/dev/null".into() }
            }
            Self::Busy => DeviceError::Busy { device: device() },
            Self::Disconnected => DeviceError::Disconnected { device: device() },
            Self::Timeout => DeviceError::Timeout { device: device(), waited_s: 3.0 },
            Self::Garbage => DeviceError::Protocol {
                device: device(),
                expected: "sense".into(),
                bytes: b"\xff\0nonsense".to_vec(),
            },
            Self::Unsupported => DeviceError::Unsupported { device: device(), reason: reason() },
            Self::Fault => DeviceError::Fault { device: device(), reason: reason() },
            Self::Declined => DeviceError::Declined { device: device(), reason: reason() },
            _ => return None,
        })
    }
}

/// Counts the calls to all devices and spoils one.
#[derive(Default)]
struct Spoiler {
    calls: Mutex<Vec<&'static str>>,
    at: usize,
    wrong: Option<Wrong>,
    /// The picture on the wall has gone.
    dark: AtomicBool,
}

impl Spoiler {
    /// What goes wrong with this call.
    fn call(&self, what: &'static str) -> Option<Wrong> {
        let mut calls = self.calls.lock().unwrap();
        calls.push(what);
        self.wrong.filter(|_| calls.len() == self.at + 1)
    }

    fn fails(&self, what: &'static str) -> Result<(), DeviceError> {
        match self.call(what).and_then(Wrong::error) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}

struct Spoiled<T: ?Sized>(Box<T>, Arc<Spoiler>);

impl Camera for Spoiled<dyn Camera> {
    fn info(&self) -> CameraInfo {
        self.0.info()
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        let wrong = self.1.call("expose");
        if let Some(error) = wrong.and_then(Wrong::error) {
            return Err(error);
        }
        let mut frame = self.0.expose(exposure_s)?;
        if self.1.dark.load(Ordering::Relaxed) {
            frame.data.fill(0);
        }
        match wrong {
            Some(Wrong::Size) => (frame.width, frame.height) = (frame.height, frame.width),
            Some(Wrong::Short) => frame.data.truncate(71),
            Some(Wrong::Bits) => frame.data[70] = 5000,
            Some(Wrong::Never) => frame.exposure_s = f64::NAN,
            _ => {}
        }
        Ok(frame)
    }

    fn readback(&mut self) -> Result<Readback, DeviceError> {
        self.1.fails("readback")?;
        self.0.readback()
    }
}

impl Projector for Spoiled<dyn Projector> {
    fn info(&self) -> ProjectorInfo {
        self.0.info()
    }

    fn show(&mut self, image: &ProjectorImage) -> Result<(), DeviceError> {
        let wrong = self.1.call("show");
        if let Some(error) = wrong.and_then(Wrong::error) {
            return Err(error);
        }
        self.1.dark.store(wrong == Some(Wrong::Dark), Ordering::Relaxed);
        self.0.show(image)
    }

    fn still_shows(&mut self) -> Result<(), DeviceError> {
        self.1.fails("still shows")?;
        if self.1.dark.load(Ordering::Relaxed) {
            return Err(DeviceError::Disconnected { device: "faulty".into() });
        }
        self.0.still_shows()
    }
}

impl Bench for Spoiled<dyn Bench> {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        self.1.fails("place")?;
        self.0.place(target)
    }
}

fn spoiled(at: usize, wrong: Option<Wrong>) -> (Rig, Arc<Spoiler>) {
    let (rig, _) = fake();
    let spoiler = Arc::new(Spoiler { at, wrong, ..Spoiler::default() });
    let rig = Rig {
        camera: Box::new(Spoiled(rig.camera, spoiler.clone())),
        projector: Box::new(Spoiled(rig.projector, spoiler.clone())),
        bench: Box::new(Spoiled(rig.bench, spoiler.clone())),
    };
    (rig, spoiler)
}

#[test]
fn a_fault_at_any_call_ends_in_the_same_frames_or_a_named_stop() {
    let whole = reference();
    let (mut rig, spoiler) = spoiled(usize::MAX, None);
    let folder = tempfile::tempdir().unwrap();
    go(&mut rig, &plan(), folder.path(), None).unwrap();
    let calls = spoiler.calls.lock().unwrap().clone();
    // Two placements, four patterns, and three calls a frame.
    assert_eq!(calls.len(), 2 + 4 + 3 * FRAMES);

    for (at, &call) in calls.iter().enumerate() {
        let more: &[Wrong] = match call {
            "expose" => &FRAME_FAULTS,
            "show" => &[Wrong::Dark],
            _ => &[],
        };
        for &wrong in ERRORS.iter().chain(more) {
            let case = format!("call {at} ({call}): {wrong:?}");
            let folder = tempfile::tempdir().unwrap();
            let (mut rig, spoiler) = spoiled(at, Some(wrong));
            let outcome = go(&mut rig, &plan(), folder.path(), None);
            assert!(spoiler.calls.lock().unwrap().len() > at, "{case}: not reached");
            if wrong.passes() {
                assert_eq!(outcome.unwrap().taken, FRAMES, "{case}");
                let notes = events(folder.path());
                let notes = notes.iter().filter(|event| matches!(event, Event::Note { .. }));
                assert_eq!(notes.count(), 1, "{case}");
            } else {
                let error = outcome.expect_err(&case);
                let name = plan().shots.iter().any(|s| error.to_string().contains(&s.name));
                assert!(name, "{case}: {error}");
                assert!(
                    matches!(error, RunError::Device { .. } | RunError::Frame { .. }),
                    "{case}: {error}"
                );
                assert_eq!(last_status(folder.path()), StopStatus::Failed, "{case}");
                // What is there is right, and the next run finds the devices mended.
                let kept = files(folder.path());
                assert!(kept.iter().all(|(name, bytes)| whole[name] == *bytes), "{case}");
                let outcome = go(&mut fake().0, &plan(), folder.path(), None).unwrap();
                let missing = FRAMES - kept.len();
                assert_eq!(
                    outcome,
                    Outcome { taken: missing, kept: kept.len(), missing: 0 },
                    "{case}"
                );
            }
            assert_eq!(files(folder.path()), whole, "{case}");
        }
    }
}

/// A disk that is full for a while, and one that stays so.
#[test]
fn a_full_disk_is_waited_for_before_anything_is_written() {
    let stop = AtomicBool::new(false);
    let map = |[x, y]: [f64; 2]| Some([x / 15.0, y / 7.0]);
    // Full at the third look, for four looks.
    let looks = Cell::new(0);
    let filling = |_: &std::path::Path| {
        looks.set(looks.get() + 1);
        Some(if (3..7).contains(&looks.get()) { 1000 + looks.get() } else { 1 << 40 })
    };
    let options = RunOptions {
        face_map: Some(&map),
        retry_wait: Duration::from_millis(1),
        free_bytes: &filling,
        ..RunOptions::new(&stop)
    };
    let folder = tempfile::tempdir().unwrap();
    let mut waits = Vec::new();
    let outcome = run(&plan(), &mut fake().0, folder.path(), options, &mut |p| {
        if let Step::Waiting { free, needed } = p.step {
            waits.push((free, needed > 64 << 20));
        }
    });
    assert_eq!(outcome.unwrap().taken, FRAMES);
    assert_eq!(waits, [(1003, true), (1004, true), (1005, true), (1006, true)]);
    assert_eq!(files(folder.path()), reference());

    let full = |_: &std::path::Path| Some(1000);
    let folder = tempfile::tempdir().unwrap();
    let options =
        RunOptions { free_bytes: &full, space_wait: Duration::from_millis(120), ..options };
    let error = run(&plan(), &mut fake().0, folder.path(), options, &mut |_| ()).unwrap_err();
    assert!(matches!(error, RunError::NoSpace { free: 1000, .. }), "{error}");
    assert_eq!(last_status(folder.path()), StopStatus::Failed);
    assert!(files(folder.path()).is_empty());

    // Whoever waits for space can be asked to stop, by either flag.
    let other = AtomicBool::new(false);
    let waiting =
        RunOptions { space_wait: Duration::from_secs(600), other_stop: Some(&other), ..options };
    for flag in [&stop, &other] {
        let outcome = run(&plan(), &mut fake().0, folder.path(), waiting, &mut |p| {
            flag.store(matches!(p.step, Step::Waiting { .. }), Ordering::Relaxed);
        });
        assert_eq!(outcome.unwrap(), Outcome { taken: 0, kept: 0, missing: FRAMES });
        assert_eq!(last_status(folder.path()), StopStatus::Stopped);
        flag.store(false, Ordering::Relaxed);
    }
}

/// The disk of this machine, as the system tells it: `df` is the other witness.
#[test]
fn the_space_on_a_disk_is_what_the_system_says() {
    let folder = tempfile::tempdir().unwrap();
    let Ok(out) = std::process::Command::new("df").arg("-Pk").arg(folder.path()).output() else {
        println!("SKIPPED: no df here");
        return;
    };
    let text = String::from_utf8_lossy(&out.stdout).into_owned();
    let column = text.lines().nth(1).and_then(|line| line.split_whitespace().nth(3));
    let told = column.and_then(|kib| kib.parse::<f64>().ok()).unwrap() * 1024.0;
    let found = rig::free_bytes(folder.path()).unwrap() as f64;
    // Others write to this disk meanwhile.
    assert!((found - told).abs() < 0.05 * told + 1e9, "{found} against {told}");
    assert_eq!(rig::free_bytes(&folder.path().join("not-there")), None);
}

/// What the camera says of itself goes into the journal with each frame.
#[test]
fn a_frame_is_journalled_with_what_the_camera_said() {
    struct Talkative(Box<dyn Camera>, f64);
    impl Camera for Talkative {
        fn info(&self) -> CameraInfo {
            self.0.info()
        }
        fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
            self.1 += 0.5;
            self.0.expose(exposure_s)
        }
        fn readback(&mut self) -> Result<Readback, DeviceError> {
            let settings = [("Gain".to_owned(), "0 dB".to_owned())].into();
            Ok(Readback { temperature_c: Some(self.1), settings })
        }
    }
    let (mut rig, _) = fake();
    rig.camera = Box::new(Talkative(rig.camera, 40.0));
    let folder = tempfile::tempdir().unwrap();
    go(&mut rig, &plan(), folder.path(), None).unwrap();
    let mut temperatures = Vec::new();
    for event in events(folder.path()) {
        match event {
            Event::FrameWritten { device, requested_s, exposure_s, .. } => {
                temperatures.push(device.temperature_c.unwrap());
                assert_eq!(device.settings["Gain"], "0 dB");
                assert_eq!(requested_s.unwrap() * 1.01, exposure_s);
            }
            Event::Started { plan, camera, projector, frames, .. } => {
                assert_eq!((plan.len(), camera.as_str(), projector.as_str()), (64, "fake", "fake"));
                assert_eq!(frames, FRAMES);
            }
            _ => {}
        }
    }
    assert_eq!(temperatures, (1..=FRAMES).map(|i| 40.0 + i as f64 / 2.0).collect::<Vec<_>>());
}
