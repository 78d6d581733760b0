//! Our own file: everything that a calibration found and the observations that it was solved from.

use std::io::Write;
use std::path::Path;

use material::{Overwrite, atomic_write};
use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};
use crate::geometry::result::Geometry;

/// Layout that this version writes, and the newest that it reads.
const VERSION: u32 = 1;

/// The file as it stands on disk.
#[derive(Serialize)]
struct File<'a> {
    version: u32,
    #[serde(flatten)]
    geometry: &'a Geometry,
}

/// The first thing that is read: a newer file may hold keys that mean nothing here.
#[derive(Deserialize)]
struct Version {
    version: u32,
}

/// Writes a calibration as TOML: `version`, then the fields of [`Geometry`].
///
/// # Errors
/// The file exists and is not to be replaced, or cannot be written.
pub fn write_geometry(path: &Path, geometry: &Geometry, overwrite: Overwrite) -> Result<()> {
    let file = File { version: VERSION, geometry };
    let text = toml::to_string(&file).map_err(|error| CalibrationError::BadFile {
        path: path.into(),
        expected: "numbers that TOML can hold".into(),
        found: error.to_string(),
    })?;
    Ok(atomic_write(path, overwrite, |out| out.write_all(text.as_bytes()))?)
}

/// Reads what [`write_geometry`] wrote.
///
/// # Errors
/// No such file, not TOML, a newer layout, or numbers that do not go together.
pub fn read_geometry(path: &Path) -> Result<Geometry> {
    let bad = |expected: &str, found: String| CalibrationError::BadFile {
        path: path.into(),
        expected: expected.into(),
        found,
    };
    let text = std::fs::read_to_string(path).map_err(CalibrationError::io(path))?;
    let not_toml = |e: toml::de::Error| bad("a calibration", e.to_string());
    let Version { version } = toml::from_str(&text).map_err(not_toml)?;
    if version > VERSION {
        return Err(bad(&format!("layout {VERSION} or older"), format!("layout {version}")));
    }
    // Not through `flatten`, whose buffering loses the line of a mistake.
    let mut table: toml::Table = toml::from_str(&text).map_err(not_toml)?;
    table.remove("version");
    let geometry: Geometry = table.try_into().map_err(not_toml)?;
    check(&geometry).map_err(|found| bad("a calibration whose parts go together", found))?;
    Ok(geometry)
}

/// What a hand may have broken.
fn check(geometry: &Geometry) -> std::result::Result<(), String> {
    let devices = std::iter::once(&geometry.camera)
        .chain(geometry.projector.as_ref().map(|projector| &projector.device));
    for device in devices {
        let m = &device.model;
        let finite = m.parameters().iter().all(|v| v.is_finite());
        if m.width == 0 || m.height == 0 || m.fx <= 0.0 || m.fy <= 0.0 || !finite {
            return Err("a device without size or focal length".into());
        }
        if let Some([x, y]) = m.fold() {
            return Err(format!("a distortion that folds the picture at pixel ({x:.0}, {y:.0})"));
        }
    }
    if geometry.views.len() != geometry.observations.len() {
        let (fits, seen) = (geometry.views.len(), geometry.observations.len());
        return Err(format!("{fits} fitted views of {seen} observed"));
    }
    for view in &geometry.observations {
        let board = &view.board;
        if board.image_points.len() != board.object_points.len() {
            return Err(format!("{}: unmatched points", board.name));
        }
        if view.coded.iter().any(|c| c.corner >= board.object_points.len()) {
            return Err(format!("{}: a coded corner that is not on the board", board.name));
        }
    }
    let covariance = &geometry.covariance;
    let n = covariance.parameters.len();
    if covariance.matrix.len() != n || covariance.matrix.iter().any(|row| row.len() != n) {
        return Err(format!("a covariance that is not {n} x {n}"));
    }
    Ok(())
}
