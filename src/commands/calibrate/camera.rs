//! `diaphane calibrate camera`: photographs of a board, or points that were found elsewhere.

use super::options::{
    ChoiceArgs, ResultArgs, device_json, device_text, outlier_text, size, verdict_text,
};
use super::points::read_points;
use crate::Failure;
use crate::output::Done;
use calibration::{Board, RigView, View, calibrate_geometry, find_views, list_pictures};
use serde_json::json;
use std::path::PathBuf;

/// Calibrate a camera from a folder of photographs of a board, or from lists of points
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane calibrate camera --images photos --board 9x6 --square 25\n  \
                  diaphane calibrate camera --points view1.txt view2.txt view3.txt \\\n    \
                  --plane board.txt --size 640x480 --distortion k1-k2 --skew"
)]
pub(crate) struct Args {
    #[command(flatten)]
    source: Source,
    /// Inner corners of the board, columns x rows; or charuco:11x8:4x4_50:18 (squares,
    /// dictionary, marker edge in mm)
    #[arg(long, requires = "images", requires = "square")]
    board: Option<String>,
    /// Edge of a square, mm
    #[arg(long, requires = "images")]
    square: Option<f64>,
    /// The points' places on the board, mm: x y pairs in the order of each view
    #[arg(long, value_name = "FILE", requires = "points")]
    plane: Option<PathBuf>,
    /// The pictures' width and height, where only points are given
    #[arg(long, value_name = "WxH", value_parser = size, requires = "points")]
    size: Option<[usize; 2]>,
    #[command(flatten)]
    choice: ChoiceArgs,
    #[command(flatten)]
    result: ResultArgs,
}

/// Where the views come from.
#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct Source {
    /// Folder of photographs (png, jpg, tif)
    #[arg(long, value_name = "DIR", requires = "board")]
    images: Option<PathBuf>,
    /// Text files of seen points, one a view: x y pairs in pixels
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "plane", requires = "size")]
    points: Option<Vec<PathBuf>>,
}

impl Source {
    /// The folder or the first file, for a title.
    fn name(&self) -> String {
        let first = self.points.as_ref().and_then(|files| files.first());
        self.images.as_ref().or(first).map_or(String::new(), |path| path.display().to_string())
    }
}

/// The views, the size of their pictures, how many there were, and what was not found.
struct Seen {
    views: Vec<View>,
    size: [usize; 2],
    total: usize,
    missed: Vec<String>,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    args.result.check()?;
    let choice = args.choice.choice()?;
    let seen = look(args)?;
    let found = seen.views.len();
    let views: Vec<RigView> = seen.views.into_iter().map(RigView::camera_only).collect();
    let result = calibrate_geometry(&views, seen.size, None, choice)?;
    let assessment = args.result.write(&args.source.name(), &result, &seen.missed)?;
    let camera = &result.camera;
    let worst = result.views.iter().map(|v| v.camera_rms_px).fold(0.0, f64::max);
    let mut text = String::new();
    for view in &result.views {
        text += &format!("{:24} {:.3} px\n", view.name, view.camera_rms_px);
    }
    text += &outlier_text(&result);
    text += &format!(
        "{found} of {} views, RMS {:.4} px, worst view {worst:.3} px\n{}",
        seen.total,
        result.rms_px,
        device_text("camera", camera)
    );
    if let Some([x, y]) = result.warp_mm {
        text += &format!("\nboard bent by {x:.3} mm along x, {y:.3} mm along y");
    }
    text += &format!("\n{}", verdict_text(&assessment.verdict));
    let mut json = device_json(camera);
    let more = json!({
        "worst_view_px": worst,
        "views_found": found,
        "views_total": seen.total,
        "views": result.views.iter().map(|v| json!({ "name": v.name, "rms_px": v.camera_rms_px }))
            .collect::<Vec<_>>(),
        "warp_mm": result.warp_mm,
        "outliers": result.outliers,
        "missed": seen.missed,
        "assessment": assessment,
    });
    if let (Some(json), serde_json::Value::Object(more)) = (json.as_object_mut(), more) {
        json.extend(more);
    }
    Ok(Done::new(json, text))
}

fn look(args: &Args) -> Result<Seen, Failure> {
    if let (Some(folder), Some(board), Some(square)) =
        (&args.source.images, &args.board, args.square)
    {
        let board = Board::parse(board, square)?;
        let pictures = list_pictures(folder)?;
        let found = find_views(&pictures, &board)?;
        for missed in &found.missed {
            eprintln!("warning: {missed}");
        }
        for board in &found.boards {
            for dropped in &board.dropped {
                eprintln!("warning: {}: {dropped}", board.name);
            }
        }
        let missed = found.missed.iter().map(ToString::to_string).collect();
        let total = pictures.len();
        return Ok(Seen { views: found.views, size: found.size, total, missed });
    }
    let (Some(files), Some(plane), Some(size)) = (&args.source.points, &args.plane, args.size)
    else {
        return Err(Failure::input("--images needs --board and --square"));
    };
    let object_points: Vec<[f64; 3]> =
        read_points(plane)?.into_iter().map(|[x, y]| [x, y, 0.0]).collect();
    let view = |file: &PathBuf| {
        let image_points = read_points(file)?;
        let object_points = object_points.clone();
        Ok(View { name: file.display().to_string(), image_points, object_points })
    };
    let views = files.iter().map(view).collect::<Result<Vec<_>, Failure>>()?;
    let total = views.len();
    Ok(Seen { views, size, total, missed: Vec::new() })
}
