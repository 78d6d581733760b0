//! `diaphane calibrate projector`: coded light on a printed board, in several poses.

use super::options::{
    BoardArgs, ChoiceArgs, ResultArgs, device_json, device_text, distortion, outlier_text, size,
    verdict_text,
};
use crate::Failure;
use crate::output::{Done, Progress};
use calibration::{
    Board, CalibrationError, Choice, CodeLayout, CodePicture, NoBoard, RigView, calibrate_geometry,
    coded_corners, decode,
};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Calibrate camera and projector together from coded light on a printed board
///
/// One subfolder a pose, each with the pictures of one code sequence in the order of their names:
/// Gray code of the columns, the most significant bit first and each bit followed by its inverse;
/// the rows likewise; white; black (the order of OpenCV's GrayCodePattern). With --phase the
/// sinusoids of the columns, then of the rows, follow.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  diaphane calibrate projector --images poses --board 9x7 \\\n    --square 75 \
                  --projector 1024x768 --output rig.toml"
)]
pub(crate) struct Args {
    /// Folder with one subfolder a pose
    #[arg(long, value_name = "DIR")]
    images: PathBuf,
    #[command(flatten)]
    board: BoardArgs,
    /// The projector's width and height, pixels
    #[arg(long, value_name = "WxH", value_parser = size)]
    projector: [usize; 2],
    /// Period in projector pixels and steps of a phase shift that refines the code, as 32,4
    #[arg(long, value_name = "PERIOD,STEPS", value_parser = phase)]
    phase: Option<(usize, usize)>,
    /// The projector's distortion, named as the camera's
    #[arg(long, default_value = "auto")]
    projector_distortion: String,
    #[command(flatten)]
    choice: ChoiceArgs,
    #[command(flatten)]
    result: ResultArgs,
}

fn phase(text: &str) -> Result<(usize, usize), String> {
    let pair = text.split_once(',').and_then(|(period, steps)| {
        Some((period.trim().parse().ok()?, steps.trim().parse().ok()?))
    });
    pair.ok_or_else(|| "expected PERIOD,STEPS, for instance 32,4".into())
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let started = Instant::now();
    args.result.check()?;
    let choice =
        Choice { projector: distortion(&args.projector_distortion)?, ..args.choice.choice()? };
    let board = args.board.board()?;
    let layout = match args.phase {
        None => CodeLayout::gray_code(args.projector),
        Some((period, steps)) => CodeLayout::phase_shift(args.projector, period, steps)?,
    };
    let folders = poses(&args.images)?;
    let mut progress = Progress::new("decode", folders.len());
    let (mut views, mut missed) = (Vec::new(), Vec::new());
    let mut size: Option<([usize; 2], String)> = None;
    let mut other_board = None;
    for (done, folder) in folders.iter().enumerate() {
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        progress.set(done, &name);
        let (view, found) = match look(folder, &name, &layout, &board) {
            Err(error @ CalibrationError::BoardNotFound { .. }) => {
                // Two poses that show one other board, and none this one: it was miscounted.
                let other = shown_instead(&error);
                if views.is_empty() && other.is_some() && other == other_board {
                    return Err(error.into());
                }
                other_board = other_board.or(other);
                eprintln!("warning: {error}");
                missed.push(error.to_string());
                continue;
            }
            other => other?,
        };
        match &size {
            Some((expected, first)) if *expected != found => {
                let ([w, h], [u, v]) = (*expected, found);
                return Err(CalibrationError::Mismatch {
                    picture: name,
                    expected: format!("{w}x{h} pixels as in {first}"),
                    found: format!("{u}x{v} pixels"),
                }
                .into());
            }
            Some(_) => {}
            None => size = Some((found, name)),
        }
        if view.coded.len() < view.board.image_points.len() {
            let (lit, all) = (view.coded.len(), view.board.image_points.len());
            eprintln!("warning: {}: {lit} of {all} corners have a code", view.board.name);
        }
        views.push(view);
    }
    progress.finish("done");
    let size = size.map_or([0, 0], |(size, _)| size);
    let result = calibrate_geometry(&views, size, Some(args.projector), choice)?;
    let assessment = args.result.write(&args.images.display().to_string(), &result, &missed)?;
    let Some(projector) = &result.projector else {
        return Err(Failure::other("no projector came out of the calibration"));
    };
    let mut text = String::new();
    for view in &result.views {
        let lit = view.projector_rms_px.map_or("no code".into(), |r| format!("{r:.3} px"));
        text += &format!("{:24} camera {:.3} px, projector {lit}\n", view.name, view.camera_rms_px);
    }
    text += &outlier_text(&result);
    let device = &projector.device;
    text += &format!(
        "{} of {} poses, RMS {:.4} px: camera {:.4} px, projector {:.4} px\n{}\n{}\n\
         baseline {:.2} ± {:.2} mm",
        views.len(),
        folders.len(),
        result.rms_px,
        result.camera.rms_px,
        device.rms_px,
        device_text("camera", &result.camera),
        device_text("projector", device),
        projector.baseline_mm,
        projector.baseline_standard_deviation_mm
    );
    text += &format!("\n{}", verdict_text(&assessment.verdict));
    let json = json!({
        "rms_px": result.rms_px,
        "camera_rms_px": result.camera.rms_px,
        "projector_rms_px": device.rms_px,
        "camera": device_json(&result.camera),
        "projector": device_json(device),
        "baseline_mm": projector.baseline_mm,
        "baseline_standard_deviation_mm": projector.baseline_standard_deviation_mm,
        "poses_found": views.len(),
        "poses_total": folders.len(),
        "warp_mm": result.warp_mm,
        "outliers": result.outliers,
        "missed": missed,
        "assessment": assessment,
        "seconds": started.elapsed().as_secs_f64(),
    });
    Ok(Done::new(json, text))
}

