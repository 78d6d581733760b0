//! `diaphane merge`: brackets to radiance, and radiance onto the sample's grid.

use crate::Failure;
use crate::adaptive;
use crate::cli::STOP;
use crate::commands::calibrate::{self, merge_shot, subtract};
use crate::measurement::{ARRAYS, CHANNELS, Measured, MeasuredPattern};
use crate::output::{Done, Progress, counted};
use crate::sensor::{Sensor, Source};
use crate::session::{RigConfig, Session};
use crate::steps::{self, Ledger, made_from};
use calibration::{HdrImage, rectify, write_exr};
use material::Overwrite;
use rig::{BLACK_SHOT, Purpose, Shot};
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// Merge brackets to radiance: those of a session, or any folder of photographs
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane merge my-wax\n  diaphane merge --images photos --output photos.exr\n  diaphane merge --images dng --darks dng-darks\n  diaphane merge --images raw --exposures times.txt --bayer gbrg --darks darks --noise noise.json"
)]
pub(crate) struct Args {
    /// Folder of the session
    #[arg(conflicts_with = "images")]
    session: Option<PathBuf>,
    /// A folder of photographs of one still scene: PNG, JPEG, TIFF, or camera raw files (DNG, CR2, CR3, NEF, ARW), which come out at half the width and height
    #[arg(long)]
    pub images: Option<PathBuf>,
    /// Exposure times, where EXIF does not tell: lines of "file-name seconds"
    #[arg(long, requires = "images")]
    pub exposures: Option<PathBuf>,
    /// The camera's noise, from calibrate noise; a middling sensor's if not given
    #[arg(long, requires = "images")]
    pub noise: Option<PathBuf>,
    /// The camera's response, from calibrate response; recovered from the photographs if not given
    #[arg(long, requires = "images")]
    pub response: Option<PathBuf>,
    /// The photographs are linear: nothing is to be recovered
    #[arg(long, requires = "images", conflicts_with = "response")]
    pub linear: bool,
    /// Pattern of colour sites of linear mosaics: rggb, bggr, grbg or gbrg; raw files carry theirs
    #[arg(long, requires = "images", conflicts_with = "response")]
    pub bayer: Option<String>,
    /// A folder of dark frames to subtract, their times as those of the photographs
    #[arg(long, requires = "images")]
    pub darks: Option<PathBuf>,
    /// A folder of pictures of an evenly lit white to divide by
    #[arg(long, requires = "images")]
    pub flats: Option<PathBuf>,
    /// The EXR to write; merged.exr beside the photographs if not given
    #[arg(long, requires = "images")]
    pub output: Option<PathBuf>,
    /// Write the radiance in 16 bits (three digits) for programs and disks that want small files
    #[arg(long, requires = "images")]
    pub half: bool,
    /// Replace results that are there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    match (&args.session, &args.images) {
        (Some(session), _) => {
            let session = Session::open(session)?;
            let (measured, source) = measure(&session, overwrite)?;
            let text = format!(
                "{} on {} × {} cells: {}\n{}",
                counted(measured.patterns.len(), "pattern"),
                measured.cells[0],
                measured.cells[1],
                session.path(ARRAYS).display(),
                steps::next_line(&session)?
            );
            let json = json!({
                "output": session.path(ARRAYS),
                "patterns": measured.patterns.len(),
                "noise_measured": source.noise_measured,
                "dark_frames_s": source.dark_frames_s,
            });
            Ok(Done::new(json, text))
        }
        (None, Some(images)) => super::merge_images::run(images, args, overwrite),
        (None, None) => Err(Failure::input("expected a SESSION or --images DIR, found neither")
            .hint("diaphane merge my-wax, or: diaphane merge --images photos")),
    }
}

