//! `diaphane plan`: what a capture takes.

use crate::Failure;
use crate::adaptive;
use crate::devices::RIG_FILE;
use crate::output::{Done, counted};
use crate::session::{RigConfig, Session};
use rig::{CameraInfo, Plan, RigFile, Timing, free_bytes, read_journal};
use serde_json::json;
use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

/// A lamp that has been off for so long has to settle again, seconds.
const COLD_S: f64 = 1200.0;

/// Show what a capture takes, without touching hardware
///
/// Minutes and their spread are learned from what the session, and those named with --past, took
/// on this rig so far.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  diaphane plan my-wax\n  diaphane plan next-wax --past my-wax")]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    /// Earlier sessions on the same rig
    #[arg(long, value_name = "SESSION")]
    past: Vec<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let acquisition = session.acquisition();
    let camera = match &session.config.rig {
        RigConfig::Simulated { .. } => match session.simulated()? {
            Some(simulated) => simulated.rig().camera.info(),
            None => return Err(session.nothing_to_capture()),
        },
        RigConfig::Devices { camera, .. } => camera.clone(),
        RigConfig::Imported => return Err(session.nothing_to_capture()),
    };
    for past in &args.past {
        Session::refuse_none(past).map_err(|e| {
            let error = format!("--past: {}", e.error);
            Failure { error, ..e }.hint("name sessions that were captured on the same rig")
        })?;
    }
    let timing = learned(&session, &args.past)?;
    let turn_s = session.wheel.as_ref().map(|known| known.wheel.turn_s);
    let mut text = String::new();
    let mut parts = Vec::new();
    for (name, plan) in [
        ("calibration", acquisition.calibration_plan()),
        ("sample", adaptive::sample_plan(&session)?),
    ] {
        plan.check()?;
        text += &describe(name, &plan, &camera, &timing, turn_s);
        let summary = plan.summary(&camera, &timing);
        let warnings: Vec<String> = plan.warnings(turn_s).iter().map(ToString::to_string).collect();
        parts.push(json!({
            "part": name,
            "shots": summary.shots,
            "frames": summary.frames,
            "placements": summary.placements,
            "estimated_s": summary.estimated_s,
            "spread_s": summary.spread_s,
            "bytes": summary.bytes,
            "exposures_s": plan.shots.iter().map(|s| &s.exposures_s).collect::<Vec<_>>(),
            "warnings": warnings,
        }));
    }
    let bytes = parts.iter().filter_map(|part| part["bytes"].as_u64()).sum();
    let limits = limits(&session, bytes)?;
    for warning in &limits {
        text += &format!("warning: {warning}\n");
    }
    if let Some(turn_s) = turn_s {
        text += &format!(
            "the sample is exposed for whole turns of the colour wheel, {:.3} ms each\n",
            1e3 * turn_s
        );
    }
    if !adaptive::is_settled(&session)? {
        text += "this is the most that it can come to: the first pattern chooses the exposures\n";
    }
    Ok(Done::new(
        json!({ "parts": parts, "wheel_turn_s": turn_s, "timing": timing, "warnings": limits }),
        text.trim_end(),
    ))
}

/// How long this rig takes, by the journals of its sessions.
fn learned(session: &Session, past: &[PathBuf]) -> Result<Timing, Failure> {
    let folders = std::iter::once(session.folder()).chain(past.iter().map(PathBuf::as_path));
    let journals: Vec<_> = folders
        .map(|folder| read_journal(&folder.join("journal.jsonl")))
        .collect::<Result<_, _>>()?;
    Ok(Timing::learned(&journals))
}

/// What the whole session needs and may not have: space on its disk, and a lamp that is warm.
fn limits(session: &Session, bytes: u64) -> Result<Vec<String>, Failure> {
    let mut out = Vec::new();
    if let Some(free) = free_bytes(session.folder()).filter(|free| *free < bytes) {
        out.push(format!(
            "the frames need {:.1} GB, the disk has {:.1} GB left: the capture will stop and wait for space",
            bytes as f64 / 1e9,
            free as f64 / 1e9
        ));
    }
    if matches!(session.config.rig, RigConfig::Devices { .. }) {
        let file = RigFile::read(&session.path(RIG_FILE))?;
        let journal = read_journal(&session.path("journal.jsonl"))?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64();
        let idle_s = journal.entries.last().map(|entry| now - entry.unix_s);
        if file.projector.control.is_some() && idle_s.is_none_or(|idle| idle > COLD_S) {
            let since = idle_s.map_or("no capture so far".to_owned(), |idle| {
                format!("the last capture ended {:.0} min ago", idle / 60.0)
            });
            out.push(format!(
                "the lamp may be cold ({since}): lamps drift by percents in their first {:.0} minutes; switch it on with diaphane rig test {} --power, and wait",
                COLD_S / 60.0,
                session.path(RIG_FILE).display()
            ));
        }
    }
    Ok(out)
}

fn describe(
    name: &str,
    plan: &Plan,
    camera: &CameraInfo,
    timing: &Timing,
    turn_s: Option<f64>,
) -> String {
    let s = plan.summary(camera, timing);
    let mut out = format!(
        "{name}: {} of {}, {}, {:.0} ± {:.0} min ({}) and {:.1} GB on {}\n",
        counted(s.frames, "frame"),
        counted(s.shots, "shot"),
        counted(s.placements, "placement"),
        (s.estimated_s / 60.0).ceil(),
        (s.spread_s / 60.0).ceil(),
        match timing.frames {
            0 => "a guess".to_owned(),
            n => format!("learned from {}", counted(n, "frame")),
        },
        s.bytes as f64 / 1e9,
        camera.name
    );
    for shot in &plan.shots {
        let exposures: Vec<String> = shot.exposures_s.iter().map(|t| format!("{t:.3}")).collect();
        out += &format!("  {:16} {} s, {}\n", shot.name, exposures.join(" "), shot.target);
    }
    for warning in plan.warnings(turn_s) {
        out += &format!("  warning: {warning}\n");
    }
    out
}
