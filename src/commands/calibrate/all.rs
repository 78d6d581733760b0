//! `diaphane calibrate all`: camera, projector, face, response, white, from a session's pictures.

use super::boards::session_geometry;
use super::face::{face_pose, thickness};
use super::frames::{merge_shot, response_bracket, subtract};
use super::guide;
use super::options::verdict_text;
use crate::Failure;
use crate::cli::STOP;
use crate::devices;
use crate::output::{Done, Progress};
use crate::report::calibration_page;
use crate::sensor::Sensor;
use crate::session::{RigConfig, Session};
use crate::steps::{self, Ledger, made_from, next_line};
use calibration::{
    Assessment, Board, CameraModel, FacePlane, Geometry, HdrImage, NoiseModel, ProjectorGeometry,
    Response, Verdict, WhiteBalance, find_chart, recover_response_above, rectify, white_balance,
    write_geometry,
};
use material::{Face, Input, Overwrite, atomic_write};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

pub(crate) const RESULT: &str = "calibration/calibration.json";
/// The geometry alone, with its observations, in the form that `calibrate convert` reads.
const GEOMETRY: &str = "calibration/geometry.toml";
/// The page about it.
const PAGE: &str = "calibration/calibration.html";
const COMMAND: &str = "diaphane calibrate all SESSION";

/// Take the calibration pictures that are missing, one placement after the other, and calibrate
/// everything that a session needs from them
///
/// Says what to place where, and looks at each picture at once: is the board there, sharp, not
/// clipped? Can be interrupted; the same command goes on where it was.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane calibrate all my-wax")]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    /// Replace a calibration that is there
    #[arg(long)]
    force: bool,
}

/// What the session knows about its rig.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Calibrated {
    /// Camera and projector, from the boards.
    pub geometry: Geometry,
    /// How good they are.
    pub verdict: Verdict,
    /// The front face, seen by the camera.
    pub front: FacePlane,
    /// RMS of the board that lay in the front face's plane, pixels.
    pub front_rms_px: f64,
    /// Distance between the planes of the front and the back face, mm, where a board lay in both.
    pub thickness_mm: Option<f64>,
    pub response: Response,
    /// From the chart's grey row.
    pub white_balance: WhiteBalance,
    /// Merged radiance of a white sheet under irradiance 1, red, green and blue.
    pub white: [f64; 3],
    /// Irradiance of projector white on the lit face's cells, mean 1, x fastest.
    pub irradiance: Vec<f64>,
    /// How far chart and white sheet disagree on white, largest of the channels.
    pub white_disagreement: f64,
    /// What it was made from; empty in files from before it was noted.
    #[serde(default)]
    pub inputs: Vec<Input>,
}

pub(crate) fn is_done(session: &Session) -> bool {
    session.path(RESULT).is_file()
}

pub(crate) fn load(session: &Session) -> Result<Calibrated, Failure> {
    session.read_json(RESULT, COMMAND)
}

impl Calibrated {
    /// The projector; a session always has one.
    pub fn projector(&self) -> Result<&ProjectorGeometry, Failure> {
        self.geometry.projector.as_ref().ok_or_else(|| {
            Failure::input(format!("{RESULT}: damaged: no projector"))
                .hint("calibrate again: diaphane calibrate all SESSION --force")
        })
    }
}

/// The lit face, lit by the projector: what turns a place on it into a projector pixel.
pub(crate) fn lit_plane(session: &Session) -> Result<FacePlane, Failure> {
    let found = load(session)?;
    let projector = found.projector()?;
    Ok(FacePlane {
        device: projector.device.model,
        pose: found.front.pose.then(&projector.pose),
        z_mm: lit_z(session),
    })
}