/// The size of the board that a picture shows instead of the one that was asked for.
fn shown_instead(error: &CalibrationError) -> Option<[usize; 2]> {
    match error {
        CalibrationError::BoardNotFound { reason: NoBoard::OtherBoard { seen, .. }, .. } => *seen,
        _ => None,
    }
}

/// The subfolders, by name.
fn poses(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable =
        |e: std::io::Error| Failure::input(format!("{}: cannot be read: {e}", folder.display()));
    let mut out = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if path.is_dir() {
            out.push(path);
        }
    }
    if out.is_empty() {
        let error = format!("{}: expected one subfolder a pose, found none", folder.display());
        return Err(Failure::input(error));
    }
    out.sort();
    Ok(out)
}

/// The board in one pose, its corners with their projector pixels, and the pictures' size.
fn look(
    folder: &Path,
    name: &str,
    layout: &CodeLayout,
    board: &Board,
) -> Result<(RigView, [usize; 2]), CalibrationError> {
    let pictures = layout.load(folder)?;
    let white = layout.sequence().iter().position(|p| *p == CodePicture::White);
    let white = white.and_then(|at| pictures.get(at));
    let Some(white) = white else {
        return Err(CalibrationError::TooFewViews { what: "a code", needed: 1, found: 0 });
    };
    // The code first: it tells a white picture that was exchanged with another.
    let decoded = decode(layout, &pictures).map_err(|e| in_folder(name, e))?;
    let mut seen = board.view(white).map_err(|e| in_folder(name, e))?;
    seen.name = name.to_owned();
    let coded = coded_corners(&decoded, &seen.image_points);
    let size = [white.width, white.height];
    Ok((RigView { board: seen, coded, projected: Vec::new() }, size))
}

/// The same error with the pose's folder before the picture: those of all poses have one name.
fn in_folder(folder: &str, error: CalibrationError) -> CalibrationError {
    use CalibrationError as E;
    let name = |picture: String| format!("{folder}/{picture}");
    match error {
        E::BoardNotFound { picture, board, reason } => {
            E::BoardNotFound { picture: name(picture), board, reason }
        }
        E::CodeSequence { picture, reason } => E::CodeSequence { picture: name(picture), reason },
        E::Mismatch { picture, expected, found } => {
            E::Mismatch { picture: name(picture), expected, found }
        }
        error => error,
    }
}
