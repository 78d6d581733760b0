//! The journal: what happened, one line each, safe on disk before the next thing happens.
//!
//! `journal.jsonl` is only ever appended to. Every line is a JSON object
//! `{"check": "…", "entry": {"seq": …, "unix_s": …, "event": {…}}}`; `check` is the first 16
//! hexadecimal digits of the BLAKE3 of the entry's text, byte for byte. When the power fails
//! while a line is being written, that line is torn: it is reported, cut off by the next run,
//! and nothing before it is lost.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use serde_json::value::RawValue;

use crate::{FrameStats, Readback, Target, Warning};

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Event {
    /// A run began.
    Started {
        /// Version of this software.
        version: String,
        /// Frames that the plan asks for.
        frames: usize,
        /// BLAKE3 of the plan as JSON; empty in journals from before it was noted.
        #[serde(default)]
        plan: String,
        /// The camera.
        #[serde(default)]
        camera: String,
        /// The projector.
        #[serde(default)]
        projector: String,
    },
    /// Something was put on the bench.
    Placed {
        /// What.
        target: Target,
        /// How long that took, seconds.
        took_s: f64,
    },
    /// A frame is on disk.
    FrameWritten {
        /// Name of the shot.
        shot: String,
        /// Which exposure, from 0.
        exposure_index: usize,
        /// Which repeat, from 0.
        repeat: u32,
        /// The file, relative to the session.
        file: String,
        /// BLAKE3 of the file.
        blake3: String,
        /// BLAKE3 over target, pattern and exposure asked for: tells a frame that was taken
        /// under other settings.
        settings: String,
        /// Exposure time that was asked for, seconds.
        #[serde(default)]
        requested_s: Option<f64>,
        /// Exposure time that the camera says it used, seconds.
        exposure_s: f64,
        /// What the camera said of itself then.
        #[serde(default)]
        device: Readback,
        /// The frame in a few numbers.
        stats: FrameStats,
    },
    /// A frame that was kept is doubtful.
    Warned {
        /// Name of the shot.
        shot: String,
        /// What about it.
        warning: Warning,
    },
    /// Anything worth telling: a retry, a damaged frame, a torn line.
    Note {
        /// In words.
        text: String,
    },
    /// A run ended.
    Stopped {
        /// How.
        status: StopStatus,
        /// Why.
        reason: String,
    },
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopStatus {
    /// Every frame is there.
    Done,
    /// Somebody asked it to stop.
    Stopped,
    /// Something went wrong.
    Failed,
}

/// One line of the journal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Entry {
    /// Counts from 0.
    pub seq: u64,
    /// When, seconds since 1970-01-01 UTC.
    pub unix_s: f64,
    /// What.
    pub event: Event,
}

/// What a journal holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recorded {
    /// The entries, oldest first.
    pub entries: Vec<Entry>,
    /// Bytes of a last line that was never finished.
    pub torn_bytes: u64,
}

/// A journal that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The journal.
        path: PathBuf,
        /// What was being done.
        action: &'static str,
        /// The system's own words.
        source: io::Error,
    },
    /// A line that is not as it was written, with good lines after it.
    #[error("{}, line {line}: damaged: {reason}", path.display())]
    Damaged {
        /// The journal.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What was expected and what was found.
        reason: String,
    },
    /// Another run is writing to it.
    #[error("{}: another run is using this session", path.display())]
    InUse {
        /// The journal.
        path: PathBuf,
    },
}

/// A journal open for appending; no other run can open it meanwhile.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    /// Length of all whole lines, bytes.
    length: u64,
    /// Number of the next entry.
    next: u64,
}

#[derive(Deserialize)]
struct Line<'a> {
    check: &'a str,
    #[serde(borrow)]
    entry: &'a RawValue,
}

