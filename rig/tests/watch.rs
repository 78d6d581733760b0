//! What the runner remarks while it runs: each trouble made on purpose, and none where there is none.

mod common;

use std::sync::atomic::AtomicBool;

use common::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rig::{
    Camera, CameraInfo, DeviceError, Event, Frame, Pattern, PixelRect, Plan, Projector,
    ProjectorImage, ProjectorInfo, Purpose, ReferencePatch, Rig, RunOptions, Shot, Step, Target,
    Warning, run,
};
use std::sync::{Arc, Mutex};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 96;
/// Of the projector, which the camera sees pixel by pixel. Stripes are printed on it.
const PATCH: PixelRect = PixelRect { x0: 4, y0: 8, x1: 20, y1: 24 };
/// Without its edges.
const SEEN: PixelRect = PixelRect { x0: 8, y0: 8, x1: 16, y1: 24 };

/// A camera that looks at the projector's picture on a wall, and what spoils it.
#[derive(Clone, Copy)]
struct Wall {
    /// Full scales a second at projector white.
    light: f64,
    /// Of the room, as a share of white.
    ambient: f64,
    /// Lamp's brightness per shot.
    lamp_step: f64,
    /// Pixels that the patch's edges are smeared over from the second shot on.
    blur: usize,
    /// Exponent of the camera's response.
    gamma: f64,
    /// Exposure times that the camera knows, seconds.
    grain_s: f64,
    /// Rows from which on the frame shows half of the light, in exposures of at least a second.
    split: Option<u32>,
}

const GOOD: Wall = Wall {
    light: 0.7,
    ambient: 0.002,
    lamp_step: 1.0,
    blur: 0,
    gamma: 1.0,
    grain_s: 1e-6,
    split: None,
};

struct State {
    wall: Wall,
    image: ProjectorImage,
    shots: i32,
    noise: ChaCha8Rng,
}

struct Device(Arc<Mutex<State>>);

impl Camera for Device {
    fn info(&self) -> CameraInfo {
        CameraInfo { name: "wall".into(), width: WIDTH, height: HEIGHT, channels: 1, bit_depth: 12 }
    }

    fn expose(&mut self, asked_s: f64) -> Result<Frame, DeviceError> {
        let State { wall, image, shots, noise } = &mut *self.0.lock().unwrap();
        let exposure_s = (asked_s / wall.grain_s).round() * wall.grain_s;
        let blur = if *shots > 1 { wall.blur } else { 0 };
        let mut data = Vec::new();
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let near = x.saturating_sub(blur as u32)..=(x + blur as u32).min(WIDTH - 1);
                let n = near.clone().count() as f64;
                let shown = |x: u32| {
                    let stripe = x % 8 < 4 && (PATCH.x0..PATCH.x1).contains(&x);
                    let stripe = stripe && (PATCH.y0..PATCH.y1).contains(&y);
                    f64::from(image.data[(y * WIDTH + x) as usize]) * if stripe { 0.5 } else { 1.0 }
                };
                let shown = near.map(shown).sum::<f64>() / n;
                // A wall that is brighter towards its lower right; 0.4 % of white leaks.
                let shade = 0.4 + 0.6 * f64::from(x + y) / f64::from(WIDTH + HEIGHT);
                let mut light = shade * (shown / 255.0 + 0.004 + wall.ambient);
                light *= wall.lamp_step.powi(*shots - 1);
                if wall.split.is_some_and(|row| y >= row && asked_s >= 1.0) {
                    light *= 0.5;
                }
                let value = (light * wall.light * exposure_s).min(1.0).powf(wall.gamma);
                let code = 40.0 + 4055.0 * value + 4.0 * (noise.random::<f64>() - 0.5);
                data.push(code.round().clamp(0.0, 4095.0) as u16);
            }
        }
        Ok(Frame { width: WIDTH, height: HEIGHT, channels: 1, bit_depth: 12, data, exposure_s })
    }
}

