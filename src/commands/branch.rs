//! `diaphane branch`: a changed plan goes on in a session of its own.

use crate::Failure;
use crate::adaptive;
use crate::devices::RIG_FILE;
use crate::output::{Done, counted};
use crate::session::Session;
use crate::steps::next_line;
use material::{Overwrite, atomic_copy};
use rig::carry_over;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Go on in another folder with a plan that was changed in the middle
///
/// The new session takes session.toml as it is now, the calibration, and every frame that still
/// fits. Put the old values back into the old session.toml to go on there.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane branch my-wax my-wax-longer")]
pub(crate) struct Args {
    /// Folder of the session whose session.toml was changed
    session: PathBuf,
    /// Folder of the new session
    branch: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let branch = &args.branch;
    if branch.exists() && std::fs::read_dir(branch).map_or(true, |mut files| files.next().is_some())
    {
        let error =
            format!("{}: is there already, and a branch replaces nothing", branch.display());
        let hint = format!("name a folder that is not there: {}", session.branch_command());
        return Err(Failure::input(error).hint(hint));
    }
    let branch = Session::create(branch, session.config.clone(), Overwrite::Refuse)?;
    let rig_file = session.path(RIG_FILE);
    if rig_file.is_file() {
        atomic_copy(&rig_file, &branch.path(RIG_FILE), Overwrite::Refuse)?;
    }
    let choice = session.path(adaptive::CHOICE);
    if choice.is_file() {
        let copy = branch.path(adaptive::CHOICE);
        atomic_copy(&choice, &copy, Overwrite::Refuse)?;
        // Chosen for a bracket that is no more: the branch chooses anew.
        if adaptive::Chosen::read(&branch).is_err() {
            std::fs::remove_file(&copy)
                .map_err(|e| Failure::other(format!("{}: {e}", copy.display())))?;
        }
    }
    let calibration = session.path("calibration");
    if calibration.is_dir() {
        copy_folder(&calibration, &branch.path("calibration"))?;
    }
    let (old, new) = (session.folder(), branch.folder());
    // With the calibration in place: a colour wheel may change the exposures.
    let branch = Session::open(new)?;
    let acquisition = branch.acquisition();
    let mut carried = 0;
    for plan in [
        acquisition.calibration_plan(),
        acquisition.light_plan(),
        acquisition.noise_plan(),
        adaptive::sample_plan(&branch)?,
    ] {
        plan.check()?;
        carried += carry_over(&plan, old, new).map_err(|e| branch.run_failure(e))?;
    }
    let fit = if carried == 1 { "fits" } else { "fit" };
    let text = format!(
        "{}: {} of {} still {fit}\n{}",
        new.display(),
        counted(carried, "frame"),
        old.display(),
        next_line(&branch)?
    );
    Ok(Done::new(json!({ "session": new, "carried": carried }), text))
}

fn copy_folder(from: &Path, to: &Path) -> Result<(), Failure> {
    let failed = |e: std::io::Error| Failure::other(format!("{}: {e}", from.display()));
    std::fs::create_dir_all(to).map_err(failed)?;
    for entry in std::fs::read_dir(from).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let Some(name) = path.file_name().filter(|_| path.is_file()) else { continue };
        atomic_copy(&path, &to.join(name), Overwrite::Refuse)?;
    }
    Ok(())
}