/// Reads a journal without touching it. One that is not there is empty.
///
/// # Errors
/// It cannot be read, or a line other than the last is damaged.
pub fn read_journal(path: &Path) -> Result<Recorded, JournalError> {
    match std::fs::read(path) {
        Ok(bytes) => parse(&bytes, path),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(Recorded::default()),
        Err(source) => Err(JournalError::Io { path: path.into(), action: "read", source }),
    }
}

/// Whether a run has the journal open now; false also where the system does not tell.
pub fn journal_in_use(path: &Path) -> bool {
    let Ok(file) = File::open(path) else { return false };
    matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock))
}

fn parse(bytes: &[u8], path: &Path) -> Result<Recorded, JournalError> {
    let mut recorded = Recorded::default();
    let mut rest = bytes;
    while !rest.is_empty() {
        let (line, after) = match rest.iter().position(|&b| b == b'\n') {
            Some(end) => (Ok(&rest[..end]), &rest[end + 1..]),
            None => (Err("the line has no end".to_owned()), &[][..]),
        };
        let seq = recorded.entries.len() as u64;
        match line.and_then(|line| entry(line, seq)) {
            Ok(entry) => recorded.entries.push(entry),
            // Only the last line can have been cut off while it was written.
            Err(_) if after.is_empty() => recorded.torn_bytes = rest.len() as u64,
            Err(reason) => {
                let line = recorded.entries.len() + 1;
                return Err(JournalError::Damaged { path: path.into(), line, reason });
            }
        }
        rest = after;
    }
    Ok(recorded)
}

fn entry(line: &[u8], seq: u64) -> Result<Entry, String> {
    let line: Line<'_> =
        serde_json::from_slice(line).map_err(|e| format!("expected a journal line: {e}"))?;
    let found = checksum(line.entry.get());
    if found != line.check {
        return Err(format!("its checksum is {found}, expected {}", line.check));
    }
    let entry: Entry = serde_json::from_str(line.entry.get())
        .map_err(|e| format!("expected an entry of this version: {e}"))?;
    if entry.seq != seq {
        return Err(format!("expected entry {seq}, found {}", entry.seq));
    }
    Ok(entry)
}

fn checksum(text: &str) -> String {
    let mut hex = blake3::hash(text.as_bytes()).to_hex().to_string();
    hex.truncate(16);
    hex
}