/// Merges every shot of the sample, lays it onto the grid and writes the measurement; and says what
/// was taken for the camera's noise.
pub(crate) fn measure(
    session: &Session,
    overwrite: Overwrite,
) -> Result<(Measured, Source), Failure> {
    session.refuse_existing(ARRAYS, overwrite)?;
    let ledger = Ledger::of(session)?;
    // As it is before the work: a file that is replaced meanwhile shows.
    let inputs = made_from::inputs(&made_from::measurement(&ledger)?);
    let (measured, source) = derive(&ledger, |shot, light| {
        let exr = session.result(&format!("measurement/hdr/{shot}.exr"))?;
        // Pictures are there to be looked at; the arrays are what counts as the finished result.
        Ok(write_exr(&exr, light, Overwrite::Replace)?)
    })?;
    measured.save(session, inputs, overwrite)?;
    Ok((measured, source))
}

/// The measurement as it follows from the frames and the calibration; `keep` gets each shot's name
/// and radiance in the camera's picture. Nothing is written.
pub(crate) fn derive(
    ledger: &Ledger<'_>,
    mut keep: impl FnMut(&str, &HdrImage) -> Result<(), Failure>,
) -> Result<(Measured, Source), Failure> {
    let session = ledger.session;
    if let RigConfig::Imported = session.config.rig {
        return Err(Failure::input(
            "the pictures of this session were imported, and measured then",
        ));
    }
    let found = calibrate::load(session)?;
    let plan = adaptive::sample_plan(session)?;
    steps::check_frames(ledger, &plan, "capture SESSION")?;
    steps::warn(ledger, "measurement")?;
    let grid = &session.config.sample.grid;
    let ([nx, ny, _], [hx, hy, _]) = (grid.cells(), grid.spacing_mm());
    if found.irradiance.len() != nx * ny {
        let error = format!(
            "calibration/calibration.json: holds {} cells of the lit face, session.toml has a grid of {nx} × {ny}",
            found.irradiance.len()
        );
        let command = session.command("calibrate all SESSION --force");
        let hint = format!("calibrate again: {command}");
        return Err(Failure::input(error).hint(hint));
    }
    let times = session.sample_bracket_s();
    let sensor = Sensor::of(session)?;
    let source = sensor.source(&times);
    eprintln!("noise: {source}");
    let merged =
        |shot: &Shot| merge_shot(session, &shot.name, &shot.exposures_s, &found.response, &sensor);
    let dark = plan.shots.iter().find(|s| s.name == BLACK_SHOT);
    let black = merged(dark.ok_or_else(|| Failure::other("a plan without black"))?)?;
    let shots: Vec<_> = plan
        .shots
        .iter()
        .filter(|s| matches!(s.purpose, Purpose::Fit | Purpose::HeldOut | Purpose::Surface))
        .collect();
    let mut progress = Progress::new("merge", shots.len());
    let mut patterns = Vec::new();
    for (done, shot) in shots.iter().enumerate() {
        if STOP.load(Ordering::Relaxed) {
            return Err(Failure::other("interrupted").hint("run the same command again"));
        }
        progress.set(done, &shot.name);
        let light = subtract(merged(shot)?, &black);
        keep(&shot.name, &light)?;
        let map = rectify(&light, &found.front, [nx, ny], [hx, hy])?;
        let face = nx * ny;
        let irradiance = adaptive::irradiance(shot, &found, [nx, ny])?;
        let channel = |values: &[f32], c: usize, power: i32| -> Vec<f64> {
            let unit = (std::f64::consts::PI * found.white[c]).powi(power);
            values[c * face..(c + 1) * face].iter().map(|v| f64::from(*v) / unit).collect()
        };
        let radiance = (0..3).map(|c| channel(&map.radiance, c, 1)).collect();
        let variance = (0..3).map(|c| channel(&map.variance, c, 2)).collect();
        let named = (shot.name.clone(), shot.purpose);
        let place = (session.config.sample.lit_face, [nx, ny]);
        patterns.push(MeasuredPattern::new(named, place, irradiance, radiance, variance));
    }
    let channels = CHANNELS.map(str::to_owned).to_vec();
    let measured = Measured { patterns, cells: [nx, ny], channels };
    progress.finish(&counted(measured.patterns.len(), "pattern"));
    Ok((measured, source))
}
