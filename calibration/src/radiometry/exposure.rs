//! How long the shutter was open: from EXIF, or from a table beside the pictures.

use std::collections::BTreeMap;
use std::path::Path;

use exif::{In, Tag, Value};
use raw::is_raw;

use crate::error::{CalibrationError, Result};

/// The exposure time in seconds that a camera wrote into its JPEG, TIFF or raw file.
///
/// # Errors
/// The file is unreadable, has no EXIF data, or no positive exposure time in it.
pub fn exif_exposure_s(path: impl AsRef<Path>) -> Result<f64> {
    let path = path.as_ref();
    let missing =
        |reason: String| CalibrationError::NoExposure { path: path.to_path_buf(), reason };
    if is_raw(path) {
        let noted = raw::exposure_s(path)?;
        return noted.ok_or_else(|| missing("no positive ExposureTime field".into()));
    }
    let file = std::fs::File::open(path).map_err(CalibrationError::io(path))?;
    let data = exif::Reader::new()
        .read_from_container(&mut std::io::BufReader::new(file))
        .map_err(|error| missing(error.to_string()))?;
    let field = data
        .get_field(Tag::ExposureTime, In::PRIMARY)
        .ok_or_else(|| missing("no ExposureTime field".into()))?;
    match &field.value {
        Value::Rational(times) => times
            .first()
            .map(|time| time.to_f64())
            .filter(|t| t.is_finite() && *t > 0.0)
            .ok_or_else(|| missing("its ExposureTime is not a positive number".into())),
        other => Err(missing(format!("its ExposureTime is {other:?}"))),
    }
}

/// Exposure times by file name, read from text: `file-name seconds` on each line,
/// where seconds may be a fraction such as `1/30`; `#` begins a comment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExposureTable {
    seconds: BTreeMap<String, f64>,
}

impl ExposureTable {
    /// Reads a table.
    ///
    /// # Errors
    /// The file is unreadable, or a line (named by its number) is not a file name and a time,
    /// or a name occurs twice.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(CalibrationError::io(path))?;
        let mut seconds = BTreeMap::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or("").trim();
            if line.is_empty() {
                continue;
            }
            let bad = |found: String| CalibrationError::BadFile {
                path: path.to_path_buf(),
                expected: format!("`file-name seconds` on line {}", number + 1),
                found,
            };
            let (name, time) =
                line.rsplit_once(char::is_whitespace).ok_or_else(|| bad(format!("{line:?}")))?;
            let time = parse_seconds(time).ok_or_else(|| bad(format!("{line:?}")))?;
            if seconds.insert(name.trim().to_owned(), time).is_some() {
                return Err(bad(format!("{:?} a second time", name.trim())));
            }
        }
        Ok(Self { seconds })
    }

    /// The exposure time of a picture by its file name, seconds.
    pub fn get(&self, file_name: &str) -> Option<f64> {
        self.seconds.get(file_name).copied()
    }
}

/// Reads `0.125`, `1/30` or either with a trailing `s`, as positive seconds.
pub fn parse_seconds(text: &str) -> Option<f64> {
    let text = text.trim().trim_end_matches('s').trim_end();
    let value = match text.split_once('/') {
        Some((a, b)) => a.trim().parse::<f64>().ok()? / b.trim().parse::<f64>().ok()?,
        None => text.parse().ok()?,
    };
    (value.is_finite() && value > 0.0).then_some(value)
}