impl Projector for Device {
    fn info(&self) -> ProjectorInfo {
        ProjectorInfo { name: "wall".into(), width: WIDTH, height: HEIGHT }
    }

    fn show(&mut self, image: &ProjectorImage) -> Result<(), DeviceError> {
        let mut state = self.0.lock().unwrap();
        state.image = image.clone();
        state.shots += 1;
        Ok(())
    }
}

/// Every warning of a capture of black, white and two regions, by shot.
fn capture(wall: Wall, patch: bool) -> Vec<(String, Warning)> {
    capture_after(&[], wall, patch)
}

/// The same with other shots before.
fn capture_after(first: &[Shot], wall: Wall, patch: bool) -> Vec<(String, Warning)> {
    let black =
        ProjectorImage { width: WIDTH, height: HEIGHT, data: vec![0; (WIDTH * HEIGHT) as usize] };
    let noise = ChaCha8Rng::seed_from_u64(7);
    let state = Arc::new(Mutex::new(State { wall, image: black, shots: 0, noise }));
    let bench = fake().0.bench;
    let mut rig =
        Rig { camera: Box::new(Device(state.clone())), projector: Box::new(Device(state)), bench };
    let shot = |name: &str, pattern| Shot {
        name: name.into(),
        purpose: Purpose::Fit,
        exposures_s: vec![0.1, 0.4, 1.2],
        repeats: 1,
        target: Target::Sample,
        pattern,
    };
    let of_block = [
        shot("black", Pattern::Black),
        shot("white", Pattern::White),
        shot("region-1", Pattern::region(2, 1, 0)),
        shot("region-2", Pattern::region(2, 1, 1)),
    ];
    let plan = Plan { shots: first.iter().cloned().chain(of_block).collect() };
    let stop = AtomicBool::new(false);
    let map = |[x, y]: [f64; 2]| Some([x / f64::from(WIDTH), y / f64::from(HEIGHT)]);
    let patch = patch.then_some(ReferencePatch { projector_px: PATCH, camera_px: SEEN });
    let options = RunOptions { face_map: Some(&map), patch, ..RunOptions::new(&stop) };
    let folder = tempfile::tempdir().unwrap();
    let mut told = Vec::new();
    run(&plan, &mut rig, folder.path(), options, &mut |p| {
        if let Step::Warned(warning) = p.step {
            told.push((p.shot.to_owned(), warning));
        }
    })
    .unwrap();
    let written: Vec<(String, Warning)> = events(folder.path())
        .into_iter()
        .filter_map(|event| match event {
            Event::Warned { shot, warning } => Some((shot, warning)),
            _ => None,
        })
        .collect();
    assert_eq!(told, written);
    told
}

#[test]
fn a_good_capture_is_passed_in_silence() {
    for gamma in [1.0, 0.6, 1.6] {
        let wall = Wall { gamma, ..GOOD };
        assert_eq!(capture(wall, true), [], "gamma {gamma}");
        assert_eq!(capture(wall, false), [], "gamma {gamma}");
    }
}

#[test]
fn too_much_and_too_little_light_are_told() {
    let told = capture(Wall { light: 14.0, ..GOOD }, false);
    // The lower right of white is beyond full scale in a tenth of a second; black never is.
    assert!(told.iter().any(|(shot, w)| shot == "white" && matches!(w, Warning::Clipped { share, exposure_s } if *share > 0.1 && (*exposure_s - 0.1).abs() < 1e-9)), "{told:?}");
    assert!(told.iter().all(|(shot, _)| shot != "black"), "{told:?}");

    let told = capture(Wall { light: 0.01, ..GOOD }, false);
    let dim: Vec<&str> = told
        .iter()
        .filter(|(_, w)| matches!(w, Warning::Dim { share, .. } if *share < 0.02))
        .map(|(shot, _)| shot.as_str())
        .collect();
    assert_eq!(dim, ["white", "region-1", "region-2"], "{told:?}");
}

