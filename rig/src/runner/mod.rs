//! Carries a plan out so that it can stop at any moment and go on later.

mod carry;
mod error;
mod inventory;
mod kept;
mod options;
mod progress;
mod watch;
mod writer;

use std::collections::{HashMap, VecDeque};
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use kept::{frames_by_file, remove_unfinished, settings};
use writer::{Taken, ToDisk, with_writer};

pub use carry::carry_over;
pub use error::RunError;
pub use inventory::Inventory;
pub use kept::{frame_path, set_aside};
pub use options::{ReferencePatch, RunOptions, free_bytes};
pub use progress::{Outcome, Progress, Step};
pub use watch::Warning;

use crate::timing::Seen;
use crate::{
    CameraInfo, DeviceError, Event, Frame, FrameMetadata, Journal, JournalError, Plan,
    ProjectorImage, Readback, Rig, Shot, StopStatus, Target,
};

/// Attempts at one request before a transient failure counts as a lasting one.
const ATTEMPTS: u32 = 4;
/// Attempts where a device is gone: half a minute, with the usual wait, to push a plug back in.
const RECONNECTIONS: u32 = 8;
/// Between two looks at whether a wait is still wanted.
const BLINK: Duration = Duration::from_millis(50);
/// Space that is left free, bytes: for the journal, and for the file system's own needs.
const RESERVE: u64 = 64 << 20;

/// Frames between camera and journal: one in the hands of each thread, one waiting for each.
const MOST_ON_THE_WAY: usize = 4;

/// Takes every frame of `plan` that `session` does not hold yet.
///
/// Frames go to `session/frames`, and `session/journal.jsonl` says what happened. A frame
/// counts as there when its file still hashes to what the journal says, or when the journal does
/// not know it and it says of itself that it is what the plan asks for: a run was killed between
/// the two. Any other is moved aside (`….png.set-aside-1`) and taken again. So a run that was
/// stopped, or whose machine lost power, is simply repeated.
///
/// While a frame is written the next ones are taken; all of them are on disk, or the run has
/// failed, when this returns.
///
/// # Errors
/// See [`RunError`]; the journal's last line then says `failed` and why.
pub fn run(
    plan: &Plan,
    rig: &mut Rig,
    session: &Path,
    options: RunOptions<'_>,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Outcome, RunError> {
    plan.check()?;
    if options.face_map.is_none() {
        let on_face = |shot: &&Shot| matches!(shot.pattern, crate::Pattern::Face { .. });
        if let Some(shot) = plan.shots.iter().find(on_face) {
            return Err(RunError::NoFaceMap(shot.name.clone()));
        }
    }
    let (mut journal, recorded) = Journal::open(&session.join("journal.jsonl"))?;
    let mut seen = Seen::default();
    seen.add(&recorded);
    let known = frames_by_file(recorded);
    let total = plan.shots.iter().map(Shot::frames).sum();
    journal.append(Event::Started {
        version: env!("CARGO_PKG_VERSION").into(),
        frames: total,
        plan: plan.blake3(),
        camera: rig.camera.info().name,
        projector: rig.projector.info().name,
    })?;

    // What a run that was killed had in its hands. The journal is locked: nobody else is writing.
    for shot in &plan.shots {
        remove_unfinished(&session.join("frames").join(&shot.name))?;
    }

    let journal = Mutex::new(journal);
    let result = with_writer(session, &journal, options.patch, |to_disk| {
        let journal = &journal;
        let on_the_way = VecDeque::new();
        let known = &known;
        let image = None;
        Run {
            rig,
            session,
            options,
            journal,
            to_disk,
            on_the_way,
            progress,
            total,
            known,
            image,
            seen,
        }
        .all(plan)
    });
    let (status, reason) = match &result {
        Ok(outcome) if outcome.missing == 0 => (StopStatus::Done, "every frame is there".into()),
        Ok(outcome) => {
            (StopStatus::Stopped, format!("asked to stop, {} frames missing", outcome.missing))
        }
        Err(error) => (StopStatus::Failed, error.to_string()),
    };
    let noted = append(&journal, Event::Stopped { status, reason });
    // The first error is the one that matters.
    let outcome = result?;
    noted?;
    Ok(outcome)
}

