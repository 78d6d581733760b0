//! `diaphane plan`: what a capture takes.

use crate::Failure;
use crate::adaptive;
use crate::output::Done;
use crate::session::{RigConfig, Session};
use rig::{CameraInfo, Plan};
use serde_json::json;
use std::path::PathBuf;

/// Show what a capture takes, without touching hardware
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane plan my-wax")]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
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
    let turn_s = session.wheel.as_ref().map(|known| known.wheel.turn_s);
    let mut text = String::new();
    let mut parts = Vec::new();
    for (name, plan) in [
        ("calibration", acquisition.calibration_plan()),
        ("sample", adaptive::sample_plan(&session)?),
    ] {
        plan.check()?;
        text += &describe(name, &plan, &camera, turn_s);
        let summary = plan.summary(&camera);
        let warnings: Vec<String> = plan.warnings(turn_s).iter().map(ToString::to_string).collect();
        parts.push(json!({
            "part": name,
            "shots": summary.shots,
            "frames": summary.frames,
            "placements": summary.placements,
            "estimated_s": summary.estimated_s,
            "bytes": summary.bytes,
            "exposures_s": plan.shots.iter().map(|s| &s.exposures_s).collect::<Vec<_>>(),
            "warnings": warnings,
        }));
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
    Ok(Done::new(json!({ "parts": parts, "wheel_turn_s": turn_s }), text.trim_end()))
}

fn describe(name: &str, plan: &Plan, camera: &CameraInfo, turn_s: Option<f64>) -> String {
    let s = plan.summary(camera);
    let mut out = format!(
        "{name}: {} frames of {} shots, {} placements, about {:.0} min and {:.1} GB on {}\n",
        s.frames,
        s.shots,
        s.placements,
        (s.estimated_s / 60.0).ceil(),
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
