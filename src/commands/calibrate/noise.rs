//! `diaphane calibrate noise`: what the sensor adds to the light, from flat and dark frames.

use super::all::described;
use super::frames::frame_and_time;
use crate::Failure;
use crate::exposures::{by_time, exposures};
use crate::output::{Done, check_input_folder, check_output, output_beside};
use crate::sensor::{CURVED, NOISE};
use crate::session::Session;
use calibration::{
    Estimate, ExposureTable, Photo, PhotonTransfer, is_raw, list_pictures, read_raw,
};
use material::{Overwrite, atomic_write};
use rig::{Target, frame_path};
use serde_json::json;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A frame of which more than this is saturated is left out.
const CLIPPED_SHARE: f64 = 1e-3;

/// Measure a linear camera's gain, read noise, black level, dark current and full well
#[derive(clap::Args)]
#[command(
    after_help = "Take two pictures of an evenly lit white at each of five or more brightnesses, from dark to\njust below saturation, and two with the lens covered at each of two or more exposure times.\n\nExamples:\n  diaphane capture my-wax --noise && diaphane calibrate noise my-wax\n  diaphane calibrate noise --flats flats --darks darks --exposures times.txt"
)]
pub(crate) struct Args {
    /// A session with the frames of `diaphane capture SESSION --noise`; its merges then use what
    /// is measured
    #[arg(conflicts_with_all = ["flats", "darks", "exposures", "output"])]
    session: Option<PathBuf>,
    /// Folder of flat frames; by name, each two in a row are one brightness
    #[arg(long, requires = "darks")]
    flats: Option<PathBuf>,
    /// Folder of dark frames, two of each exposure time
    #[arg(long, requires = "flats")]
    darks: Option<PathBuf>,
    /// Exposure times of the dark frames, where EXIF does not tell: lines of "file-name seconds"
    #[arg(long, requires = "darks")]
    exposures: Option<PathBuf>,
    /// Code from which on the sensor is full, DN; if not given, full scale, or white as raw files have it
    #[arg(long)]
    saturation: Option<f64>,
    /// The noise model to write; noise.json beside the flat frames if not given
    #[arg(long)]
    output: Option<PathBuf>,
    /// Replace a noise model that is there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let mut warnings = Vec::new();
    let (transfer, output) = match (&args.session, &args.flats, &args.darks) {
        (Some(folder), ..) => {
            let session = Session::open(folder)?;
            session.refuse_existing(NOISE, overwrite)?;
            (of_session(&session, args.saturation)?, session.result(NOISE)?)
        }
        (None, Some(flats), Some(darks)) => {
            let output = output_beside(args.output.as_deref(), flats, "noise.json", "--flats")?;
            check_output(&output, overwrite)?;
            check_input_folder(flats, "--flats")?;
            check_input_folder(darks, "--darks")?;
            (of_folders(args, flats, darks, &mut warnings)?, output)
        }
        _ => {
            let error = "expected a SESSION or --flats DIR and --darks DIR, found neither";
            return Err(Failure::input(error).hint(
                "diaphane calibrate noise my-wax, or: diaphane calibrate noise --flats flats --darks darks",
            ));
        }
    };
    let found = transfer.finish().map_err(|error| {
        Failure::input(error).hint(
            "take two pictures at each of five or more brightnesses, and two with the lens covered",
        )
    })?;
    if found.reduced_chi2 > CURVED {
        let warning = format!(
            "variance over signal is no line (reduced χ² {:.1}): the pictures are not linear, or the light flickers",
            found.reduced_chi2
        );
        eprintln!("warning: {warning}");
        warnings.push(warning);
    }
    let text = serde_json::to_string_pretty(&found).map_err(Failure::other)?;
    atomic_write(&output, overwrite, |out| out.write_all(text.as_bytes()))?;
    let told = |e: Estimate| format!("{:.4} ± {:.4}", e.value, e.sigma);
    let text = format!(
        "{}\ngain        {} electrons/DN\nread noise  {} electrons\nblack level {} DN\ndark current {}\nfull well   {:.0} ± {:.0} electrons",
        output.display(),
        told(found.electrons_per_dn),
        told(found.read_noise_e),
        told(found.black_level_dn),
        found.dark_current_dn_s.map_or("unknown: dark frames of one exposure time".into(), |d| {
            format!("{} DN/s", told(d))
        }),
        found.full_well_e.value,
        found.full_well_e.sigma,
    );
    let json = json!({
        "output": output,
        "electrons_per_dn": found.electrons_per_dn,
        "read_noise_e": found.read_noise_e,
        "black_level_dn": found.black_level_dn,
        "dark_current_dn_s": found.dark_current_dn_s,
        "full_well_e": found.full_well_e,
        "reduced_chi2": found.reduced_chi2,
        "pairs": found.points.len(),
        "warnings": warnings,
    });
    Ok(Done::new(json, text))
}

