//! Mitsuba 3: grid volumes (`.vol`), and a scene that renders them.
//!
//! Mitsuba's frame is the renderers' of [`ScatteringMedium`]: z points at the camera.

mod volume;

use std::path::{Path, PathBuf};

pub use volume::GridVolume;

use crate::{FileError, Overwrite, ScatteringMedium};

/// Writes the material into `folder` as `sigma_t.vol` and `albedo.vol`, which Mitsuba's
/// heterogeneous medium takes (with an isotropic phase function), and `sigma_a.vol` and
/// `sigma_s.vol` (σs') for others. Coefficients per scene unit.
///
/// # Errors
/// Another number of channels than 1 or 3; one of the files is there already and `overwrite`
/// refuses; the system does. Nothing is written in the first two cases.
pub fn export(
    folder: &Path,
    medium: &ScatteringMedium<'_>,
    overwrite: Overwrite,
) -> Result<Vec<PathBuf>, FileError> {
    type Quantity = fn((f64, f64)) -> f64;
    const VOLUMES: [(&str, Quantity); 4] = [
        ("sigma_t.vol", |(a, s)| a + s),
        ("albedo.vol", |(a, s)| s / (a + s)),
        ("sigma_a.vol", |(a, _)| a),
        ("sigma_s.vol", |(_, s)| s),
    ];
    let channels = medium.one_or_three(folder, "Mitsuba")?;
    let files: Vec<PathBuf> = VOLUMES.iter().map(|(name, _)| folder.join(name)).collect();
    if overwrite == Overwrite::Refuse
        && let Some(path) = files.iter().find(|file| file.symlink_metadata().is_ok())
    {
        return Err(FileError::Exists { path: path.clone() });
    }
    for (file, (_, quantity)) in files.iter().zip(VOLUMES) {
        let value = |c, i| quantity(medium.sigma(c, i)) as f32;
        GridVolume::of(medium, channels, value).write(file, overwrite)?;
    }
    Ok(files)
}
