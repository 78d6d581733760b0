//! The diffuse BSSRDF of a block, and how far an acquired one is from the truth.

use crate::resample::FaceOverlap;
use crate::{Batch, Forward, IlluminationError, Illuminations, LinearSolver, Medium, SolveError};
use material::{Face, Grid, Optics};

/// Source cells that are solved for in one batch.
const SOURCES: usize = 16;

/// Why two blocks cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BssrdfError {
    /// A linear solve failed.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// A pattern does not fit its grid.
    #[error(transparent)]
    Light(#[from] IlluminationError),
    /// The finer grid is not a whole-number refinement of the coarser one.
    #[error("a grid of {fine:?} cells is not a refinement of one of {coarse:?} cells")]
    NotARefinement {
        /// Cells of the acquired grid.
        coarse: [usize; 3],
        /// Cells of the truth's grid.
        fine: [usize; 3],
    },
    /// The observer asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// E = Σ (R' − R)² / Σ R² over all source cells of the lit face and all exit cells of the front
/// face (W08 figure 11), R the truth and R' acquired.
///
/// `acquired` comes with the gain that its images are multiplied by (1 where none was fitted).
/// The truth may live on a finer grid: its sources are the cells of the acquired grid, and its
/// exit radiance is averaged over them. `progress(done, all)` is called after each batch of
/// sources and returns false to stop.
///
/// # Errors
/// The grids do not nest, a solve fails, or `progress` returns false.
pub fn bssrdf_error<S: LinearSolver>(
    acquired: (&Medium, &Optics, f64),
    truth: (&Medium, &Optics),
    lit: Face,
    solver: &mut S,
    tolerance: f64,
    mut progress: impl FnMut(usize, usize) -> bool,
) -> Result<f64, BssrdfError> {
    let coarse = *acquired.0.grid();
    let fine = *truth.0.grid();
    let (c, f) = (coarse.cells(), fine.cells());
    if f[0] % c[0] != 0 || f[1] % c[1] != 0 {
        return Err(BssrdfError::NotARefinement { coarse: c, fine: f });
    }
    let all = coarse.face_len();
    let (mut difference, mut energy) = (0.0, 0.0);
    // The two operators take turns in one solver: all batches of the acquired block first.
    let mut images = Vec::with_capacity(all);
    let mut done = 0;
    let gain = acquired.2;
    for ((medium, optics), is_truth) in [((acquired.0, acquired.1), false), (truth, true)] {
        let grid = *medium.grid();
        let mut forward = Forward::new(medium.clone(), optics, solver)?;
        for first in (0..all).step_by(SOURCES) {
            let sources = first..(first + SOURCES).min(all);
            let maps = sources.clone().map(|s| spot(&coarse, &grid, s)).collect();
            let light = Illuminations::new(&grid, lit, maps)?;
            let mut fluence = Batch::zeros(grid.len(), light.count());
            forward.solve(&light, &mut fluence, tolerance)?;
            for (s, image) in sources.zip(forward.exit_radiance(&light, &fluence, Face::Front)) {
                let image = average(&grid, &coarse, &image);
                if is_truth {
                    let acquired: &Vec<f64> = &images[s];
                    for (a, t) in acquired.iter().zip(&image) {
                        difference += (a - t) * (a - t);
                        energy += t * t;
                    }
                } else {
                    images.push(image.into_iter().map(|l| gain * l).collect());
                }
            }
            done += 1;
            if !progress(done, 2 * all.div_ceil(SOURCES)) {
                return Err(BssrdfError::Interrupted);
            }
        }
    }
    Ok(difference / energy)
}

/// Unit irradiance on one face cell of `coarse`, as a map on `grid`.
fn spot(coarse: &Grid, grid: &Grid, source: usize) -> Vec<f64> {
    let [cx, cy, _] = coarse.cells();
    let [nx, ny, _] = grid.cells();
    let (rx, ry) = (nx / cx, ny / cy);
    let (sx, sy) = (source % cx, source / cx);
    (0..grid.face_len())
        .map(|i| f64::from(u8::from((i % nx) / rx == sx && (i / nx) / ry == sy)))
        .collect()
}

/// A map on the face of one grid of a block, averaged over the face cells of another.
pub fn average(grid: &Grid, coarse: &Grid, map: &[f64]) -> Vec<f64> {
    FaceOverlap::new(grid, coarse).average(map)
}
