//! What a run is told.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::{FaceMap, PixelRect};

/// What a run needs beside the plan and the rig.
#[derive(Clone, Copy)]
pub struct RunOptions<'a> {
    /// Set by somebody else, to end the run after the frame it is taking.
    pub stop: &'a AtomicBool,
    /// Another that does the same: a caller that ends a run from within has its own beside the
    /// one that Ctrl-C sets.
    pub other_stop: Option<&'a AtomicBool>,
    /// Where projector pixels fall on the lit face; needed for patterns on the face.
    pub face_map: Option<FaceMap<'a>>,
    /// What tells of a drifting lamp or lens, if the rig has it.
    pub patch: Option<ReferencePatch>,
    /// Wait before a request is repeated; doubled each time.
    pub retry_wait: Duration,
    /// The longest that a run waits for space on the disk.
    pub space_wait: Duration,
    /// Bytes that the session's disk takes, where that is known: [`free_bytes`].
    pub free_bytes: &'a dyn Fn(&Path) -> Option<u64>,
}

impl<'a> RunOptions<'a> {
    /// What a person at a rig expects; patterns on the face are not possible yet.
    pub fn new(stop: &'a AtomicBool) -> Self {
        Self {
            stop,
            other_stop: None,
            face_map: None,
            patch: None,
            retry_wait: Duration::from_millis(200),
            space_wait: Duration::from_secs(600),
            free_bytes: &free_bytes,
        }
    }

    /// Whether somebody wants the run to end.
    pub(super) fn stopped(&self) -> bool {
        let set = |flag: &AtomicBool| flag.load(Ordering::Relaxed);
        set(self.stop) || self.other_stop.is_some_and(set)
    }
}

/// Bytes that the disk of a folder takes, or `None` where the system does not tell.
pub fn free_bytes(folder: &Path) -> Option<u64> {
    fs4::available_space(folder).ok()
}

/// A white patch beside the sample, that the projector lights in every picture of the sample and
/// the camera sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferencePatch {
    /// What the projector lights.
    pub projector_px: PixelRect,
    /// Where the camera sees it, and nothing else.
    pub camera_px: PixelRect,
}
