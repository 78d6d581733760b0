//! `diaphane capture`: takes the pictures that are missing.

use crate::Failure;
use crate::adaptive;
use crate::cli::STOP;
use crate::commands::calibrate;
use crate::devices;
use crate::output::{Done, Progress, counted};
use crate::session::Session;
use crate::steps::next_line;
use rig::{Outcome, Plan, Rig, RunOptions, Step, Target};
use serde_json::json;
use std::path::PathBuf;

/// Take the pictures that are missing: first those for the calibration, then, once that is
/// solved, those of the sample
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  diaphane calibrate all my-wax && diaphane capture my-wax\n\nWith --json:\n  taken  pictures that were taken now\n  kept   pictures of the same plans that were there already, from runs before\n  next   the step that follows"
)]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    /// Take only the pictures for `diaphane calibrate light`
    #[arg(long, conflicts_with = "noise")]
    light: bool,
    /// Take only pairs of dark and of evenly lit frames, to measure the camera's noise from
    #[arg(long)]
    noise: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let mut rig = devices::open(&session)?;
    if args.light || args.noise {
        return extra(&session, &mut rig, args.light);
    }
    let calibration = calibration_pictures(&session, &mut rig)?;
    if !calibrate::is_done(&session) {
        let text = format!(
            "calibration pictures: {}\nnext: {}, then capture again",
            told(&calibration),
            session.command("calibrate all SESSION")
        );
        return Ok(Done::new(as_json(&[calibration], "calibrate"), text));
    }
    let sample = sample_pictures(&session, &mut rig)?;
    let text = format!("sample pictures: {}\n{}", told(&sample), next_line(&session)?);
    Ok(Done::new(as_json(&[calibration, sample], "merge"), text))
}

fn told(outcome: &Outcome) -> String {
    let were = if outcome.kept == 1 { "was" } else { "were" };
    format!("{} taken, {} {were} there already", outcome.taken, outcome.kept)
}

fn as_json(outcomes: &[Outcome], next: &str) -> serde_json::Value {
    let sum = |pick: fn(&Outcome) -> usize| outcomes.iter().map(pick).sum::<usize>();
    json!({ "taken": sum(|o| o.taken), "kept": sum(|o| o.kept), "next": next })
}

/// Pictures of the projector's light, or of the camera's noise.
fn extra(session: &Session, rig: &mut Rig, light: bool) -> Result<Done, Failure> {
    let acquisition = session.acquisition();
    let (label, plan) = if light {
        ("light", acquisition.light_plan())
    } else {
        ("noise", acquisition.noise_plan())
    };
    let outcome = shoot(session, rig, label, &plan, false)?;
    let next = format!("calibrate {label}");
    let command = session.command(&format!("{next} SESSION"));
    let text = format!("{label} pictures: {}\nnext: {command}", told(&outcome));
    Ok(Done::new(as_json(&[outcome], &next), text))
}

/// Boards, chart and white sheet.
pub(crate) fn calibration_pictures(session: &Session, rig: &mut Rig) -> Result<Outcome, Failure> {
    shoot(session, rig, "calibration", &session.acquisition().calibration_plan(), false)
}

/// The sample under every pattern.
pub(crate) fn sample_pictures(session: &Session, rig: &mut Rig) -> Result<Outcome, Failure> {
    adaptive::take(session, |plan| shoot(session, rig, "capture", plan, true))
}

fn shoot(
    session: &Session,
    rig: &mut Rig,
    label: &str,
    plan: &Plan,
    on_face: bool,
) -> Result<Outcome, Failure> {
    let lit = if on_face { Some(calibrate::lit_plane(session)?) } else { None };
    let [width, height, _] = session.config.sample.grid.size_mm();
    let to_face = |pixel: [f64; 2]| {
        let [x, y] = lit.as_ref()?.pixel_to_face(pixel)?;
        Some([x / width, y / height])
    };
    let options = RunOptions {
        face_map: on_face.then_some(&to_face as _),
        patch: session.config.plan.reference_patch,
        ..RunOptions::new(&STOP)
    };
    let frames = plan.shots.iter().map(rig::Shot::frames).sum();
    let mut progress = Progress::new(label, frames);
    let mut asked = None;
    let outcome = rig::run(plan, rig, session.folder(), options, &mut |p| {
        asked = asked_for(asked, &p.step);
        tell(&mut progress, &p);
    })
    .map_err(|e| session.run_failure(e))?;
    if outcome.missing > 0 {
        let words = match label {
            "light" | "noise" => format!("capture SESSION --{label}"),
            _ => "capture SESSION".to_owned(),
        };
        return Err(interrupted(asked, &outcome, &session.command(&words)));
    }
    progress.finish(&told(&outcome));
    Ok(outcome)
}

/// What is waited for to be put on the rig, after one more step of a run.
pub(crate) fn asked_for(before: Option<Target>, step: &Step) -> Option<Target> {
    match step {
        Step::Placing(target) => Some(*target),
        Step::Taken => None,
        _ => before,
    }
}

/// A run that was stopped: what it waited for, what there is, and the command that goes on.
pub(crate) fn interrupted(asked: Option<Target>, outcome: &Outcome, command: &str) -> Failure {
    let asked = asked.map_or(String::new(), |target| format!(" while waiting for {target}"));
    let kept = outcome.kept + outcome.taken;
    let are = if outcome.missing == 1 { "is" } else { "are" };
    let error = format!(
        "interrupted{asked}; {} kept, {} {are} missing",
        counted(kept, "frame"),
        outcome.missing
    );
    Failure::other(error).hint(format!("go on with: {command}"))
}

/// What happened, to whoever watches.
fn tell(progress: &mut Progress, p: &rig::Progress<'_>) {
    if let Some(remark) = remark(p) {
        progress.say(&remark);
    }
    match (p.requested_s, p.left_s) {
        (Some(exposure_s), left_s) => {
            progress.set_left(p.done, &format!("{}, {exposure_s:.3} s", p.shot), left_s);
        }
        _ => progress.set_left(p.done, p.shot, None),
    }
}

/// A line on what is out of the ordinary.
pub(crate) fn remark(p: &rig::Progress<'_>) -> Option<String> {
    match &p.step {
        Step::Retried(why) => Some(format!("{}: {why}; trying again", p.shot)),
        Step::Warned(warning) => Some(format!("WARNING: {}: {warning}", p.shot)),
        Step::Waiting { free, needed } => Some(format!(
            "waiting for space on the disk: {:.0} MB are free, {:.0} MB are needed; make room, or end with Ctrl-C",
            *free as f64 / 1e6,
            *needed as f64 / 1e6
        )),
        Step::Placing(_) | Step::Kept | Step::Taken => None,
    }
}
