//! What a session has of a plan, told by its journal and by which files are there; no frame is read.

use std::collections::BTreeMap;
use std::path::Path;

use super::kept::{frame_path, settings};
use crate::{Event, Plan, Recorded};

/// Frames of one plan in one session.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Inventory {
    /// Frames that the plan asks for.
    pub wanted: usize,
    /// Those of them that are on the disk.
    pub taken: usize,
    /// Shots that lack at least one frame, in the plan's order.
    pub incomplete_shots: Vec<String>,
    /// Frames of the plan's names, relative to the session, that were taken with another target,
    /// pattern or exposure time: those that [`crate::run`] refuses with
    /// [`crate::RunError::OtherSettings`].
    pub otherwise: Vec<String>,
}

impl Inventory {
    /// Looks at the files of `session`, whose journal holds `recorded`.
    pub fn of(plan: &Plan, session: &Path, recorded: &Recorded) -> Self {
        let mut known = BTreeMap::new();
        for entry in &recorded.entries {
            if let Event::FrameWritten { file, settings, .. } = &entry.event {
                known.insert(file.as_str(), settings.as_str());
            }
        }
        let mut out = Self::default();
        for shot in &plan.shots {
            let mut whole = true;
            for exposure in 0..shot.exposures_s.len() {
                let expected = settings(shot, exposure);
                for repeat in 0..shot.repeats {
                    let file = frame_path(&shot.name, exposure, repeat);
                    let there = session.join(&file).is_file();
                    out.wanted += 1;
                    out.taken += usize::from(there);
                    whole &= there;
                    if known.get(file.as_str()).is_some_and(|taken| *taken != expected) {
                        out.otherwise.push(file);
                    }
                }
            }
            if !whole {
                out.incomplete_shots.push(shot.name.clone());
            }
        }
        out
    }
}

impl Recorded {
    /// BLAKE3 of each frame by its file, relative to the session; of one that was taken again the
    /// last.
    pub fn frame_hashes(&self) -> BTreeMap<&str, &str> {
        let events = self.entries.iter().map(|entry| &entry.event);
        let frames = events.filter_map(|event| match event {
            Event::FrameWritten { file, blake3, .. } => Some((file.as_str(), blake3.as_str())),
            _ => None,
        });
        frames.collect()
    }
}
