//! Frames of one session that serve another as well.

use std::path::Path;

use material::{Overwrite, atomic_copy, hash_file};

use super::RunError;
use super::kept::{frames_by_file, make_folder_of, settings};
use crate::{Event, Journal, Plan, frame_path, read_journal};

/// Copies the frames of the session `from` that `plan` asks for, unchanged and taken under the very
/// settings that it has, to the session `to`, and says so in its journal. Returns how many.
///
/// For a plan that was changed in the middle: the new session goes on with what still fits, the
/// old one stays as it was.
///
/// # Errors
/// A journal that cannot be used, a file that cannot be read or written, or one that is there
/// already.
pub fn carry_over(plan: &Plan, from: &Path, to: &Path) -> Result<usize, RunError> {
    let known = frames_by_file(read_journal(&from.join("journal.jsonl"))?);
    let (mut journal, there) = Journal::open(&to.join("journal.jsonl"))?;
    let there = frames_by_file(there);
    let mut carried = 0;
    for shot in &plan.shots {
        for exposure_index in 0..shot.exposures_s.len() {
            for repeat in 0..shot.repeats {
                let name = frame_path(&shot.name, exposure_index, repeat);
                let Some(event @ Event::FrameWritten { blake3, settings: taken, .. }) =
                    known.get(&name)
                else {
                    continue;
                };
                let source = from.join(&name);
                let fits = *taken == settings(shot, exposure_index)
                    && !there.contains_key(&name)
                    && source.exists()
                    && hash_file(&source)? == *blake3;
                if fits {
                    let copy = to.join(&name);
                    make_folder_of(&copy)?;
                    atomic_copy(&source, &copy, Overwrite::Refuse)?;
                    journal.append(event.clone())?;
                    carried += 1;
                }
            }
        }
    }
    Ok(carried)
}
