//! The steps of a session: which are done and what makes the next one.

use crate::Failure;
use crate::adaptive;
use crate::commands::{calibrate, export, report, solve, verify};
use crate::measurement::ARRAYS;
use crate::session::{RigConfig, Session};
use rig::{Plan, frame_path};
use serde::Serialize;

/// One step.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Step {
    pub name: &'static str,
    pub done: bool,
    /// The command that does it.
    pub command: String,
    /// Pictures on disk and pictures wanted, for a step that takes pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<Frames>,
}

/// Pictures of one plan.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Frames {
    pub taken: usize,
    pub wanted: usize,
    /// Shots that lack at least one picture.
    pub incomplete_shots: Vec<String>,
}

impl Frames {
    fn count(session: &Session, plan: &Plan) -> Self {
        let mut out = Self { taken: 0, wanted: 0, incomplete_shots: Vec::new() };
        for shot in &plan.shots {
            let places = (0..shot.exposures_s.len())
                .flat_map(|e| (0..shot.repeats).map(move |r| frame_path(&shot.name, e, r)));
            let (mut taken, mut wanted) = (0, 0);
            for place in places {
                wanted += 1;
                taken += usize::from(session.path(&place).is_file());
            }
            if taken < wanted {
                out.incomplete_shots.push(shot.name.clone());
            }
            out.taken += taken;
            out.wanted += wanted;
        }
        out
    }
}

/// All steps in their order; the first that is not done is the next one.
pub(crate) fn steps(session: &Session) -> Result<Vec<Step>, Failure> {
    let folder = session.folder().display().to_string();
    let folder =
        if folder.contains(char::is_whitespace) { format!("\"{folder}\"") } else { folder };
    let command = |words: &str| format!("diaphane {}", words.replace("SESSION", &folder));
    let file = |name, path: &str, words: &str| Step {
        name,
        done: session.path(path).is_file(),
        command: command(words),
        frames: None,
    };
    let mut out = Vec::new();
    match session.config.rig {
        RigConfig::Imported => {
            out.push(file("measurement", ARRAYS, "import SESSION --images DIR --manifest m.toml"));
        }
        RigConfig::Simulated { .. } | RigConfig::Devices { .. } => {
            let acquisition = session.acquisition();
            let pictures = |name, plan: &Plan, settled, words: &str| -> Result<Step, Failure> {
                plan.check()?;
                let frames = Frames::count(session, plan);
                let done = settled && frames.taken == frames.wanted;
                Ok(Step { name, done, command: command(words), frames: Some(frames) })
            };
            let calibration = acquisition.calibration_plan();
            let words = "calibrate all SESSION";
            out.push(pictures("calibration pictures", &calibration, true, words)?);
            out.push(file("calibration", calibrate::RESULT, "calibrate all SESSION"));
            let (plan, settled) = (adaptive::sample_plan(session)?, adaptive::is_settled(session)?);
            out.push(pictures("sample pictures", &plan, settled, "capture SESSION")?);
            out.push(file("measurement", ARRAYS, "merge SESSION"));
        }
    }
    out.push(file("material", solve::MATERIAL, "solve SESSION"));
    out.push(file("verification", verify::RESULT, "verify SESSION"));
    out.push(file("export", export::NPZ, "export SESSION"));
    out.push(file("report", report::RESULT, "report SESSION"));
    Ok(out)
}