struct Run<'a, 'p> {
    rig: &'a mut Rig,
    session: &'a Path,
    options: RunOptions<'a>,
    journal: &'a Mutex<Journal>,
    to_disk: ToDisk,
    /// Frames that are on their way to the disk: their shots, their exposures, and the time that is
    /// left after each.
    on_the_way: VecDeque<(String, f64, f64)>,
    progress: &'a mut (dyn FnMut(Progress<'_>) + 'p),
    total: usize,
    known: &'a HashMap<String, Event>,
    /// What the projector shows.
    image: Option<ProjectorImage>,
    /// How long frames and placements have taken, in this run and those before.
    seen: Seen,
}

impl Run<'_, '_> {
    fn all(&mut self, plan: &Plan) -> Result<Outcome, RunError> {
        let mut last_frame = Instant::now();
        let mut frames_left = self.total;
        let mut to_expose_s: f64 = plan
            .shots
            .iter()
            .map(|s| s.exposures_s.iter().sum::<f64>() * f64::from(s.repeats))
            .sum();
        let mut outcome = Outcome { taken: 0, kept: 0, missing: 0 };
        let mut placed: Option<Target> = None;
        let mut number = 0;
        for (index, shot) in plan.shots.iter().enumerate() {
            let rest = plan.shots[index..].windows(2);
            let placements_left = rest.filter(|pair| pair[0].target != pair[1].target).count();
            let mut shown = false;
            for (exposure_index, &requested_s) in shot.exposures_s.iter().enumerate() {
                for repeat in 0..shot.repeats {
                    to_expose_s = (to_expose_s - requested_s).max(0.0);
                    frames_left -= 1;
                    self.rig.camera.announce(number, repeat);
                    number += 1;
                    let kept = self.is_there(shot, exposure_index, repeat)?;
                    if !kept {
                        if self.options.stopped() {
                            outcome.missing += 1;
                            continue;
                        }
                        if placed != Some(shot.target) {
                            // Whoever looks at the pictures may want the bench as it is.
                            if !self.settle(&mut outcome, 0) {
                                return Ok(outcome);
                            }
                            if self.options.stopped() {
                                outcome.missing += 1;
                                continue;
                            }
                            self.tell(&outcome, &shot.name, Step::Placing(shot.target));
                            let place = |rig: &mut Rig, _| rig.bench.place(&shot.target);
                            let placing = Instant::now();
                            match self.persist(shot, &outcome, place) {
                                // Who is asked to stop while something is placed does not place
                                // it: a person says so, a program may be ended by it.
                                Err(RunError::Device { source, .. }) if self.options.stopped() => {
                                    let text = format!("shot {:?}: {source}", shot.name);
                                    append(self.journal, Event::Note { text })?;
                                    outcome.missing += 1;
                                    continue;
                                }
                                asked => asked?,
                            }
                            let took_s = placing.elapsed().as_secs_f64();
                            self.seen.placements.push(took_s);
                            last_frame = Instant::now();
                            append(self.journal, Event::Placed { target: shot.target, took_s })?;
                            placed = Some(shot.target);
                        }
                        if !shown {
                            self.show(shot, &outcome)?;
                            shown = true;
                        }
                        if !self.has_space(shot, &outcome)? {
                            outcome.missing += 1;
                            continue;
                        }
                        if !self.take(shot, exposure_index, repeat, &outcome)? {
                            return Ok(outcome);
                        }
                        self.seen.frame(requested_s, last_frame.elapsed().as_secs_f64());
                        last_frame = Instant::now();
                    }
                    let timing = self.seen.timing();
                    let [left_s, _] = timing.estimate(frames_left, to_expose_s, placements_left);
                    if kept {
                        self.settle(&mut outcome, 0);
                        outcome.kept += 1;
                        self.tell_frame(&outcome, &shot.name, requested_s, Step::Kept, left_s);
                    } else {
                        self.on_the_way.push_back((shot.name.clone(), requested_s, left_s));
                        self.settle(&mut outcome, MOST_ON_THE_WAY);
                    }
                }
            }
        }
        self.settle(&mut outcome, 0);
        Ok(outcome)
    }

