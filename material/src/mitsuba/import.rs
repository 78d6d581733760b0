//! A material out of volumes.

use std::path::Path;

use super::{ABOUT, GridVolume};
use crate::header::About;
use crate::reading::{Known, Reading, from_sigma, half_turn};
use crate::{FileError, Grid, SceneUnit};

/// Reads a material from one of the volumes that [`export`](super::export) writes and its
/// neighbours: `sigma_a.vol` and `sigma_s.vol`, or `sigma_t.vol` and `albedo.vol`, and what
/// `about.json` says, if it is there.
///
/// # Errors
/// A volume is missing, damaged, or does not fit the other; the values are no material's.
pub fn read(path: &Path) -> Result<Reading, FileError> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let pairs = [("sigma_a.vol", "sigma_s.vol"), ("sigma_t.vol", "albedo.vol")];
    let pair = pairs.into_iter().find(|(first, second)| [first, second].contains(&&name));
    let (first_name, second_name) = pair.ok_or_else(|| {
        let names = "sigma_a.vol and sigma_s.vol, or sigma_t.vol and albedo.vol, side by side";
        FileError::malformed(path, format!("a material is two volumes: {names}"))
    })?;
    let volume = |name: &str| GridVolume::read(&path.with_file_name(name));
    let (first, second) = (volume(first_name)?, volume(second_name)?);
    if (first.cells, first.channels) != (second.cells, second.channels) {
        let found = format!("{:?} and {}", second.cells, second.channels);
        let expected = format!("{:?} cells and {} channels", first.cells, first.channels);
        let reason = format!("{second_name}: expected {expected}, found {found}");
        return Err(FileError::malformed(path, reason));
    }
    let about = path.with_file_name(ABOUT);
    let (known, unit_mm) = match about.is_file() {
        true => told(&about, &first)?,
        false => assumed(path, &first)?,
    };
    let (first, second) = (channels(&first), channels(&second));
    let [kappa, mu] = if first_name == "sigma_a.vol" {
        from_sigma(&first, &second, unit_mm)
    } else {
        let part = |of: fn(f32, f32) -> f32| {
            let pairs = first.iter().zip(&second);
            pairs.map(|(t, a)| t.iter().zip(a).map(|(&t, &a)| of(t, a)).collect()).collect()
        };
        let absorption: Vec<Vec<f32>> = part(|t, a| t * (1.0 - a));
        from_sigma(&absorption, &part(|t, a| t * a), unit_mm)
    };
    known.material(path, kappa, mu)
}

fn told(path: &Path, volume: &GridVolume) -> Result<(Known, f64), FileError> {
    let json = std::fs::read(path).map_err(FileError::reading(path))?;
    let malformed = |reason: String| FileError::malformed(path, reason);
    let about: About = serde_json::from_slice(&json)
        .map_err(|e| malformed(format!("cannot be understood: {e}")))?;
    let unit: SceneUnit = about.scene_unit.parse().map_err(malformed)?;
    let (cells, count) = (about.header.grid.cells(), about.header.channels.len());
    if cells != volume.cells || count != volume.channels {
        let found = format!("{:?} and {}", volume.cells, volume.channels);
        let expected = format!("{cells:?} cells and {count} channels");
        return Err(malformed(format!("it is about {expected}, the volumes have {found}")));
    }
    Ok((Known { header: about.header, assumed: Vec::new() }, unit.millimetres()))
}

fn assumed(path: &Path, volume: &GridVolume) -> Result<(Known, f64), FileError> {
    if ![1, 3].contains(&volume.channels) {
        let reason = format!("expected 1 or 3 channels, found {}", volume.channels);
        return Err(FileError::malformed(path, reason));
    }
    let [low, high] = volume.bounds;
    let spacing = [0, 1, 2]
        .map(|axis| (f64::from(high[axis]) - f64::from(low[axis])) / volume.cells[axis] as f64);
    let grid =
        Grid::new(volume.cells, spacing).map_err(|e| FileError::malformed(path, e.to_string()))?;
    let mut known = Known::nothing(grid, volume.channels);
    known.assumed.push("1 in the scene is 1 mm".into());
    Ok((known, SceneUnit::Millimetre.millimetres()))
}

/// Channel by channel, in the sample's frame.
fn channels(volume: &GridVolume) -> Vec<Vec<f32>> {
    let values = |c: usize| volume.data.iter().skip(c).step_by(volume.channels).copied();
    (0..volume.channels).map(|c| half_turn(volume.cells, &values(c).collect::<Vec<_>>())).collect()
}
