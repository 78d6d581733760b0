//! Writes frames while the next ones are taken.
//!
//! Encoding takes a processor and syncing takes the disk, so each has its own thread: a run lasts
//! as long as the slowest of camera, processor and disk, instead of all three. A frame counts as
//! there only once its line is in the journal, so whatever is on its way when the power fails is
//! simply taken again.

use std::path::Path;
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};

use material::{Overwrite, Unfinished};

use super::kept::make_folder_of;
use super::watch::{Warning, Watch};
use super::{Outcome, ReferencePatch, RunError, append, frame_path};
use crate::encode::{Encoded, encode_frame, named};
use crate::{Event, Frame, FrameMetadata, Journal, Readback};

/// Frames that wait before each thread: one, so that neither idles while the other is done.
const WAITING: usize = 1;

/// A frame that is not on disk yet.
pub(crate) struct Taken {
    pub frame: Frame,
    pub metadata: FrameMetadata,
    /// Tells it from frames taken under other settings.
    pub settings: String,
    /// Shortest and longest exposure of its shot, seconds.
    pub bracket_s: [f64; 2],
    /// What the camera said of itself.
    pub device: Readback,
}

/// A file that has not reached the disk yet, and its line in the journal.
struct Written {
    file: Unfinished,
    event: Event,
    warnings: Vec<Warning>,
}

/// The other end of a [`with_writer`]: takes frames, and tells of each when it is on disk, in the
/// order in which they were sent, and what is doubtful about it. Either end is closed once writing
/// has failed.
pub(crate) struct ToDisk {
    pub frames: SyncSender<Taken>,
    pub written: Receiver<Vec<Warning>>,
}

/// Runs `take`, and writes what it sends; returns when all of it is on disk.
///
/// # Errors
/// What ended the writing, else the error of `take`.
pub(crate) fn with_writer(
    session: &Path,
    journal: &Mutex<Journal>,
    patch: Option<ReferencePatch>,
    take: impl FnOnce(ToDisk) -> Result<Outcome, RunError>,
) -> Result<Outcome, RunError> {
    std::thread::scope(|scope| {
        let (frames, taken) = sync_channel(WAITING);
        let (to_disk, unsynced) = sync_channel(WAITING);
        let (done, written) = channel();
        let encoder = scope.spawn(move || encode_all(session, patch, &taken, &to_disk));
        let syncer = scope.spawn(move || sync_all(journal, &unsynced, &done));
        let outcome = take(ToDisk { frames, written });
        let ended = |thread: std::thread::ScopedJoinHandle<'_, Result<(), RunError>>| {
            thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        let (encoded, synced) = (ended(encoder), ended(syncer));
        synced.and(encoded).and(outcome)
    })
}

fn encode_all(
    session: &Path,
    patch: Option<ReferencePatch>,
    taken: &Receiver<Taken>,
    to_sync: &SyncSender<Written>,
) -> Result<(), RunError> {
    let patch = patch.map(|patch| patch.camera_px);
    let mut watch = Watch::default();
    for Taken { frame, metadata, settings, bracket_s, device } in taken {
        let shot = metadata.shot.clone();
        let name = frame_path(&shot, metadata.exposure_index, metadata.repeat);
        let path = session.join(&name);
        make_folder_of(&path)?;
        let mut file = Unfinished::begin(&path, Overwrite::Refuse)?;
        let Encoded { blake3, survey } = encode_frame(&frame, &metadata, patch, file.file())
            .map_err(|e| RunError::Frame { shot: shot.clone(), source: named(e, &path) })?;
        let warnings = watch.see(&metadata, &survey, bracket_s);
        let event = Event::FrameWritten {
            shot,
            exposure_index: metadata.exposure_index,
            repeat: metadata.repeat,
            file: name,
            blake3,
            settings,
            requested_s: Some(metadata.requested_s),
            exposure_s: frame.exposure_s,
            device,
            stats: survey.stats(),
        };
        if to_sync.send(Written { file, event, warnings }).is_err() {
            // The other thread has failed, and says why.
            break;
        }
    }
    Ok(())
}

fn sync_all(
    journal: &Mutex<Journal>,
    written: &Receiver<Written>,
    done: &Sender<Vec<Warning>>,
) -> Result<(), RunError> {
    for Written { file, event, warnings } in written {
        let shot = match &event {
            Event::FrameWritten { shot, .. } => shot.clone(),
            _ => String::new(),
        };
        file.finish()?;
        append(journal, event)?;
        for warning in &warnings {
            append(journal, Event::Warned { shot: shot.clone(), warning: warning.clone() })?;
        }
        // Nobody listens any more where the run itself has failed; the frame is there all the same.
        let _ = done.send(warnings);
    }
    Ok(())
}
