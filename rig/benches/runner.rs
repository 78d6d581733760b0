//! What the runner adds to writing the frames: a capture of 24-Mpx frames by a camera that needs no
//! time at all, beside plain synced writes of the very same files, in turns.
//!
//! `cargo bench -p diaphane-rig` writes 16 frames (0.8 GB) four times either way;
//! `FRAMES=144` a whole capture's.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use rig::{
    Bench, Camera, CameraInfo, DeviceError, Frame, Pattern, Plan, Projector, ProjectorImage,
    ProjectorInfo, Purpose, Rig, RunOptions, Shot, Target, run,
};

const WIDTH: u32 = 6000;
const HEIGHT: u32 = 4000;

/// A 12-bit grey picture with noise: what the encoder makes of a flat one says nothing.
struct Ready(Vec<u16>);
struct Nothing;

impl Camera for Ready {
    fn info(&self) -> CameraInfo {
        let name = "ready".into();
        CameraInfo { name, width: WIDTH, height: HEIGHT, channels: 1, bit_depth: 12 }
    }

    fn expose(&mut self, exposure_s: f64) -> Result<Frame, DeviceError> {
        let (width, height) = (WIDTH, HEIGHT);
        Ok(Frame { width, height, channels: 1, bit_depth: 12, data: self.0.clone(), exposure_s })
    }
}

impl Projector for Nothing {
    fn info(&self) -> ProjectorInfo {
        ProjectorInfo { name: "none".into(), width: 16, height: 8 }
    }

    fn show(&mut self, _: &ProjectorImage) -> Result<(), DeviceError> {
        Ok(())
    }
}

impl Bench for Nothing {
    fn place(&mut self, _: &Target) -> Result<(), DeviceError> {
        Ok(())
    }
}

fn picture() -> Vec<u16> {
    // Four numbers of a linear congruence (Knuth's MMIX) added up are near enough to normal.
    let mut state = 1_u64;
    let mut noise = || {
        let mut sum = 0;
        for _ in 0..4 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            sum += (state >> 58) as i32 - 32;
        }
        sum / 4
    };
    let pixels = 0..WIDTH * HEIGHT;
    pixels
        .map(|p| (1000 + p % WIDTH / 4 + p / WIDTH / 4) as i32 + noise())
        .map(|v| v as u16)
        .collect()
}

fn capture(rig: &mut Rig, plan: &Plan, session: &Path) -> Duration {
    let began = Instant::now();
    let stop = AtomicBool::new(false);
    run(plan, rig, session, RunOptions::new(&stop), &mut |_| ()).expect("a capture");
    began.elapsed()
}

fn files(session: &Path) -> Vec<PathBuf> {
    let folder = session.join("frames/white");
    let files = std::fs::read_dir(folder).expect("frames").map(|f| f.expect("a frame").path());
    files.collect()
}

/// One file's bytes do for all: the frames differ by a number in their text alone, and a copy for
/// each would have the machine short of memory, which slows the writing down.
fn plain(bytes: &[u8], frames: u32, folder: &Path) -> Duration {
    let began = Instant::now();
    for k in 0..frames {
        let mut file = std::fs::File::create(folder.join(k.to_string())).expect("a file");
        file.write_all(bytes).expect("a write");
        file.sync_all().expect("a sync");
    }
    began.elapsed()
}

fn main() {
    let frames: u32 = std::env::var("FRAMES").ok().and_then(|n| n.parse().ok()).unwrap_or(16);
    let shot = Shot {
        name: "white".into(),
        purpose: Purpose::Fit,
        exposures_s: vec![1.0],
        repeats: frames,
        target: Target::Sample,
        pattern: Pattern::White,
    };
    let plan = Plan { shots: vec![shot.clone()] };
    let mut rig = Rig {
        camera: Box::new(Ready(picture())),
        projector: Box::new(Nothing),
        bench: Box::new(Nothing),
    };
    let folder = || tempfile::tempdir_in(".").expect("a folder");
    let session = folder();
    capture(&mut rig, &Plan { shots: vec![Shot { repeats: 1, ..shot }] }, session.path());
    let bytes = std::fs::read(&files(session.path())[0]).expect("a frame");
    let size = bytes.len() as f64 * f64::from(frames) / 1e6;
    for round in 1..=4 {
        // In turns: a disk takes the first gigabytes faster than the next.
        let (taken, written) = if round % 2 == 1 {
            let taken = capture(&mut rig, &plan, folder().path());
            (taken, plain(&bytes, frames, folder().path()))
        } else {
            let written = plain(&bytes, frames, folder().path());
            (capture(&mut rig, &plan, folder().path()), written)
        };
        println!(
            "{round}: {frames} frames, {size:.0} MB: capture {:.2} s, plain synced writes {:.2} s, ratio {:.3}",
            taken.as_secs_f64(),
            written.as_secs_f64(),
            taken.as_secs_f64() / written.as_secs_f64()
        );
    }
}
