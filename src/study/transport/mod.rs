//! How far the diffusion model is from radiative transport, with the true κ and μ, in absolute units.

mod cases;
mod drawing;

pub(crate) use cases::{Case, Series, cases};
pub(crate) use drawing::draw;

use crate::Failure;
use diffusion::{CpuSolver, Forward, Illuminations, average};
use material::{Face, Grid, Optics};
use serde::Serialize;
use simulator::MonteCarlo;

/// Bounds of what counts as agreement: of the scale, and of the root mean square.
pub(crate) const GOAL: (f64, f64) = (0.01, 0.045);

/// What came of one case.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    #[serde(flatten)]
    pub case: Case,
    /// Gain that would bring diffusion's map nearest to Monte Carlo's, less 1.
    pub scale_error: f64,
    /// ‖L_diffusion − L‖/‖L‖ over the cells, nothing fitted, the noise of Monte Carlo taken out.
    pub relative_rms: f64,
    /// The same after that gain.
    pub relative_rms_after_gain: f64,
    /// Noise of Monte Carlo's map, as a share of it.
    pub noise: f64,
    /// Share of the light that leaves through the front face.
    pub through: f64,
}

impl Row {
    pub fn agrees(&self) -> bool {
        self.scale_error.abs() <= GOAL.0 && self.relative_rms <= GOAL.1
    }
}

fn norm(values: impl Iterator<Item = f64>) -> f64 {
    values.map(|v| v * v).sum::<f64>().sqrt()
}

/// Lights one region of the case's block, by diffusion on its grid and by photons on one twice as
/// fine where the block is not the same everywhere.
pub(crate) fn measure(case: &Case, photons: u64, seed: u64) -> Result<Row, Failure> {
    let optics = Optics { lateral: case.sides, ..Optics::from_eta(case.eta) };
    let grid = case.grid(1)?;
    let fine = case.grid(if case.veins { 2 } else { 1 })?;
    let light = |grid: &Grid| Illuminations::new(grid, case.lit, vec![case.region(grid)]);
    let spot = light(&grid)?;
    let diffused = || -> Result<Vec<f64>, Failure> {
        let mut solver = CpuSolver::<f32>::new();
        let mut forward = Forward::new(case.medium(&grid)?, &optics, &mut solver)?;
        Ok(forward.images(&spot, 1e-7)?.swap_remove(0))
    };

    let block = MonteCarlo::new(&case.medium(&fine)?, &optics, 0.0).map_err(Failure::other)?;
    let spot_fine = light(&fine)?;
    let half = |number: u8| -> Result<(Vec<f64>, f64), Failure> {
        let mut hash = blake3::Hasher::new();
        hash.update(&seed.to_le_bytes()).update(format!("{case:?}").as_bytes()).update(&[number]);
        let seed = *hash.finalize().as_bytes();
        let map = block.radiance(&spot_fine, photons / 2, seed).map_err(Failure::other)?;
        let map = map.into_iter().next().ok_or_else(|| Failure::other("no pattern, no map"))?;
        Ok((average(&fine, &grid, &map.radiance), map.balance.front))
    };
    let ((a, through), (b, _)) = (half(0)?, half(1)?);
    // Lit from the front, what is lit directly is masked in a measurement.
    let lit = &spot.maps()[0];
    let seen = |c: &usize| case.lit == Face::Back || lit[*c] == 0.0;
    let cells: Vec<usize> = (0..lit.len()).filter(seen).collect();
    let truth = |c: usize| (a[c] + b[c]) / 2.0;
    let size = norm(cells.iter().map(|&c| truth(c)));
    let noise = norm(cells.iter().map(|&c| (a[c] - b[c]) / 2.0)) / size;
    // Error in scale, root mean square, and that after the gain.
    let compare = |diffuse: &[f64]| {
        let cross: f64 = cells.iter().map(|&c| truth(c) * diffuse[c]).sum();
        let gain = cross / cells.iter().map(|&c| diffuse[c] * diffuse[c]).sum::<f64>();
        let rms = |gain: f64| {
            let all = norm(cells.iter().map(|&c| gain * diffuse[c] - truth(c))) / size;
            (all * all - noise * noise).max(0.0).sqrt()
        };
        [gain - 1.0, rms(1.0), rms(gain)]
    };
    let [scale_error, relative_rms, relative_rms_after_gain] = compare(&diffused()?);
    Ok(Row { case: *case, scale_error, relative_rms, relative_rms_after_gain, noise, through })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slab that diffusion is good for comes out so, bright or dark; and one that light crosses after a few
    /// scatterings does not.
    #[test]
    fn a_thick_slab_passes_and_a_thin_one_does_not() {
        let good = Case { thickness: 16.0, albedo: 0.999, width: 12.0, ..Case::default() };
        let row = measure(&good, 300_000, 1).unwrap();
        // The figure's own bound, and of the scale twice it: its standard error is 0.7 %.
        assert!(row.scale_error.abs() < 0.02 && row.relative_rms < 0.045, "{row:?}");
        // With κ in the place of what conducts 12 % and more; what thin layers below the faces do otherwise, and
        // fewer photons, are left.
        let dark = measure(&Case { albedo: 0.95, ..good }, 300_000, 1).unwrap();
        assert!(dark.scale_error.abs() < 0.05, "{dark:?}");
        let thin = measure(&Case { thickness: 3.0, ..good }, 300_000, 1).unwrap();
        assert!(!thin.agrees(), "{thin:?}");
    }
}
