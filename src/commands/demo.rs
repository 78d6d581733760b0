//! `diaphane demo`: a material from nothing, on the simulated rig.

use crate::Failure;
use crate::commands::init::{SimulatedArgs, simulated_config};
use crate::commands::{calibrate, capture, export, merge, report, solve, verify};
use crate::output::Done;
use crate::session::Session;
use crate::steps::steps;
use material::{Conversion, Impossible, Overwrite, SceneUnit};
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// The figures of a demo, in its session.
pub(crate) const SUMMARY: &str = "summary.json";

/// Acquire a material on the simulated rig, from nothing to a report
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane demo --out demo --sample marble --seed 3")]
pub(crate) struct Args {
    /// Folder to work in; a demo that was interrupted goes on where it was
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    rig: SimulatedArgs,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let started = Instant::now();
    let config = simulated_config(&args.rig)?;
    let session = if args.out.join("session.toml").exists() {
        let session = Session::open(&args.out)?;
        if session.config != config {
            let error = format!("{}: holds another session", args.out.display());
            return Err(Failure::input(error).hint("give another folder with --out"));
        }
        session
    } else {
        Session::create(&args.out, config, Overwrite::Refuse)?
    };
    let Some(simulated) = session.simulated()? else {
        return Err(Failure::other("the demo needs the simulated rig"));
    };
    let mut rig = simulated.rig();
    capture::calibration_pictures(&session, &mut rig)?;
    // A demo is taken up again where it was; what others have replaced since is made anew.
    let wanted = |result: &str| -> Result<bool, Failure> {
        Ok(steps(&session)?.iter().any(|step| step.result == Some(result) && !step.done))
    };
    if wanted(calibrate::RESULT)? {
        calibrate::solve(&session, Overwrite::Replace)?;
    }
    capture::sample_pictures(&session, &mut rig)?;
    drop((rig, simulated));
    if wanted(crate::measurement::ARRAYS)? {
        merge::measure(&session, Overwrite::Replace)?;
    }
    if wanted(solve::MATERIAL)? {
        solve::solve(&session, &solve::Options::preset(), Overwrite::Replace)?;
    }
    let checked = if wanted(verify::RESULT)? {
        verify::verify(&session, Overwrite::Replace)?
    } else {
        session.read_json(verify::RESULT, "diaphane verify SESSION")?
    };
    let conversion = Conversion { unit: SceneUnit::Millimetre, impossible: Impossible::Clamp };
    export::export(&session, conversion, Overwrite::Replace)?;
    let reported = report::report(&session, None, Overwrite::Replace)?;
    let (page, verdict) = (reported.path, reported.verdict);
    let seconds = started.elapsed().as_secs_f64();
    let summary = json!({
        "fit": checked.fit,
        "bssrdf_error": checked.bssrdf_error,
        "heldout_rel_rms": checked.heldout_rel_rms,
        "seconds_total": seconds,
        "report": page,
        "material": session.path(solve::MATERIAL),
        "images": session.path("measurement/hdr"),
        "verdict": verdict,
    });
    session.write_json(SUMMARY, &summary, Overwrite::Replace)?;
    let mut text = match &verdict {
        Some(v) => format!("{}: {}, {}\n", session.config.sample.name, v.grade.word(), v.reason()),
        None => format!("{}\n", session.config.sample.name),
    };
    text += &format!(
        "  report    {}\n  images    {} (one EXR a pattern)\n  material  {}\n            {} (NumPy and Mitsuba 3)\n",
        page.display(),
        session.path("measurement/hdr").display(),
        session.path(solve::MATERIAL).display(),
        session.path("material/export").display(),
    );
    for figure in verdict.iter().flat_map(|v| &v.figures) {
        text += &format!(
            "  {:18} {:>8}  {} (good up to {}): {}\n",
            figure.name,
            figure.show(figure.value),
            figure.grade.word(),
            figure.show(figure.good),
            figure.meaning
        );
    }
    text += &format!("  {seconds:.0} s in all");
    Ok(Done::new(summary, text))
}
