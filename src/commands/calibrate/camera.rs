//! `diaphane calibrate camera`: any folder of photographs of a chessboard.

use crate::Failure;
use crate::output::Done;
use calibration::{Board, Choice, RigView, calibrate_geometry, find_views, list_pictures};
use serde_json::json;
use std::path::PathBuf;

/// Calibrate a camera from a folder of photographs of a chessboard
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  diaphane calibrate camera --images photos --board 9x6 --square 25"
)]
pub(crate) struct Args {
    /// Folder of photographs (png, jpg, tif)
    #[arg(long)]
    images: PathBuf,
    /// Inner corners of the board, columns x rows
    #[arg(long)]
    board: String,
    /// Edge of a square, mm
    #[arg(long)]
    square: f64,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let board = Board::parse(&args.board, args.square)?;
    let pictures = list_pictures(&args.images)?;
    let found = find_views(&pictures, &board)?;
    for missed in &found.missed {
        eprintln!("warning: {missed}");
    }
    let (total, size) = (found.views.len(), found.size);
    let views: Vec<RigView> = found.views.into_iter().map(RigView::camera_only).collect();
    let result = calibrate_geometry(&views, size, None, Choice::default())?;
    let m = &result.camera.model;
    let worst = result.views.iter().map(|v| v.camera_rms_px).fold(0.0, f64::max);
    let mut text = String::new();
    for view in &result.views {
        text += &format!("{:24} {:.3} px\n", view.name, view.camera_rms_px);
    }
    text += &format!(
        "{} of {} views, RMS {:.4} px, worst view {worst:.3} px\nfx {:.2} fy {:.2} cx {:.2} cy {:.2}, distortion k1 k2 p1 p2 k3 k4 k5 k6 {:?}",
        total,
        pictures.len(),
        result.rms_px,
        m.fx,
        m.fy,
        m.cx,
        m.cy,
        m.distortion
    );
    let missed: Vec<String> = found.missed.iter().map(ToString::to_string).collect();
    let json = json!({
        "rms_px": result.rms_px,
        "worst_view_px": worst,
        "views_found": total,
        "views_total": pictures.len(),
        "fx": m.fx,
        "fy": m.fy,
        "cx": m.cx,
        "cy": m.cy,
        "distortion": m.distortion,
        "missed": missed,
        "standard_deviations": result.camera.standard_deviations,
    });
    Ok(Done::new(json, text))
}
