//! `diaphane export`: the material in other programs' formats.

use crate::Failure;
use crate::commands::verify::load_material;
use crate::conversion::{ConversionArgs, may_be_clamped, warn_of_clamped};
use crate::output::Done;
use crate::session::Session;
use crate::steps::{self, Ledger, made_from};
use material::{Conversion, Input, Overwrite, ScatteringMedium, hash_file, nrrd, write_all};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;

/// Written last but for the record: once it is there the export is done.
pub(crate) const NPZ: &str = "material/export/material.npz";
/// What was exported.
const RECORD: &str = "material/export/export.json";

/// What an export wrote, and from which material.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Record {
    pub inputs: Vec<Input>,
    files: Vec<Exported>,
    /// Voxel values that were given no scattering.
    clamped: usize,
}

/// One of its files, as seen from the session.
#[derive(Debug, Serialize, Deserialize)]
struct Exported {
    name: String,
    bytes: u64,
    blake3: String,
}

impl Record {
    /// Of a session; None where it was exported by a version that kept none.
    pub fn read(session: &Session) -> Result<Option<Self>, Failure> {
        let there = session.path(RECORD).is_file();
        there.then(|| session.read_json(RECORD, "diaphane export SESSION")).transpose()
    }

    /// Fails where a file is not there or not as long as it was.
    pub fn check_sizes(&self, session: &Session) -> Result<(), Failure> {
        for file in &self.files {
            let found = std::fs::metadata(session.path(&file.name)).map(|about| about.len());
            let name = &file.name;
            match found {
                Ok(found) if found == file.bytes => {}
                Ok(found) => {
                    let error = format!("{name}: expected {} bytes, found {found}", file.bytes);
                    return Err(Failure::input(error));
                }
                Err(error) => return Err(Failure::input(format!("{name}: {error}"))),
            }
        }
        Ok(())
    }

    /// Fails where the content of a file is not what was written.
    pub fn check_content(&self, session: &Session) -> Result<(), Failure> {
        for Exported { name, blake3, .. } in &self.files {
            if hash_file(&session.path(name))? != *blake3 {
                let error = format!("{name}: its content is not what was written, {RECORD} says");
                return Err(Failure::input(error));
            }
        }
        Ok(())
    }

    fn of(
        session: &Session,
        inputs: Vec<Input>,
        files: &[PathBuf],
        clamped: usize,
    ) -> Result<Self, Failure> {
        let exported = |path: &PathBuf| {
            let name = path.strip_prefix(session.folder()).unwrap_or(path);
            let bytes = std::fs::metadata(path).map_err(Failure::other)?.len();
            Ok(Exported { name: name.display().to_string(), bytes, blake3: hash_file(path)? })
        };
        let files = files.iter().map(exported).collect::<Result<_, Failure>>()?;
        Ok(Self { inputs, files, clamped })
    }
}

/// Write the material for other programs: OpenVDB, Mitsuba 3, pbrt, NRRD, OpenEXR, NumPy, glTF, OpenPBR
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane export my-wax")]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    #[command(flatten)]
    conversion: ConversionArgs,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let files = export(&session, args.conversion.conversion(), overwrite)?;
    let mut lines: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
    lines.push(steps::next_line(&session)?);
    Ok(Done::new(json!({ "files": files }), lines.join("\n")))
}

/// What is written before [`NPZ`]; Mitsuba's volumes come with its scene.
const FILES: [&str; 7] = [
    "material/export/material.vdb",
    "material/export/mitsuba/scene.xml",
    "material/export/material.pbrt",
    "material/export/material.nrrd",
    "material/export/material.exr",
    "material/export/average.gltf",
    "material/export/average.mtlx",
];
/// A single volume for viewers that know no more.
const DENSITY: &str = "material/export/density.nrrd";

/// Writes every format and returns the files.
pub(crate) fn export(
    session: &Session,
    conversion: Conversion,
    overwrite: Overwrite,
) -> Result<Vec<PathBuf>, Failure> {
    session.refuse_existing(NPZ, overwrite)?;
    // What an interrupted export left behind is no result.
    let overwrite = if session.path(NPZ).exists() { overwrite } else { Overwrite::Replace };
    let ledger = Ledger::of(session)?;
    steps::warn(&ledger, "export")?;
    let inputs = made_from::inputs(&made_from::export(&ledger));
    let material = load_material(session)?;
    // Asked before anything is written.
    let Conversion { unit, impossible } = conversion;
    let folder = session.path("material/export");
    let medium =
        ScatteringMedium::of(&material, unit, impossible, &folder).map_err(may_be_clamped)?;
    let paths: Vec<PathBuf> =
        FILES.iter().map(|name| session.result(name)).collect::<Result<_, Failure>>()?;
    let written = write_all(&paths, &material, conversion, overwrite)?;
    let mut files: Vec<PathBuf> = written.into_iter().flat_map(|written| written.files).collect();
    let (density, npz) = (session.result(DENSITY)?, session.result(NPZ)?);
    nrrd::write_density(&density, &medium, overwrite)?;
    material.write_npz(&npz, overwrite)?;
    files.extend([density, npz]);
    warn_of_clamped(medium.clamped());
    let record = Record::of(session, inputs, &files, medium.clamped())?;
    session.write_json(RECORD, &record, Overwrite::Replace)?;
    Ok(files)
}