pub(crate) fn lit_z(session: &Session) -> f64 {
    match session.config.sample.lit_face {
        Face::Front => 0.0,
        Face::Back => session.config.sample.grid.size_mm()[2],
    }
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    session.refuse_existing(RESULT, overwrite)?;
    let complaints = match session.config.rig {
        RigConfig::Imported => Vec::new(),
        _ => guide::take(&session, &mut devices::open(&session)?)?,
    };
    let found = solve(&session, overwrite)?;
    let (camera, projector) = (&found.geometry.camera, found.projector()?);
    let text = format!(
        "camera {:.3} px over {} views, projector {:.3} px, front face {:.3} px{}\n\
         baseline {:.1} mm; white by chart and by sheet agree to {:.1} %\n\
         {}\n\
         page: {}\n\
         {}",
        camera.rms_px,
        found.geometry.views.len(),
        projector.device.rms_px,
        found.front_rms_px,
        found.thickness_mm.map_or(String::new(), |t| format!(", block {t:.2} mm thick")),
        projector.baseline_mm,
        100.0 * found.white_disagreement,
        with_more_views(&session, &found.verdict),
        session.path(PAGE).display(),
        next_line(&session)?
    );
    let model = |m: &CameraModel| json!({ "fx": m.fx, "fy": m.fy, "cx": m.cx, "cy": m.cy });
    let json = json!({
        "camera_rms_px": camera.rms_px,
        "projector_rms_px": projector.device.rms_px,
        "front_rms_px": found.front_rms_px,
        "thickness_mm": found.thickness_mm,
        "camera": model(&camera.model),
        "projector": model(&projector.device.model),
        "baseline_mm": projector.baseline_mm,
        "white_balance_gains": found.white_balance.gains,
        "white_disagreement": found.white_disagreement,
        "response_strictly_increasing": found.response.is_strictly_increasing(),
        "complaints": complaints,
        "verdict": found.verdict,
        "page": session.path(PAGE),
    });
    Ok(Done::new(json, text))
}

/// The verdict, and how a session gets more views where it wants them.
fn with_more_views(session: &Session, verdict: &Verdict) -> String {
    let mut out = verdict_text(verdict);
    if !verdict.advice.is_empty() {
        let poses = session.config.plan.board_poses;
        out += &format!(
            "\n  for more views set board_poses (now {poses}) in session.toml and give: {}",
            session.command("calibrate all SESSION --force")
        );
    }
    out
}

/// The parts of the rig's description that a calibration needs.
pub(crate) fn described(session: &Session) -> Result<(Board, NoiseModel), Failure> {
    match &session.config.rig {
        RigConfig::Simulated { board, noise, .. } | RigConfig::Devices { board, noise, .. } => {
            Ok((*board, *noise))
        }
        RigConfig::Imported => Err(Failure::input(format!(
            "{}: the pictures of this session were imported; there is nothing to calibrate",
            session.folder().display()
        ))),
    }
}

/// Calibrates and writes the result.
pub(crate) fn solve(session: &Session, overwrite: Overwrite) -> Result<Calibrated, Failure> {
    session.refuse_existing(RESULT, overwrite)?;
    let ledger = Ledger::of(session)?;
    let found = derive(&ledger, |geometry, assessment| {
        write_evidence(session, geometry, assessment, overwrite)
    })?;
    go_on()?;
    session.write_json(RESULT, &found, overwrite)?;
    Ok(found)
}

