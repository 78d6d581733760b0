//! `diaphane export`: the material in other programs' formats.

use crate::Failure;
use crate::commands::verify::load_material;
use crate::output::Done;
use crate::session::Session;
use material::Overwrite;
use material::mitsuba::{self, Impossible};
use serde_json::json;
use std::path::PathBuf;

pub(crate) const NPZ: &str = "material/export/material.npz";

/// Write the material for other programs: NumPy and Mitsuba 3
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane export my-wax")]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    /// Give voxels that no scattering medium has (3κμ > 1) no scattering instead of refusing them
    #[arg(long)]
    clamp: bool,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let impossible = if args.clamp { Impossible::Clamp } else { Impossible::Refuse };
    let files = export(&session, impossible, overwrite)?;
    let lines: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
    Ok(Done::new(json!({ "files": files }), lines.join("\n")))
}

/// Writes every format and returns the files.
pub(crate) fn export(
    session: &Session,
    impossible: Impossible,
    overwrite: Overwrite,
) -> Result<Vec<PathBuf>, Failure> {
    let material = load_material(session)?;
    let npz = session.result(NPZ)?;
    let folder = session.path("material/export/mitsuba");
    std::fs::create_dir_all(&folder)
        .map_err(|e| Failure::other(format!("{}: cannot be made: {e}", folder.display())))?;
    let exported = mitsuba::export(&folder, &material, impossible, overwrite).map_err(|e| {
        let hint = matches!(e, material::FileError::CannotHold { .. });
        let failure = Failure::from(e);
        if hint { failure.hint("add --clamp to write them without scattering") } else { failure }
    })?;
    material.write_npz(&npz, overwrite)?;
    if exported.clamped > 0 {
        eprintln!("warning: {} voxel values were clamped to no scattering", exported.clamped);
    }
    let mut files = vec![npz];
    files.extend(exported.files);
    Ok(files)
}
