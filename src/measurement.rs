//! What the solver works from: radiance and irradiance on the sample's grid, one map a pattern.

use crate::Failure;
use crate::session::Session;
use crate::steps::Ledger;
use material::{Face, Input, Overwrite, hash_file, npz};
use rig::Purpose;
use serde::{Deserialize, Serialize};

/// Where it is kept in a session.
pub(crate) const ARRAYS: &str = "measurement/measurement.npz";
pub(crate) const INDEX: &str = "measurement/measurement.json";

/// Names of the channels, in order.
pub(crate) const CHANNELS: [&str; 3] = ["R", "G", "B"];

/// Radiance and irradiance of every pattern, on the grid of the session.
///
/// Radiance in the unit of design section 2: a white Lambertian plane under projector white has
/// 1/π. Maps hold nx × ny values, x fastest, in the sample frame.
#[derive(Clone, Debug)]
pub(crate) struct Measured {
    pub patterns: Vec<MeasuredPattern>,
    /// Cells of the front face.
    pub cells: [usize; 2],
    pub channels: Vec<String>,
}

/// One pattern.
#[derive(Clone, Debug)]
pub(crate) struct MeasuredPattern {
    pub name: String,
    pub held_out: bool,
    /// On the lit face; 1 is projector white on average over the face.
    pub irradiance: Vec<f64>,
    /// `[channel][cell]` on the front face.
    pub radiance: Vec<Vec<f64>>,
    /// Infinite where masked.
    pub variance: Vec<Vec<f64>>,
}

#[derive(Serialize, Deserialize)]
struct Index {
    cells: [usize; 2],
    channels: Vec<String>,
    patterns: Vec<IndexEntry>,
    /// What it was made from; empty where that is outside of the session.
    #[serde(default)]
    inputs: Vec<Input>,
    /// BLAKE3 of the arrays' file; None in files from before it was noted.
    #[serde(default)]
    arrays: Option<String>,
}

/// What a measurement says of itself.
pub(crate) struct MadeFrom {
    pub cells: [usize; 2],
    pub inputs: Vec<Input>,
}

/// What a session's measurement was made from.
///
/// # Errors
/// It is not whole.
pub(crate) fn made_from(ledger: &Ledger<'_>) -> Result<MadeFrom, Failure> {
    let session = ledger.session;
    let index: Index = session.read_json(INDEX, "diaphane merge SESSION")?;
    if let Some(expected) = &index.arrays {
        if ledger.file(ARRAYS).blake3.as_ref() != Some(expected) {
            let path = session.path(ARRAYS).display().to_string();
            let error = format!("{path}: its content is not what was written, {INDEX} says");
            return Err(Failure::input(error));
        }
    } else {
        npz::NpzReader::open(&session.path(ARRAYS))?;
    }
    Ok(MadeFrom { cells: index.cells, inputs: index.inputs })
}

#[derive(Serialize, Deserialize)]
struct IndexEntry {
    name: String,
    purpose: Purpose,
}

impl Measured {
    /// Writes it, with what it was made from.
    pub fn save(
        &self,
        session: &Session,
        inputs: Vec<Input>,
        overwrite: Overwrite,
    ) -> Result<(), Failure> {
        let [nx, ny] = self.cells;
        let (m, c) = (self.patterns.len(), self.channels.len());
        let flat = |pick: &dyn Fn(&MeasuredPattern) -> Vec<f32>| -> Vec<f32> {
            self.patterns.iter().flat_map(pick).collect()
        };
        let narrow =
            |maps: &[Vec<f64>]| -> Vec<f32> { maps.iter().flatten().map(|v| *v as f32).collect() };
        let radiance = flat(&|p| narrow(&p.radiance));
        let variance = flat(&|p| narrow(&p.variance));
        let irradiance = flat(&|p| p.irradiance.iter().map(|v| *v as f32).collect());
        let path = session.result(ARRAYS)?;
        npz::write(&path, overwrite, |npz| {
            npz.array_f32("radiance", &[m, c, ny, nx], &radiance)?;
            npz.array_f32("variance", &[m, c, ny, nx], &variance)?;
            npz.array_f32("irradiance", &[m, ny, nx], &irradiance)
        })?;
        let entry = |p: &MeasuredPattern| IndexEntry {
            name: p.name.clone(),
            purpose: if p.held_out { Purpose::HeldOut } else { Purpose::Fit },
        };
        let patterns = self.patterns.iter().map(entry).collect();
        let (cells, channels) = (self.cells, self.channels.clone());
        let index = Index { cells, channels, patterns, inputs, arrays: Some(hash_file(&path)?) };
        session.write_json(INDEX, &index, overwrite).map(|_| ())
    }