/// The calibration as it follows from its pictures; `keep` gets the geometry and what is to be said
/// about it. Nothing is written.
pub(crate) fn derive(
    ledger: &Ledger<'_>,
    keep: impl FnOnce(&Geometry, &Assessment) -> Result<(), Failure>,
) -> Result<Calibrated, Failure> {
    let session = ledger.session;
    let (board, noise) = described(session)?;
    let plan = &session.config.plan;
    let pictures = session.acquisition().calibration_plan();
    steps::check_frames(ledger, &pictures, "calibrate all SESSION")?;
    let inputs = made_from::inputs(&made_from::calibration(ledger)?);
    let mut progress = Progress::new("calibrate", 5);

    progress.set(0, "camera and projector");
    let (geometry, missed) = session_geometry(session, &board)?;
    go_on()?;
    let assessment = Assessment::of(&geometry, &missed)?;
    keep(&geometry, &assessment)?;
    let verdict = assessment.verdict;
    let camera = geometry.camera.model;

    go_on()?;
    progress.set(2, "face");
    let (pose, front_rms_px) = face_pose(session, &camera, &board, "face-board-front")?;
    let thickness_mm = match session.config.sample.lit_face {
        Face::Front => None,
        Face::Back => Some(thickness(session, &camera, &board, &pose)?),
    };
    let front = FacePlane { device: camera, pose, z_mm: 0.0 };

    go_on()?;
    progress.set(3, "response");
    let response = recover_response_above(&response_bracket(session)?, noise.black_level)?;

    go_on()?;
    progress.set(4, "white");
    let sensor = Sensor::of(session)?;
    let merged = |shot: &str| -> Result<HdrImage, Failure> {
        merge_shot(session, shot, &plan.reference_bracket_s, &response, &sensor)
    };
    let chart = subtract(merged("chart")?, &merged("chart-black")?);
    let balance = white_balance(&find_chart(&chart, "chart")?)?;
    let sheet = subtract(merged("sheet-white")?, &merged("sheet-black")?);
    let lit_seen = FacePlane { device: camera, pose, z_mm: lit_z(session) };
    let grid = &session.config.sample.grid;
    let ([nx, ny, _], [hx, hy, _]) = (grid.cells(), grid.spacing_mm());
    let map = rectify(&sheet, &lit_seen, [nx, ny], [hx, hy])?;
    let face = nx * ny;
    let mean = |c: usize| -> f64 {
        map.radiance[c * face..(c + 1) * face].iter().map(|v| f64::from(*v)).sum::<f64>()
            / face as f64
    };
    let seen = [mean(0), mean(1), mean(2)];
    if !seen.iter().all(|s| s.is_finite() && *s > 0.0) {
        return Err(Failure::input(format!("sheet-white: the white sheet is dark: {seen:?}"))
            .hint("the projector must be on and the sheet in the plane of the lit face"));
    }
    // A sheet of radiance 1/π is under irradiance 1. Its colour is the projector's white.
    let irradiance = (0..face)
        .map(|i| (0..3).map(|c| f64::from(map.radiance[c * face + i]) / seen[c]).sum::<f64>() / 3.0)
        .collect();
    let balanced: Vec<f64> = (0..3).map(|c| seen[c] * balance.gains[c]).collect();
    let white_disagreement =
        balanced.iter().map(|b| (b / balanced[1] - 1.0).abs()).fold(0.0, f64::max);

    let found = Calibrated {
        geometry,
        verdict,
        front,
        front_rms_px,
        thickness_mm,
        response,
        white_balance: balance,
        white: seen,
        irradiance,
        white_disagreement,
        inputs,
    };
    progress.finish("done");
    Ok(found)
}

/// Ends the work where Ctrl-C was pressed; nothing is written then.
pub(crate) fn go_on() -> Result<(), Failure> {
    if STOP.load(Ordering::Relaxed) {
        return Err(Failure::other("interrupted; the pictures are kept, nothing was replaced")
            .hint("the same command goes on from here"));
    }
    Ok(())
}

/// Writes what the geometry rests on, for people and for other programs.
fn write_evidence(
    session: &Session,
    geometry: &Geometry,
    assessment: &Assessment,
    overwrite: Overwrite,
) -> Result<(), Failure> {
    let title = format!("Calibration of {}", session.config.sample.name);
    let page = calibration_page(&title, geometry, assessment)?;
    // The result is written last; evidence without it is what an interrupted run left behind.
    let overwrite = if session.path(RESULT).exists() { overwrite } else { Overwrite::Replace };
    write_geometry(&session.result(GEOMETRY)?, geometry, overwrite)?;
    atomic_write(&session.result(PAGE)?, overwrite, |file| file.write_all(page.as_bytes()))?;
    Ok(())
}
