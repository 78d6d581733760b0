//! A folder of photographs with their exposure times.

use crate::Failure;
use crate::reading::Reading;
use calibration::{
    CalibrationError, ExposureTable, MasterDark, NoiseModel, Photo, SensorNoise, exif_exposure_s,
    list_pictures,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Cameras round what they write into EXIF to the next customary time, by up to 7 %.
const ROUNDED: f64 = 0.08;

/// Pixels of each photograph that a response is learnt from.
const ENOUGH_PIXELS: usize = 1_000_000;

/// One photograph of a folder.
pub(crate) struct Exposure {
    pub path: PathBuf,
    pub name: String,
    pub seconds: f64,
}

/// The photographs of a folder, by name; times from the table, else from EXIF. Where the two
/// contradict each other the table counts and a warning is added.
pub(crate) fn exposures(
    folder: &Path,
    table: Option<&ExposureTable>,
    warnings: &mut Vec<String>,
) -> Result<Vec<Exposure>, Failure> {
    let mut out = Vec::new();
    for path in list_pictures(folder)? {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let seconds = match table {
            Some(table) => {
                let told = table.get(&name).ok_or_else(|| {
                    Failure::input(format!("{name}: not in the table of exposure times"))
                        .hint(format!("add a line \"{name} SECONDS\""))
                })?;
                if let Ok(exif) = exif_exposure_s(&path)
                    && (told / exif - 1.0).abs() > ROUNDED
                {
                    let warning = format!(
                        "{name}: the table says {told:.4} s, its EXIF data {exif:.4} s; the table is taken"
                    );
                    eprintln!("warning: {warning}");
                    warnings.push(warning);
                }
                told
            }
            None => exif_exposure_s(&path).map_err(|error| match error {
                CalibrationError::NoExposure { .. } => Failure::input(error)
                    .hint("give a table of lines \"file-name seconds\" with --exposures"),
                _ => error.into(),
            })?,
        };
        out.push(Exposure { path, name, seconds });
    }
    Ok(out)
}

/// Refuses photographs that all have one exposure time: they say nothing about it.
pub(crate) fn refuse_one_time(exposures: &[Exposure]) -> Result<(), Failure> {
    let times = by_time(exposures);
    let (Some(same), 1) = (times.values().next().filter(|same| same.len() > 1), times.len()) else {
        return Ok(());
    };
    let names: Vec<&str> = same.iter().take(4).map(|e| e.name.as_str()).collect();
    let more = same.len().checked_sub(5).map_or(String::new(), |n| format!(" and {} more", n + 1));
    let error = format!(
        "expected several exposure times, found one, {:.4} s, of {}{more}",
        same[0].seconds,
        names.join(", ")
    );
    Err(Failure::input(error).hint(
        "take the same scene at times a factor of two to four apart; where EXIF is wrong, give a \
         table with --exposures",
    ))
}

/// What a response is learnt from: tiles of each photograph, so that memory holds the bracket.
pub(crate) fn response_bracket(exposures: &[Exposure]) -> Result<Vec<(Photo, f64)>, Failure> {
    let load = |e: &Exposure| Ok((Photo::load(&e.path)?.tiles(ENOUGH_PIXELS), e.seconds));
    exposures.iter().map(load).collect()
}

/// Dark frames of a folder, read as the bracket that they are for, averaged by exposure time.
pub(crate) fn master_darks(
    exposures: &[Exposure],
    reading: &Reading,
) -> Result<Vec<MasterDark>, Failure> {
    let mut masters = Vec::new();
    for (_, frames) in by_time(exposures) {
        let seconds = frames.first().map_or(1.0, |e| e.seconds);
        let photos = frames.iter().map(|e| reading.photo(&e.path));
        masters.push(MasterDark::average(seconds, photos)?);
    }
    Ok(masters)
}

/// Exposures of one time together, to a millionth.
pub(crate) fn by_time(exposures: &[Exposure]) -> BTreeMap<u64, Vec<&Exposure>> {
    let mut groups: BTreeMap<u64, Vec<&Exposure>> = BTreeMap::new();
    for exposure in exposures {
        groups.entry((exposure.seconds * 1e6).round() as u64).or_default().push(exposure);
    }
    groups
}

/// The noise model in a file that `calibrate noise` wrote.
pub(crate) fn read_noise(path: &Path) -> Result<NoiseModel, Failure> {
    let told = path.display();
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::input(format!("{told}: cannot be read: {e}")))?;
    let found: SensorNoise = serde_json::from_str(&text).map_err(|e| {
        Failure::input(format!("{told}: expected a sensor's noise: {e}"))
            .hint("make it with: diaphane calibrate noise --flats DIR --darks DIR")
    })?;
    Ok(found.noise)
}
