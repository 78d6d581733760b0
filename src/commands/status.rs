//! `diaphane status`: how far a session is.

use crate::Failure;
use crate::adaptive;
use crate::output::{Done, counted};
use crate::session::{RigConfig, Session};
use crate::steps::{next, steps, told_next};
use rig::{Entry, Event, StopStatus, journal_in_use, read_journal};
use serde_json::json;
use std::path::PathBuf;

/// Show which steps of a session are done and what comes next
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane status my-wax")]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let steps = steps(&session)?;
    let next = next(&steps);
    let path = session.path("journal.jsonl");
    let journal = read_journal(&path)?;
    let capture = Capture::last(&session, &journal.entries, journal_in_use(&path))?;

    let mut text = format!("{}: {}\n", session.folder().display(), session.config.sample.name);
    for step in &steps {
        text += &format!("  {:22} {}", step.name, step.told());
        if let Some(f) = &step.frames {
            let wanted = counted(f.wanted, "picture");
            text += &format!("{}{} of {wanted}", if step.done { ", " } else { " " }, f.taken);
            if let Some(shot) = f.incomplete_shots.first().filter(|_| f.taken > 0) {
                text += &format!(", missing from {shot:?} on");
            }
        }
        text += "\n";
    }
    if let Some(told) = capture.told() {
        text += &format!("{told}\n");
    }
    text += &told_next(next);
    let json = json!({
        "session": session.folder(),
        "sample": session.config.sample.name,
        "steps": steps,
        "next": next.map(|s| json!({ "step": s.name, "command": s.command })),
        "last_stop": capture.stop.as_ref().map(|(status, reason, unix_s)| {
            json!({ "status": status, "reason": reason, "unix_s": unix_s })
        }),
        "capture_running": capture.running,
        "capture_cut_off": capture.cut_off,
        "torn_bytes": journal.torn_bytes,
    });
    Ok(Done::new(json, text))
}

/// The last run that took pictures.
struct Capture {
    /// Of which pictures, where that is known.
    pictures: Option<&'static str>,
    running: bool,
    /// It began, and nothing says that it ended.
    cut_off: bool,
    /// How, why and when it ended.
    stop: Option<(StopStatus, String, f64)>,
}

impl Capture {
    fn last(session: &Session, entries: &[Entry], running: bool) -> Result<Self, Failure> {
        let mut out = Self { pictures: None, running, cut_off: false, stop: None };
        for entry in entries.iter().rev() {
            match &entry.event {
                Event::Stopped { status, reason } if out.stop.is_none() => {
                    out.stop = Some((*status, reason.clone(), entry.unix_s));
                }
                Event::Started { plan, .. } => {
                    out.pictures = pictures(session, plan)?;
                    // A run that died says nothing: its start, or a picture, is then the last line.
                    out.cut_off = out.stop.is_none() && !running;
                    break;
                }
                _ => {}
            }
        }
        Ok(out)
    }

    fn told(&self) -> Option<String> {
        let of = self.pictures.map_or(String::new(), |name| format!(" of {name} pictures"));
        if self.running {
            return Some(format!("a capture{of} is running"));
        }
        if self.cut_off {
            return Some(format!(
                "the last capture{of} was cut off: the same command goes on where it was"
            ));
        }
        let (status, reason, _) = self.stop.as_ref()?;
        let how = match status {
            // Of which pictures nobody knows, the steps tell more.
            StopStatus::Done => {
                return self.pictures.map(|_| format!("last capture{of}: {reason}"));
            }
            StopStatus::Stopped => "was stopped",
            StopStatus::Failed => "failed",
        };
        Some(format!("last capture{of} {how}: {reason}"))
    }
}

/// What the pictures of a plan are called, if it is one of the session's.
fn pictures(session: &Session, hash: &str) -> Result<Option<&'static str>, Failure> {
    // Imported pictures were not captured.
    if matches!(session.config.rig, RigConfig::Imported) {
        return Ok(None);
    }
    let acquisition = session.acquisition();
    let plans = [
        ("calibration", acquisition.calibration_plan()),
        ("sample", adaptive::sample_plan(session)?),
        ("light", acquisition.light_plan()),
        ("noise", acquisition.noise_plan()),
    ];
    Ok(plans.into_iter().find(|(_, plan)| plan.blake3() == hash).map(|(name, _)| name))
}