    /// Tells of the frames that have reached the disk, and waits until at most `most` have not;
    /// false if frames are no longer written, which has an error of its own.
    fn settle(&mut self, outcome: &mut Outcome, most: usize) -> bool {
        while !self.on_the_way.is_empty() {
            let written = &self.to_disk.written;
            let warnings = if self.on_the_way.len() > most {
                let Ok(warnings) = written.recv() else { return false };
                warnings
            } else {
                let Ok(warnings) = written.try_recv() else { return true };
                warnings
            };
            if let Some((shot, requested_s, left_s)) = self.on_the_way.pop_front() {
                outcome.taken += 1;
                self.tell_frame(outcome, &shot, requested_s, Step::Taken, left_s);
                for warning in warnings {
                    self.tell_frame(outcome, &shot, requested_s, Step::Warned(warning), left_s);
                }
            }
        }
        true
    }

    fn tell(&mut self, outcome: &Outcome, shot: &str, step: Step) {
        let (done, total) = (outcome.kept + outcome.taken, self.total);
        (self.progress)(Progress { done, total, shot, requested_s: None, step, left_s: None });
    }

    /// Tells of a frame, and how long the rest should take once it is there.
    fn tell_frame(
        &mut self,
        outcome: &Outcome,
        shot: &str,
        requested_s: f64,
        step: Step,
        left_s: f64,
    ) {
        let (done, total) = (outcome.kept + outcome.taken, self.total);
        let (requested_s, left_s) = (Some(requested_s), Some(left_s));
        (self.progress)(Progress { done, total, shot, requested_s, step, left_s });
    }

    /// All that is known of a frame before it is taken.
    fn metadata(&self, shot: &Shot, exposure_index: usize, repeat: u32) -> FrameMetadata {
        let camera = self.rig.camera.info();
        let requested_s = shot.exposures_s[exposure_index];
        FrameMetadata {
            shot: shot.name.clone(),
            purpose: shot.purpose,
            target: shot.target,
            pattern: shot.pattern.clone(),
            exposure_index,
            repeat,
            requested_s,
            exposure_s: requested_s,
            bit_depth: camera.bit_depth,
            camera: camera.name,
            projector: self.rig.projector.info().name,
        }
    }

    fn show(&mut self, shot: &Shot, outcome: &Outcome) -> Result<(), RunError> {
        let info = self.rig.projector.info();
        let mut image: ProjectorImage = shot
            .pattern
            .render(info.width, info.height, self.options.face_map)
            .ok_or_else(|| RunError::NoFaceMap(shot.name.clone()))?;
        if shot.target == Target::Sample
            && let Some(patch) = self.options.patch
        {
            image.paint(patch.projector_px, u8::MAX);
        }
        self.persist(shot, outcome, |rig, _| rig.projector.show(&image))?;
        self.image = Some(image);
        Ok(())
    }

    /// Exposes a frame and hands it on; false if frames are no longer written, which has an error
    /// of its own.
    fn take(
        &mut self,
        shot: &Shot,
        exposure_index: usize,
        repeat: u32,
        outcome: &Outcome,
    ) -> Result<bool, RunError> {
        let requested_s = shot.exposures_s[exposure_index];
        let image = self.image.take();
        let taken = self.persist(shot, outcome, |rig, again| {
            // Whatever went wrong may have taken the picture off the wall.
            if let Some(image) = image.as_ref().filter(|_| again) {
                rig.projector.show(image)?;
            }
            let frame = rig.camera.expose(requested_s)?;
            check(&frame, &rig.camera.info())?;
            rig.projector.still_shows()?;
            Ok((frame, rig.camera.readback()?))
        });
        self.image = image;
        let (frame, device): (Frame, Readback) = taken?;
        let metadata = FrameMetadata {
            exposure_s: frame.exposure_s,
            ..self.metadata(shot, exposure_index, repeat)
        };
        let settings = settings(shot, exposure_index);
        let shortest = shot.exposures_s.iter().copied().fold(f64::INFINITY, f64::min);
        let longest = shot.exposures_s.iter().copied().fold(0.0, f64::max);
        let taken = Taken { frame, metadata, settings, bracket_s: [shortest, longest], device };
        Ok(self.to_disk.frames.send(taken).is_ok())
    }

