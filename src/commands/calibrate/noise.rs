//! `diaphane calibrate noise`: what the sensor adds to the light, from flat and dark frames.

use crate::Failure;
use crate::exposures::{by_time, exposures};
use crate::output::Done;
use calibration::{
    Estimate, ExposureTable, Photo, PhotonTransfer, is_raw, list_pictures, read_raw,
};
use material::{Overwrite, atomic_write};
use serde_json::json;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Beyond this the points do not lie on a line: the camera is not linear.
const CURVED: f64 = 5.0;

/// Measure a linear camera's gain, read noise, black level, dark current and full well
#[derive(clap::Args)]
#[command(
    after_help = "Take two pictures of an evenly lit white at each of five or more brightnesses, from dark to\njust below saturation, and two with the lens covered at each of two or more exposure times.\n\nExample:\n  diaphane calibrate noise --flats flats --darks darks --exposures times.txt"
)]
pub(crate) struct Args {
    /// Folder of flat frames; by name, each two in a row are one brightness
    #[arg(long)]
    flats: PathBuf,
    /// Folder of dark frames, two of each exposure time
    #[arg(long)]
    darks: PathBuf,
    /// Exposure times of the dark frames, where EXIF does not tell: lines of "file-name seconds"
    #[arg(long)]
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
    let flats = list_pictures(&args.flats)?;
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
    let darks = exposures(&args.darks, table.as_ref(), &mut warnings)?;
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
    let found = transfer.finish()?;
    if found.reduced_chi2 > CURVED {
        let warning = format!(
            "variance over signal is no line (reduced χ² {:.1}): the pictures are not linear, or the light flickers",
            found.reduced_chi2
        );
        eprintln!("warning: {warning}");
        warnings.push(warning);
    }
    let output = args.output.clone().unwrap_or_else(|| args.flats.join("noise.json"));
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

fn alone(path: &Path, what: &str) -> Failure {
    Failure::input(format!("{}: the only {what} without a second one", path.display()))
        .hint("noise is what two pictures of the same differ by: take two of each")
}
