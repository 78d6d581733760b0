//! How far a solve has come, on disk: one file a channel, from which it goes on after an interruption.
//!
//! A file is the magic, the BLAKE3 of the problem that it belongs to, the checkpoint (postcard), and
//! the BLAKE3 of all that.

use crate::Failure;
use crate::session::Session;
use diffusion::{Inverse, Iterate};
use material::{Overwrite, atomic_write};
use serde::{Deserialize, Serialize};
use std::io::{ErrorKind, Write as _};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// In the session's folder.
const FOLDER: &str = "material/checkpoints";
const MAGIC: &[u8; 8] = b"DIAPHCP1";
const HASH: usize = 32;
/// Steps between two checkpoints.
const STEPS: usize = 5;
/// Writing takes no larger share of the time than this.
const SHARE: f64 = 0.02;

/// How far a channel is.
#[derive(Serialize, Deserialize)]
pub(crate) enum Checkpoint {
    /// On the way.
    Going(Iterate),
    /// Done.
    Found(Inverse),
}

/// The checkpoints of one solve.
pub(crate) struct Checkpoints<'s> {
    session: &'s Session,
    problem: [u8; HASH],
    steps: usize,
    last: Instant,
    took: Duration,
}

impl<'s> Checkpoints<'s> {
    /// Those of the problem that `problem` describes in full, whatever it is solved on.
    pub fn new(session: &'s Session, problem: &impl Serialize) -> Result<Self, Failure> {
        let text = serde_json::to_vec(problem).map_err(Failure::other)?;
        let problem = *blake3::hash(&text).as_bytes();
        let took = Duration::ZERO;
        Ok(Self { session, problem, steps: 0, last: Instant::now(), took })
    }

    fn path(channel: &str) -> String {
        format!("{FOLDER}/{channel}.checkpoint")
    }

    /// How far a channel is, if it was begun.
    ///
    /// # Errors
    /// It belongs to another problem, or is damaged.
    pub fn load(&self, channel: &str) -> Result<Option<Checkpoint>, Failure> {
        let path = self.session.path(&Self::path(channel));
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(Failure::input(format!("{}: {e}", path.display()))),
        };
        let anew = |error: String| {
            let folder = self.session.path(FOLDER);
            Failure::input(format!("{}: {error}", path.display()))
                .hint(format!("--restart removes {} and begins anew", folder.display()))
        };
        let damaged = || anew("damaged, or of another version".into());
        let (content, hash) = bytes.split_last_chunk::<HASH>().ok_or_else(damaged)?;
        let content = content.strip_prefix(MAGIC).ok_or_else(damaged)?;
        let (problem, checkpoint) = content.split_first_chunk::<HASH>().ok_or_else(damaged)?;
        if blake3::hash(&bytes[..bytes.len() - HASH]).as_bytes() != hash {
            return Err(damaged());
        }
        if *problem != self.problem {
            let of = |hash: &[u8; HASH]| blake3::Hash::from(*hash).to_hex()[..12].to_owned();
            return Err(anew(format!(
                "a checkpoint of another problem ({}, this one is {}): measurement, block or options were others",
                of(problem),
                of(&self.problem)
            )));
        }
        postcard::from_bytes(checkpoint).map(Some).map_err(|_| damaged())
    }

    /// Whether a channel on its way should be saved after this step.
    pub fn due(&mut self) -> bool {
        self.steps += 1;
        self.steps >= STEPS && self.last.elapsed().mul_f64(SHARE) >= self.took
    }

    /// Replaces what was known of a channel.
    pub fn save(&mut self, channel: &str, checkpoint: &Checkpoint) -> Result<(), Failure> {
        let began = Instant::now();
        let mut bytes = MAGIC.to_vec();
        bytes.extend(self.problem);
        let mut bytes = postcard::to_extend(checkpoint, bytes).map_err(Failure::other)?;
        bytes.extend(blake3::hash(&bytes).as_bytes());
        let path: PathBuf = self.session.result(&Self::path(channel))?;
        atomic_write(&path, Overwrite::Replace, |file| file.write_all(&bytes))?;
        (self.steps, self.last, self.took) = (0, Instant::now(), began.elapsed());
        Ok(())
    }
}

/// Removes all checkpoints of a session: its solve is done, or begins anew.
pub(crate) fn clear(session: &Session) -> Result<(), Failure> {
    let folder = session.path(FOLDER);
    match std::fs::remove_dir_all(&folder) {
        Err(e) if e.kind() != ErrorKind::NotFound => {
            Err(Failure::other(format!("{}: cannot be removed: {e}", folder.display())))
        }
        _ => Ok(()),
    }
}