/// Pairs of pictures from two folders.
fn of_folders(
    args: &Args,
    flats: &Path,
    darks: &Path,
    warnings: &mut Vec<String>,
) -> Result<PhotonTransfer, Failure> {
    let flats = list_pictures(flats)?;
    let saturation = match (args.saturation, flats.first().filter(|path| is_raw(path))) {
        (None, Some(raw)) => Some(f64::from(read_raw(raw)?.white_level)),
        (told, _) => told,
    };
    let mut transfer = PhotonTransfer::new(saturation);
    for pair in flats.chunks(2) {
        let [one, other] = pair else {
            return Err(alone(&pair[0], "flat frame"));
        };
        transfer.add_flats(&Photo::load_codes(one)?, &Photo::load_codes(other)?)?;
    }
    let table = args.exposures.as_ref().map(ExposureTable::load).transpose()?;
    let darks = exposures(darks, table.as_ref(), warnings)?;
    for (_, frames) in by_time(&darks) {
        if let [only] = frames[..] {
            return Err(alone(&only.path, "dark frame of its exposure time"));
        }
        for pair in frames.chunks_exact(2) {
            let [one, other] = [pair[0], pair[1]];
            let photos = [Photo::load_codes(&one.path)?, Photo::load_codes(&other.path)?];
            transfer.add_darks(&photos[0], &photos[1], one.seconds)?;
        }
    }
    Ok(transfer)
}

/// Pairs of frames that a session took.
fn of_session(session: &Session, saturation: Option<f64>) -> Result<PhotonTransfer, Failure> {
    let described = described(session)?.1;
    let saturation = saturation.unwrap_or(described.saturation);
    let mut transfer = PhotonTransfer::new(Some(saturation));
    let plan = session.acquisition().noise_plan();
    for shot in &plan.shots {
        for e in 0..shot.exposures_s.len() {
            let frame = |repeat: u32| {
                frame_and_time(session, &shot.name, e, repeat).map_err(|failure| {
                    let command = session.command("capture SESSION --noise");
                    failure.hint(format!("take them with: {command}"))
                })
            };
            let ((mut one, seconds), (mut other, _)) = (frame(0)?, frame(1)?);
            for (repeat, photo) in [(0, &mut one), (1, &mut other)] {
                photo.name = frame_path(&shot.name, e, repeat);
            }
            match shot.target {
                Target::Dark => transfer.add_darks(&one, &other, seconds)?,
                // The longest exposures may be more than the sensor holds: nothing to learn there.
                _ if clipped_share(&one, saturation) > CLIPPED_SHARE => {}
                _ => transfer.add_flats(&one, &other)?,
            }
        }
    }
    Ok(transfer)
}

fn clipped_share(photo: &Photo, saturation: f64) -> f64 {
    let clipped = photo.data.iter().filter(|v| f64::from(**v) >= saturation).count();
    clipped as f64 / photo.data.len().max(1) as f64
}

fn alone(path: &Path, what: &str) -> Failure {
    Failure::input(format!("{}: the only {what} without a second one", path.display()))
        .hint("noise is what two pictures of the same differ by: take two of each")
}