    pub fn load(session: &Session) -> Result<Self, Failure> {
        let make = match session.config.rig {
            crate::session::RigConfig::Imported => {
                "diaphane import SESSION --images DIR --manifest m.toml"
            }
            _ => "diaphane merge SESSION",
        };
        let words = make.trim_start_matches("diaphane ");
        let again = || format!("measure again: {} --force", session.command(words));
        let arrays = session.required(ARRAYS, make)?;
        let index: Index = session.read_json(INDEX, make)?;
        let [nx, ny] = index.cells;
        let (m, c) = (index.patterns.len(), index.channels.len());
        let grid = session.config.sample.grid;
        if grid.cells()[..2] != index.cells {
            let error = format!(
                "{}: holds maps of {nx} × {ny} cells, session.toml has a grid of {:?}",
                arrays.display(),
                grid.cells()
            );
            return Err(Failure::input(error).hint(again()));
        }
        let bad = |e: material::FileError| Failure::from(e).hint(again());
        let mut npz = npz::NpzReader::open(&arrays).map_err(bad)?;
        let radiance = npz.shaped("radiance", &[m, c, ny, nx]).map_err(bad)?;
        let variance = npz.shaped("variance", &[m, c, ny, nx]).map_err(bad)?;
        let irradiance = npz.shaped("irradiance", &[m, ny, nx]).map_err(bad)?;
        let face = nx * ny;
        let maps = |values: &[f64], pattern: usize| -> Vec<Vec<f64>> {
            (0..c).map(|k| values[(pattern * c + k) * face..][..face].to_vec()).collect()
        };
        let pattern = |(i, entry): (usize, IndexEntry)| MeasuredPattern {
            name: entry.name,
            held_out: entry.purpose == Purpose::HeldOut,
            irradiance: irradiance[i * face..][..face].to_vec(),
            radiance: maps(&radiance, i),
            variance: maps(&variance, i),
        };
        let patterns = index.patterns.into_iter().enumerate().map(pattern).collect();
        Ok(Self { patterns, cells: index.cells, channels: index.channels })
    }

    /// The patterns that are fitted (false) or held out (true).
    pub fn select(&self, held_out: bool) -> Vec<&MeasuredPattern> {
        self.patterns.iter().filter(|p| p.held_out == held_out).collect()
    }
}

/// Masks pixels that are lit directly, where a front-lit surface reflects: their variance becomes
/// infinite. A cell next to a lit one is masked too, since a lens spreads light.
pub(crate) fn mask_lit(
    lit_face: Face,
    [nx, ny]: [usize; 2],
    irradiance: &[f64],
    variance: &mut [Vec<f64>],
) {
    if lit_face != Face::Front {
        return;
    }
    let threshold = 0.01 * irradiance.iter().copied().fold(0.0, f64::max);
    for y in 0..ny {
        for x in 0..nx {
            let near = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
            let lit =
                near(y, ny).any(|yy| near(x, nx).any(|xx| irradiance[yy * nx + xx] > threshold));
            if lit {
                variance.iter_mut().for_each(|map| map[y * nx + x] = f64::INFINITY);
            }
        }
    }
}