    /// Waits until the disk takes another frame and all that are on their way; false if the run is
    /// asked to stop meanwhile.
    fn has_space(&mut self, shot: &Shot, outcome: &Outcome) -> Result<bool, RunError> {
        let info = self.rig.camera.info();
        let frame_bytes = u64::from(info.width) * u64::from(info.height) * 2;
        let frames = self.on_the_way.len() as u64 + 1;
        let needed = frame_bytes * u64::from(info.channels) * frames + RESERVE;
        let began = Instant::now();
        let mut told = None;
        loop {
            let free = (self.options.free_bytes)(self.session).unwrap_or(u64::MAX);
            if free >= needed {
                return Ok(true);
            }
            if told.is_none() {
                let text = format!("{free} bytes are free, {needed} are needed: waiting for space");
                append(self.journal, Event::Note { text })?;
            }
            // Now and then: the amount tells whoever makes room how far they are.
            if told != Some(free) {
                self.tell(outcome, &shot.name, Step::Waiting { free, needed });
                told = Some(free);
            }
            if self.options.stopped() {
                return Ok(false);
            }
            if began.elapsed() >= self.options.space_wait {
                return Err(RunError::NoSpace { shot: shot.name.clone(), free, needed });
            }
            std::thread::sleep(BLINK);
        }
    }

    /// Asks a device, and asks again where the failure may pass; the request is told whether it is
    /// a repetition.
    fn persist<T>(
        &mut self,
        shot: &Shot,
        outcome: &Outcome,
        mut request: impl FnMut(&mut Rig, bool) -> Result<T, DeviceError>,
    ) -> Result<T, RunError> {
        let mut wait = self.options.retry_wait;
        let mut attempt = 0;
        loop {
            attempt += 1;
            let source = match request(self.rig, attempt > 1) {
                Ok(value) => return Ok(value),
                Err(error) => error,
            };
            let attempts = match source.kind() {
                kind if kind.is_transient() => ATTEMPTS,
                kind if kind.is_gone() => RECONNECTIONS,
                _ => 1,
            };
            if attempt >= attempts || self.options.stopped() {
                return Err(RunError::Device { shot: shot.name.clone(), source });
            }
            let text = format!("shot {:?}, attempt {attempt}: {source}", shot.name);
            append(self.journal, Event::Note { text: text.clone() })?;
            self.tell(outcome, &shot.name, Step::Retried(text));
            let until = Instant::now() + wait;
            while Instant::now() < until && !self.options.stopped() {
                std::thread::sleep(BLINK.min(until.saturating_duration_since(Instant::now())));
            }
            wait *= 2;
        }
    }
}

/// Whether a frame can be one of that camera's.
fn check(frame: &Frame, camera: &CameraInfo) -> Result<(), DeviceError> {
    let &Frame { width, height, channels, bit_depth, exposure_s, .. } = frame;
    let right = (width, height, channels, bit_depth)
        == (camera.width, camera.height, camera.channels, camera.bit_depth)
        && frame.check_shape().is_ok()
        && exposure_s.is_finite()
        && exposure_s > 0.0;
    if right {
        return Ok(());
    }
    let about = |width, height, channels, bits| {
        format!("{width} × {height} pixels of {channels} × {bits} bits")
    };
    Err(DeviceError::BadFrame {
        device: camera.name.clone(),
        expected: about(camera.width, camera.height, camera.channels, camera.bit_depth),
        found: format!(
            "{}, {} values, exposed for {exposure_s} s",
            about(width, height, channels, bit_depth),
            frame.data.len()
        ),
    })
}

/// Appends to a journal that several threads write.
pub(crate) fn append(journal: &Mutex<Journal>, event: Event) -> Result<(), JournalError> {
    journal.lock().unwrap_or_else(PoisonError::into_inner).append(event)
}
