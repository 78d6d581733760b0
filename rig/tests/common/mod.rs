//! A rig that exists only in these tests, and what a run on it leaves.
#![allow(dead_code, reason = "each test takes what it needs")]

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use material::Face;
use rig::{
    Bench, Camera, CameraInfo, DeviceError, Event, Frame, Outcome, Pattern, Plan, Projector,
    ProjectorImage, ProjectorInfo, Purpose, Rig, RunError, RunOptions, Shot, Step, StopStatus,
    Target, read_journal, run,
};

/// What is on the bench and on the screen, and what the devices are told to do wrong.
#[derive(Default)]
pub struct Scene {
    pub placed: Mutex<Option<Target>>,
    pub light: Mutex<u64>,
    pub exposures: AtomicUsize,
    pub placements: AtomicUsize,
    /// Errors that the camera returns before it works again.
    pub faults: Mutex<Vec<DeviceError>>,
    /// A frame whose values exceed the bit depth.
    pub impossible: AtomicBool,
}

pub struct FakeCamera(pub Arc<Scene>);
pub struct FakeProjector(pub Arc<Scene>);
pub struct FakeBench(pub Arc<Scene>);

impl Camera for FakeCamera {
    fn info(&self) -> CameraInfo {
        CameraInfo { name: "fake".into(), width: 6, height: 4, channels: 3, bit_depth: 12 }
    }

    /// Every pixel depends on its place, the target, the light and the exposure, so that a frame
    /// taken under the wrong conditions differs.
    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        if let Some(fault) = self.0.faults.lock().unwrap().pop() {
            return Err(fault);
        }
        self.0.exposures.fetch_add(1, Ordering::Relaxed);
        let target = format!("{:?}", self.0.placed.lock().unwrap());
        let place = target.bytes().map(u64::from).sum::<u64>();
        let seed = place * 31 + *self.0.light.lock().unwrap() * 7 + (exposure_s * 240.0) as u64;
        let value = |i: u64| ((seed + i * 37) % 4096) as u16;
        let mut data: Vec<u16> = (0..72).map(value).collect();
        if self.0.impossible.load(Ordering::Relaxed) {
            data[5] = 4096;
        }
        let exposure_s = exposure_s * 1.01;
        Ok(Frame { width: 6, height: 4, channels: 3, bit_depth: 12, data, exposure_s })
    }
}

impl Projector for FakeProjector {
    fn info(&self) -> ProjectorInfo {
        ProjectorInfo { name: "fake".into(), width: 16, height: 8 }
    }

    fn show(&mut self, image: &ProjectorImage) -> Result<(), DeviceError> {
        assert_eq!((image.width, image.height, image.data.len()), (16, 8, 128));
        let weighted = image.data.iter().zip(1..).map(|(&v, i)| u64::from(v) * i);
        *self.0.light.lock().unwrap() = weighted.sum();
        Ok(())
    }
}

impl Bench for FakeBench {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        self.0.placements.fetch_add(1, Ordering::Relaxed);
        *self.0.placed.lock().unwrap() = Some(*target);
        Ok(())
    }
}

pub fn fake() -> (Rig, Arc<Scene>) {
    let scene = Arc::new(Scene::default());
    let rig = Rig {
        camera: Box::new(FakeCamera(scene.clone())),
        projector: Box::new(FakeProjector(scene.clone())),
        bench: Box::new(FakeBench(scene.clone())),
    };
    (rig, scene)
}

pub fn plan() -> Plan {
    let shot = |name: &str, target, pattern, exposures_s: &[f64], repeats| Shot {
        name: name.into(),
        purpose: Purpose::Fit,
        exposures_s: exposures_s.into(),
        repeats,
        target,
        pattern,
    };
    let sheet = Target::FaceSheet { face: Face::Back };
    Plan {
        shots: vec![
            shot("sheet", sheet, Pattern::White, &[0.1], 2),
            shot("black", Target::Sample, Pattern::Black, &[0.1, 1.0], 1),
            shot("region-01", Target::Sample, Pattern::region(2, 2, 0), &[0.1, 1.0], 2),
            shot("region-04", Target::Sample, Pattern::region(2, 2, 3), &[0.1], 1),
        ],
    }
}

pub const FRAMES: usize = 9;

/// A camera that asks the run to stop while it takes its last frame but so many.
pub struct Stopping {
    camera: Box<dyn Camera>,
    left: usize,
    stop: Arc<AtomicBool>,
}

impl Camera for Stopping {
    fn info(&self) -> CameraInfo {
        self.camera.info()
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        let frame = self.camera.expose(exposure_s)?;
        self.left = self.left.saturating_sub(1);
        self.stop.store(self.left == 0, Ordering::Relaxed);
        Ok(frame)
    }
}

/// Runs the plan; it is asked to stop during the frame of the number `stop_after`.
pub fn go(
    rig: &mut Rig,
    plan: &Plan,
    session: &Path,
    stop_after: Option<usize>,
) -> Result<Outcome, RunError> {
    let stop = Arc::new(AtomicBool::new(stop_after == Some(0)));
    if let Some(left) = stop_after {
        let camera = std::mem::replace(&mut rig.camera, Box::new(FakeCamera(Arc::default())));
        rig.camera = Box::new(Stopping { camera, left, stop: stop.clone() });
    }
    let map = |[x, y]: [f64; 2]| Some([x / 15.0, y / 7.0]);
    let options = RunOptions {
        face_map: Some(&map),
        retry_wait: Duration::from_millis(1),
        ..RunOptions::new(&stop)
    };
    let frames: usize = plan.shots.iter().map(Shot::frames).sum();
    let mut told = 0;
    let outcome = run(plan, rig, session, options, &mut |progress| {
        if matches!(progress.step, Step::Taken | Step::Kept) {
            told += 1;
            // Each frame once, in the plan's order, and on disk by then.
            assert_eq!((progress.done, progress.total), (told, frames));
            assert!(files(session).len() >= told);
            let left_s = progress.left_s.unwrap();
            // Nothing is left after the last but what subtractions round, and something before.
            assert_eq!(left_s < 1e-9, told == frames, "{left_s} s left after {told} frames");
        }
    })?;
    assert_eq!(told, outcome.taken + outcome.kept);
    Ok(outcome)
}

/// Every file under `frames`, with its content.
pub fn files(session: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let Ok(shots) = std::fs::read_dir(session.join("frames")) else { return files };
    for shot in shots {
        for file in std::fs::read_dir(shot.unwrap().path()).unwrap() {
            let path = file.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            // One that is being written, and may be gone by now.
            if name.starts_with(".part-") {
                continue;
            }
            files.insert(name, std::fs::read(path).unwrap());
        }
    }
    files
}

pub fn reference() -> BTreeMap<String, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let outcome = go(&mut fake().0, &plan(), folder.path(), None).unwrap();
    assert_eq!(outcome, Outcome { taken: FRAMES, kept: 0, missing: 0 });
    files(folder.path())
}

pub fn events(session: &Path) -> Vec<Event> {
    let recorded = read_journal(&session.join("journal.jsonl")).unwrap();
    recorded.entries.into_iter().map(|entry| entry.event).collect()
}

pub fn last_status(session: &Path) -> StopStatus {
    match events(session).pop() {
        Some(Event::Stopped { status, .. }) => status,
        other => panic!("the journal ends with {other:?}"),
    }
}