#[test]
fn a_rounded_exposure_is_told_beyond_a_hundredth() {
    // 0.1 s becomes 0.125 s; the others are multiples of it, or as good as.
    let told = capture(Wall { grain_s: 0.125, ..GOOD }, false);
    let at = |asked: f64| {
        told.iter()
            .filter(
                |(_, w)| matches!(w, Warning::Rounded { requested_s, .. } if *requested_s == asked),
            )
            .count()
    };
    assert_eq!((at(0.1), at(0.4), at(1.2)), (4, 4, 4), "{told:?}");
    let told = capture(Wall { grain_s: 0.001_01, ..GOOD }, false);
    assert_eq!(told, [], "0.99 % at most");
}

#[test]
fn a_lit_room_is_told() {
    let told = capture(Wall { ambient: 0.2, ..GOOD }, false);
    assert_eq!(told.len(), 3, "{told:?}");
    for (shot, warning) in told {
        let Warning::Ambient { share } = warning else { panic!("{shot}: {warning}") };
        // What leaks through black counts as well: 0.204 of 1.204.
        assert!((share - 0.204 / 1.204).abs() < 0.02, "{shot}: {share}");
    }
}

#[test]
fn a_drifting_lamp_shows_in_the_reference_patch() {
    // A change too small to spoil a picture, and one that does.
    assert_eq!(capture(Wall { lamp_step: 0.998, ..GOOD }, true), []);
    let told = capture(Wall { lamp_step: 0.98, ..GOOD }, true);
    let last = told.iter().rev().find_map(|(shot, warning)| match warning {
        Warning::LampDrift { change } => Some((shot.as_str(), *change)),
        _ => None,
    });
    let (shot, change) = last.unwrap();
    // Three steps after the first shot; the noise of 192 values is far below.
    assert!(shot == "region-2" && (change - (0.98_f64.powi(3) - 1.0)).abs() < 2e-3, "{told:?}");
    assert_eq!(capture(Wall { lamp_step: 0.98, ..GOOD }, false), [], "without a patch");
}

/// The place where the patch will be seen is white before a chart and black in its black frame, and
/// the projector's own grey steps are as they are meant to be.
#[test]
fn what_is_not_the_block_says_nothing_of_lamp_lens_and_brightness() {
    let shot = |name: &str, purpose, target, pattern| Shot {
        name: name.into(),
        purpose,
        exposures_s: vec![0.1, 0.4, 1.2],
        repeats: 1,
        target,
        pattern,
    };
    let first = [
        shot("chart", Purpose::Response, Target::Chart, Pattern::White),
        shot("chart-black", Purpose::Reference, Target::Chart, Pattern::Black),
        shot("grey-000", Purpose::Light, Target::Chart, Pattern::Grey { level: 0.0 }),
        shot("grey-010", Purpose::Light, Target::Chart, Pattern::Grey { level: 0.04 }),
    ];
    assert_eq!(capture_after(&first, GOOD, true), []);
}

#[test]
fn a_touched_lens_shows_in_the_reference_patch() {
    let told = capture(Wall { blur: 2, ..GOOD }, true);
    let focus =
        |(_, w): &&(String, Warning)| matches!(w, Warning::FocusDrift { change } if *change < -0.2);
    assert!(told.iter().filter(focus).count() >= 3, "{told:?}");
}

#[test]
fn a_split_frame_is_told_with_its_rows() {
    let told = capture(Wall { split: Some(70), ..GOOD }, false);
    let split: Vec<_> = told
        .iter()
        .filter_map(|(shot, w)| match w {
            Warning::OutOfSync { row, change } => Some((shot.as_str(), *row, *change)),
            _ => None,
        })
        .collect();
    assert!(split.iter().any(|(shot, ..)| *shot == "white"), "{told:?}");
    for (_, row, change) in split {
        assert!(row < HEIGHT && change.abs() > 0.03);
    }
}
