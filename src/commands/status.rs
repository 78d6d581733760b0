//! `diaphane status`: how far a session is.

use crate::Failure;
use crate::output::Done;
use crate::session::Session;
use crate::steps::steps;
use rig::{Event, StopStatus, read_journal};
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
    let next = steps.iter().find(|s| !s.done);
    let journal = read_journal(&session.path("journal.jsonl"))?;
    let stopped = journal.entries.iter().rev().find_map(|entry| match &entry.event {
        Event::Stopped { status, reason } => Some((*status, reason.clone(), entry.unix_s)),
        _ => None,
    });
    // A run that died says nothing: its start, or a picture, is then the last line.
    let cut_off = journal.entries.last().is_some_and(|e| !matches!(e.event, Event::Stopped { .. }));

    let mut text = format!("{}: {}\n", session.folder().display(), session.config.sample.name);
    for step in &steps {
        let mark = if step.done { "done" } else { "-" };
        text += &format!("  {:22} {mark}", step.name);
        if let Some(f) = &step.frames {
            text += &format!(
                "{}{} of {} pictures",
                if step.done { ", " } else { " " },
                f.taken,
                f.wanted
            );
            if let Some(shot) = f.incomplete_shots.first().filter(|_| f.taken > 0) {
                text += &format!(", missing from {shot:?} on");
            }
        }
        text += "\n";
    }
    if let Some((status, reason, _)) = &stopped {
        let how = match status {
            StopStatus::Done => "finished",
            StopStatus::Stopped => "was stopped",
            StopStatus::Failed => "failed",
        };
        text += &format!("last capture {how}: {reason}\n");
    }
    if cut_off {
        text += "the last capture is still running, or was cut off\n";
    }
    text += &match next {
        Some(step) => format!("next: {}", step.command),
        None => "all steps are done".to_owned(),
    };
    let json = json!({
        "session": session.folder(),
        "sample": session.config.sample.name,
        "steps": steps,
        "next": next.map(|s| json!({ "step": s.name, "command": s.command })),
        "last_stop": stopped.map(|(status, reason, unix_s)| {
            json!({ "status": status, "reason": reason, "unix_s": unix_s })
        }),
        "capture_cut_off": cut_off,
        "torn_bytes": journal.torn_bytes,
    });
    Ok(Done::new(json, text))
}
