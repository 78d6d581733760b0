//! A material out of grids.

use std::path::Path;

use super::export::UNIT;
use super::reader::{Grid, VdbFile};
use super::tree::Region;
use crate::header::KEY;
use crate::reading::{Known, Reading, from_sigma, half_turn};
use crate::{FileError, SceneUnit};

/// Reads a material from the bytes of a file; `path` is for messages.
///
/// It takes the grids `kappa` and `mu`, as [`write`](super::write) leaves them; where these are
/// missing, `sigma_a` and `sigma_s`. Files that other programs saved again are read too, if they
/// are not compressed with Blosc: where all metadata is lost, the active voxels are the block and
/// `assumed` says the rest.
///
/// # Errors
/// Something else than an OpenVDB file of the formats 222 to 224, a truncated or damaged one,
/// other grids, or grids that are no material.
pub fn read(bytes: &[u8], path: &Path) -> Result<Reading, FileError> {
    let malformed = |reason| FileError::malformed(path, reason);
    let file = VdbFile::open(bytes).map_err(malformed)?;
    let first = ["kappa", "sigma_a"].map(|name| file.grid(name));
    let (pair, first) = match first {
        [Some(kappa), _] => (["kappa", "mu"], kappa),
        [None, Some(sigma_a)] => (["sigma_a", "sigma_s"], sigma_a),
        [None, None] => return Err(missing(path, "kappa", &file)),
    };
    let first = first.map_err(malformed)?;
    let second = file.grid(pair[1]).ok_or_else(|| missing(path, pair[1], &file))?;
    let second = second.map_err(malformed)?;
    if first.width != second.width {
        let (a, b) = (first.width, second.width);
        let [one, other] = pair;
        return Err(malformed(format!("{one} has {a} numbers a voxel, {other} has {b}")));
    }
    let about = |name: &str| file.metadata.get(name).or_else(|| first.metadata.get(name)).cloned();
    let (known, region, unit_mm) = place(&first, about(KEY), about(UNIT)).map_err(malformed)?;
    let volumes = |grid: Grid<'_>, name: &str| {
        let values = grid.dense(region).map_err(|e| malformed(format!("grid {name:?}: {e}")))?;
        let cells = known.header.grid.cells();
        let turned = |values: &[f32]| half_turn(cells, values);
        Ok(values.chunks_exact(known.header.grid.len()).map(turned).collect::<Vec<_>>())
    };
    let (first, second) = (volumes(first, pair[0])?, volumes(second, pair[1])?);
    let [kappa, mu] = match pair[0] {
        "kappa" => [first, second],
        _ => from_sigma(&first, &second, unit_mm),
    };
    known.material(path, kappa, mu)
}

/// What is known of the material, which voxels are its block, and the scene's unit in mm.
fn place(
    grid: &Grid<'_>,
    header: Option<String>,
    unit: Option<String>,
) -> Result<(Known, Region, f64), String> {
    let told_unit = unit.map(|unit| unit.parse::<SceneUnit>()).transpose()?;
    let unit_mm = told_unit.unwrap_or_default().millimetres();
    if let Some(header) = header {
        let known = Known::told(header.as_bytes())?;
        let channels = known.header.channels.len();
        if channels != grid.width {
            let width = grid.width;
            return Err(format!("expected {channels} channels, found {width} numbers a voxel"));
        }
        let cells = known.header.grid.cells();
        let region = Region::around(cells, 0).ok_or("more cells than can be counted")?;
        return Ok((known, region, unit_mm));
    }
    let region = grid.extent().ok_or("no voxel is active")?;
    let cells = region.size().map(|n| usize::try_from(n).unwrap_or(usize::MAX));
    let spacing_mm = grid.spacing.map(|h| h * unit_mm);
    let block = crate::Grid::new(cells, spacing_mm).map_err(|e| e.to_string())?;
    let mut known = Known::nothing(block, grid.width);
    if told_unit.is_none() {
        known.assumed.push("1 in the scene is 1 mm".into());
    }
    Ok((known, region, unit_mm))
}

fn missing(path: &Path, name: &str, file: &VdbFile<'_>) -> FileError {
    FileError::MissingArray { path: path.into(), name: name.into(), available: file.names() }
}
