//! `diaphane calibrate convert`: a calibration for other programs, or from them.

use crate::Failure;
use crate::output::{Done, check_output};
use calibration::{
    Geometry, Pose, read_geometry, read_opencv, write_cameramodel, write_geometry, write_opencv,
};
use material::Overwrite;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Convert a geometric calibration between Diaphane's TOML, OpenCV's YAML, XML or JSON, and
/// mrcal's .cameramodel (written only)
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  diaphane calibrate convert rig.toml rig.yml\n  \
                        diaphane calibrate convert rig.toml projector.cameramodel --device projector")]
pub(crate) struct Args {
    /// What to read: .toml, .yml, .yaml, .xml, .json
    from: PathBuf,
    /// What to write: .toml, .yml, .yaml, .xml, .json, .cameramodel
    to: PathBuf,
    /// The device of a .cameramodel, which holds one
    #[arg(long, value_enum, default_value = "camera")]
    device: Which,
    /// Replace the file if it is there
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Which {
    Camera,
    Projector,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    check_output(&args.to, overwrite)?;
    let geometry = match suffix(&args.from).as_str() {
        "toml" => read_geometry(&args.from)?,
        "yml" | "yaml" | "xml" | "json" => read_opencv(&args.from)?,
        _ => return Err(unknown(&args.from, ".toml, .yml, .yaml, .xml or .json")),
    };
    match suffix(&args.to).as_str() {
        "toml" => write_geometry(&args.to, &geometry, overwrite)?,
        "yml" | "yaml" | "xml" | "json" => write_opencv(&args.to, &geometry, overwrite)?,
        "cameramodel" => {
            let (model, pose) = device(args, &geometry)?;
            write_cameramodel(&args.to, model, &pose, overwrite)?;
        }
        _ => return Err(unknown(&args.to, ".toml, .yml, .yaml, .xml, .json or .cameramodel")),
    }
    let evidence = !geometry.observations.is_empty();
    let text = if evidence {
        format!("wrote {}", args.to.display())
    } else {
        format!("wrote {}: models only, no evidence for them", args.to.display())
    };
    let json = json!({ "path": args.to, "evidence": evidence });
    Ok(Done::new(json, text))
}

fn device<'a>(
    args: &Args,
    geometry: &'a Geometry,
) -> Result<(&'a calibration::CameraModel, Pose), Failure> {
    match (args.device, &geometry.projector) {
        (Which::Camera, _) => Ok((&geometry.camera.model, Pose::identity())),
        (Which::Projector, Some(projector)) => Ok((&projector.device.model, projector.pose)),
        (Which::Projector, None) => {
            Err(Failure::input(format!("{}: holds no projector", args.from.display())))
        }
    }
}

fn suffix(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

fn unknown(path: &Path, expected: &str) -> Failure {
    Failure::input(format!("{}: expected a file ending in {expected}", path.display()))
}