impl Journal {
    /// Opens a journal to go on with it, or begins one, and returns what it holds so far.
    /// A torn last line is cut off and noted.
    ///
    /// # Errors
    /// Another run has it open, a line other than the last is damaged, or the system refuses.
    pub fn open(path: &Path) -> Result<(Self, Recorded), JournalError> {
        let failed = |action| move |source| JournalError::Io { path: path.into(), action, source };
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(path).map_err(failed("open"))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(JournalError::InUse { path: path.into() });
            }
            Err(TryLockError::Error(source)) => return Err(failed("lock")(source)),
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(failed("read"))?;
        let recorded = parse(&bytes, path)?;
        // The name of a new journal has to reach the disk like its lines. Folders cannot be
        // opened on Windows.
        #[cfg(unix)]
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            File::open(folder).and_then(|folder| folder.sync_all()).map_err(failed("create"))?;
        }
        let length = bytes.len() as u64 - recorded.torn_bytes;
        let next = recorded.entries.len() as u64;
        let mut journal = Self { path: path.into(), file, length, next };
        if recorded.torn_bytes > 0 {
            let text = format!(
                "the last line was cut off while it was written; its {} bytes were removed",
                recorded.torn_bytes
            );
            journal.append(Event::Note { text })?;
        }
        Ok((journal, recorded))
    }

    /// Appends an event and returns once it is on disk.
    ///
    /// # Errors
    /// The system refuses; what was written of the line is removed by the next one.
    pub fn append(&mut self, event: Event) -> Result<(), JournalError> {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let entry = Entry { seq: self.next, unix_s: since_epoch.as_secs_f64(), event };
        let written = serde_json::to_string(&entry).map_err(io::Error::from).and_then(|text| {
            let line = format!("{{\"check\":\"{}\",\"entry\":{text}}}\n", checksum(&text));
            // Half a line may be there, from a power failure or from a full disk.
            self.file.set_len(self.length)?;
            self.file.seek(SeekFrom::Start(self.length))?;
            self.file.write_all(line.as_bytes())?;
            self.file.sync_data()?;
            self.length += line.len() as u64;
            self.next += 1;
            Ok(())
        });
        written.map_err(|source| JournalError::Io {
            path: self.path.clone(),
            action: "append",
            source,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn note(text: &str) -> Event {
        Event::Note { text: text.into() }
    }

    fn written(lines: usize) -> (tempfile::TempDir, PathBuf, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.jsonl");
        let (mut journal, _) = Journal::open(&path).unwrap();
        (0..lines).for_each(|i| journal.append(note(&format!("line {i}"))).unwrap());
        let bytes = std::fs::read(&path).unwrap();
        (folder, path, bytes)
    }

    #[test]
    fn a_journal_cut_anywhere_keeps_its_whole_lines() {
        let (_folder, path, bytes) = written(3);
        for cut in 0..=bytes.len() {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            let whole = bytes[..cut].iter().filter(|&&b| b == b'\n').count();
            let recorded = read_journal(&path).unwrap();
            assert_eq!(recorded.entries.len(), whole, "cut at {cut}");

            let (mut journal, recorded) = Journal::open(&path).unwrap();
            journal.append(note("after")).unwrap();
            let repaired = read_journal(&path).unwrap();
            assert_eq!(repaired.torn_bytes, 0);
            let noted = usize::from(recorded.torn_bytes > 0);
            assert_eq!(repaired.entries.len(), whole + noted + 1);
            assert_eq!(repaired.entries.last().unwrap().event, note("after"));
        }
    }

    #[test]
    fn damage_before_the_last_line_is_found_and_named() {
        let (_folder, path, bytes) = written(3);
        let end_of =
            |n: usize| bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').nth(n).unwrap().0;
        let (first, second) = (end_of(0), end_of(1));
        for at in first + 1..second {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1;
            std::fs::write(&path, &damaged).unwrap();
            let error = read_journal(&path).unwrap_err();
            assert!(matches!(error, JournalError::Damaged { line: 2, .. }), "{at}: {error}");
        }
        // A line that was taken out leaves whole lines, but their numbers tell.
        std::fs::write(&path, [&bytes[..=first], &bytes[second + 1..]].concat()).unwrap();
        assert_eq!(read_journal(&path).unwrap().entries.len(), 1);
        std::fs::write(&path, &bytes[first + 1..]).unwrap();
        assert!(matches!(read_journal(&path), Err(JournalError::Damaged { line: 1, .. })));
    }

    /// A full disk takes half a line; the next line must not be joined to it.
    #[test]
    fn half_a_line_left_by_a_failed_append_is_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.jsonl");
        let (mut journal, _) = Journal::open(&path).unwrap();
        journal.append(note("before")).unwrap();
        let mut other = OpenOptions::new().append(true).open(&path).unwrap();
        other.write_all(&[b'x'; 1000]).unwrap();
        journal.append(note("one")).unwrap();
        journal.append(note("two")).unwrap();
        let recorded = read_journal(&path).unwrap();
        assert_eq!((recorded.entries.len(), recorded.torn_bytes), (3, 0));
    }

    #[test]
    fn one_run_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.jsonl");
        let first = Journal::open(&path).unwrap();
        assert!(matches!(Journal::open(&path), Err(JournalError::InUse { .. })));
        assert!(journal_in_use(&path));
        drop(first);
        assert!(!journal_in_use(&path));
        assert!(!journal_in_use(&path.with_file_name("none")));
        Journal::open(&path).unwrap();
    }
}
