//! Frames that are there: where, whether they are what the plan asks for, and what becomes of those
//! that are not.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use material::{FileError, Unfinished, hash_file};

use super::{Run, RunError, append};
use crate::{Event, FrameMetadata, Readback, Recorded, Shot, read_frame};

/// Where a frame is kept, relative to the session: `frames/SHOT/SHOT-e0-r0.png`.
pub fn frame_path(shot: &str, exposure_index: usize, repeat: u32) -> String {
    format!("frames/{shot}/{shot}-e{exposure_index}-r{repeat}.png")
}

/// Makes the folder that a file is to lie in.
pub(super) fn make_folder_of(path: &Path) -> Result<(), FileError> {
    let Some(folder) = path.parent() else { return Ok(()) };
    let failed = |source| FileError::Io { path: folder.into(), action: "create", source };
    std::fs::create_dir_all(folder).map_err(failed)
}

/// Moves the frames of a shot aside (`….png.set-aside-1`), so that the next run takes them again.
///
/// # Errors
/// A file that cannot be moved.
pub fn set_aside(session: &Path, shot: &Shot) -> Result<(), FileError> {
    for exposure in 0..shot.exposures_s.len() {
        for repeat in 0..shot.repeats {
            move_aside(&session.join(frame_path(&shot.name, exposure, repeat)))?;
        }
    }
    Ok(())
}

/// Removes what [`material::Unfinished`] left in a folder when its program was killed.
pub(super) fn remove_unfinished(folder: &Path) -> Result<(), FileError> {
    let Ok(files) = std::fs::read_dir(folder) else { return Ok(()) };
    for path in files.filter_map(|file| Some(file.ok()?.path())) {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
        if name.is_some_and(|name| name.starts_with(Unfinished::PREFIX)) {
            let failed = |source| FileError::Io { path: path.clone(), action: "remove", source };
            std::fs::remove_file(&path).map_err(failed)?;
        }
    }
    Ok(())
}

/// Renames a file to the first free name beside it, which is returned; None if it is not there.
fn move_aside(path: &Path) -> Result<Option<String>, FileError> {
    let places = (1..).map(|n| PathBuf::from(format!("{}.set-aside-{n}", path.display())));
    let aside = places.into_iter().find(|aside| !aside.exists()).filter(|_| path.exists());
    let Some(aside) = aside else { return Ok(None) };
    let failed = |source| FileError::Io { path: path.into(), action: "move aside", source };
    std::fs::rename(path, &aside).map_err(failed)?;
    Ok(aside.file_name().map(|name| name.to_string_lossy().into_owned()))
}

/// What a journal says of each frame's file. Later lines replace earlier ones: a frame that was
/// taken again.
pub(super) fn frames_by_file(recorded: Recorded) -> HashMap<String, Event> {
    let events = recorded.entries.into_iter().map(|entry| entry.event);
    let frames = events.filter_map(|event| match &event {
        Event::FrameWritten { file, .. } => Some((file.clone(), event)),
        _ => None,
    });
    frames.collect()
}

/// Tells frames apart that were taken under different settings.
pub(super) fn settings(shot: &Shot, exposure_index: usize) -> String {
    let exposure = shot.exposures_s.get(exposure_index);
    let text = serde_json::to_string(&(&shot.target, &shot.pattern, exposure)).unwrap_or_default();
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

impl Run<'_, '_> {
    /// Whether the frame is on disk as the journal says. One that is not is moved aside.
    pub(super) fn is_there(
        &mut self,
        shot: &Shot,
        exposure_index: usize,
        repeat: u32,
    ) -> Result<bool, RunError> {
        let file = frame_path(&shot.name, exposure_index, repeat);
        let path = self.session.join(&file);
        let known = match self.known.get(&file) {
            Some(Event::FrameWritten { blake3, settings, .. }) => Some((blake3, settings)),
            _ => None,
        };
        if known.is_some_and(|(_, taken)| *taken != settings(shot, exposure_index)) {
            return Err(RunError::OtherSettings { shot: shot.name.clone(), file });
        }
        if !path.exists() {
            return Ok(false);
        }
        let found = hash_file(&path)?;
        let why = match known {
            Some((hash, _)) if *hash == found => return Ok(true),
            Some(_) => "has changed since it was taken",
            None if self.adopt(shot, exposure_index, repeat, &path, found)? => return Ok(true),
            None => "is not in the journal, and not what the plan asks for",
        };
        if let Some(name) = move_aside(&path)? {
            let text = format!("{file} {why}: moved to {name} and taken again");
            append(self.journal, Event::Note { text })?;
        }
        Ok(false)
    }

    /// Takes a frame that the journal does not know for what it says it is, if that is what the plan
    /// asks for: a run that was killed may have named its file and not come to write the line. A
    /// file gets its name when it is whole on the disk, and checksums cover all of it.
    fn adopt(
        &mut self,
        shot: &Shot,
        exposure_index: usize,
        repeat: u32,
        path: &Path,
        blake3: String,
    ) -> Result<bool, RunError> {
        let Ok((frame, about)) = read_frame(path) else { return Ok(false) };
        let expected = FrameMetadata {
            exposure_s: about.exposure_s,
            bit_depth: about.bit_depth,
            ..self.metadata(shot, exposure_index, repeat)
        };
        if about != expected {
            return Ok(false);
        }
        let file = frame_path(&shot.name, exposure_index, repeat);
        let text = format!("{file} was whole on the disk, though no line said so");
        append(self.journal, Event::Note { text })?;
        let event = Event::FrameWritten {
            shot: shot.name.clone(),
            exposure_index,
            repeat,
            file,
            blake3,
            settings: settings(shot, exposure_index),
            requested_s: Some(about.requested_s),
            exposure_s: about.exposure_s,
            device: Readback::default(),
            stats: frame.stats(),
        };
        append(self.journal, event)?;
        Ok(true)
    }
}
