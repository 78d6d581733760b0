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
    /// Fit, held out, or for the surface.
    pub purpose: Purpose,
    /// On the lit face; 1 is projector white on average over the face.
    pub irradiance: Vec<f64>,
    /// `[channel][cell]` on the front face.
    pub radiance: Vec<Vec<f64>>,
    /// Infinite where masked, and where the front face is lit directly: what is left shows multiple
    /// scattering alone.
    pub variance: Vec<Vec<f64>>,
    /// The rest of it: of pixels that are lit directly, infinite everywhere else.
    pub lit_variance: Vec<Vec<f64>>,
}

impl MeasuredPattern {
    /// A pattern from all of its pixels; on a front-lit face those that are lit directly are told
    /// apart from the others.
    pub fn new(
        (name, purpose): (String, Purpose),
        (lit_face, cells): (Face, [usize; 2]),
        irradiance: Vec<f64>,
        radiance: Vec<Vec<f64>>,
        variance: Vec<Vec<f64>>,
    ) -> Self {
        let lit = lit_directly(lit_face, cells, &irradiance);
        let part = |wanted: bool| -> Vec<Vec<f64>> {
            let keep = |(v, lit): (&f64, &bool)| if *lit == wanted { *v } else { f64::INFINITY };
            variance.iter().map(|map| map.iter().zip(&lit).map(keep).collect()).collect()
        };
        let (lit_variance, variance) = (part(true), part(false));
        Self { name, purpose, irradiance, radiance, variance, lit_variance }
    }

    /// Whether it is kept out of the fit to check it.
    pub fn held_out(&self) -> bool {
        self.purpose == Purpose::HeldOut
    }

    /// Variance of all pixels, `[channel][cell]`; infinite where masked.
    pub fn whole_variance(&self) -> Vec<Vec<f64>> {
        let least = |(a, b): (&f64, &f64)| a.min(*b);
        let map = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(least).collect();
        self.variance.iter().zip(&self.lit_variance).map(map).collect()
    }
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
        let variance = flat(&|p| narrow(&p.whole_variance()));
        let irradiance = flat(&|p| p.irradiance.iter().map(|v| *v as f32).collect());
        let path = session.result(ARRAYS)?;
        npz::write(&path, overwrite, |npz| {
            npz.array_f32("radiance", &[m, c, ny, nx], &radiance)?;
            npz.array_f32("variance", &[m, c, ny, nx], &variance)?;
            npz.array_f32("irradiance", &[m, ny, nx], &irradiance)
        })?;
        let entry = |p: &MeasuredPattern| IndexEntry { name: p.name.clone(), purpose: p.purpose };
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
        let place = (session.config.sample.lit_face, index.cells);
        let pattern = |(i, entry): (usize, IndexEntry)| {
            let irradiance = irradiance[i * face..][..face].to_vec();
            let (radiance, variance) = (maps(&radiance, i), maps(&variance, i));
            let named = (entry.name, entry.purpose);
            MeasuredPattern::new(named, place, irradiance, radiance, variance)
        };
        let patterns = index.patterns.into_iter().enumerate().map(pattern).collect();
        Ok(Self { patterns, cells: index.cells, channels: index.channels })
    }

    /// The patterns of a purpose.
    pub fn select(&self, purpose: Purpose) -> Vec<&MeasuredPattern> {
        self.patterns.iter().filter(|p| p.purpose == purpose).collect()
    }
}

/// Which cells of the front face are lit directly: what they show is not multiple scattering alone.
/// None where the block is lit from behind. A cell next to a lit one counts too, since a lens
/// spreads light.
pub(crate) fn lit_directly(lit_face: Face, [nx, ny]: [usize; 2], irradiance: &[f64]) -> Vec<bool> {
    if lit_face != Face::Front {
        return vec![false; nx * ny];
    }
    // In the precision of the file, so that a measurement that was read has the cells of the one
    // that was written.
    let brightest = irradiance.iter().map(|e| *e as f32).fold(0.0, f32::max);
    let lit = |i: usize| irradiance[i] as f32 > 0.01 * brightest;
    let near = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
    let cell = |i: usize| {
        let (x, y) = (i % nx, i / nx);
        near(y, ny).any(|y| near(x, nx).any(|x| lit(y * nx + x)))
    };
    (0..nx * ny).map(cell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each pixel is in one of the two parts, and both together are what came in.
    #[test]
    fn lit_pixels_and_the_others_are_told_apart() {
        let irradiance = [0.005, 0.0, 0.0, 0.0, 0.02, 1.0];
        let variance = vec![vec![1.0, 2.0, f64::INFINITY, 4.0, f64::INFINITY, 6.0]];
        let on = |face, irradiance: &[f64]| {
            let named = ("p".into(), Purpose::Fit);
            let radiance = vec![vec![0.5; 6]];
            MeasuredPattern::new(
                named,
                (face, [6, 1]),
                irradiance.into(),
                radiance,
                variance.clone(),
            )
        };
        let front = on(Face::Front, &irradiance);
        let none = f64::INFINITY;
        // A hundredth of the brightest is none; the fourth is next to a lit one.
        assert_eq!(front.variance, [[1.0, 2.0, none, none, none, none]]);
        assert_eq!(front.lit_variance, [[none, none, none, 4.0, none, 6.0]]);
        assert_eq!(front.whole_variance(), variance);
        let back = on(Face::Back, &irradiance);
        assert_eq!((&back.variance, &back.lit_variance), (&variance, &vec![vec![none; 6]]));
    }
}
