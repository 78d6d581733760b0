//! `diaphane convert`: a material from one format to another.

use crate::Failure;
use crate::conversion::{ConversionArgs, may_be_clamped, warn_of_clamped};
use crate::output::{Done, check_output};
use material::{Format, Overwrite};
use serde_json::json;
use std::path::PathBuf;

/// Write a material that is in one format in another
///
/// Read are .diaphane, .npz, .vdb, .nrrd, .exr and Mitsuba's .vol (sigma_a.vol with sigma_s.vol
/// beside it), told by what is in them. Written are, by the ending of the name: .diaphane, .npz,
/// .vdb, .nrrd, .exr, .xml (a scene for Mitsuba with its volumes in the same folder), .pbrt, and
/// the homogeneous average as .gltf and .mtlx. docs/formats.md says what each of them keeps.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  diaphane convert my-wax/material/material.diaphane wax.vdb --unit m"
)]
pub(crate) struct Args {
    /// File that holds a material
    from: PathBuf,
    /// File to write
    to: PathBuf,
    #[command(flatten)]
    conversion: ConversionArgs,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let format = Format::to_write(&args.to)?;
    check_output(&args.to, overwrite)?;
    let reading = Format::read(&args.from)?;
    let written = format
        .write(&args.to, &reading.material, args.conversion.conversion(), overwrite)
        .map_err(may_be_clamped)?;
    warn_of_clamped(written.clamped);
    for assumed in &reading.assumed {
        eprintln!("warning: {} does not tell; assumed: {assumed}", args.from.display());
    }
    let lines: Vec<String> = written.files.iter().map(|f| f.display().to_string()).collect();
    let json = json!({
        "files": written.files,
        "clamped": written.clamped,
        "assumed": reading.assumed,
    });
    Ok(Done::new(json, lines.join("\n")))
}
