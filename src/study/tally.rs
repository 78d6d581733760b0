//! Sums of errors, apart by how bright the places are.

use serde::Serialize;

/// From which share of a picture's peak on a place counts as bright, as middling; the rest is dark.
const BRIGHT: f64 = 0.1;
/// See [`BRIGHT`].
const MIDDLING: f64 = 0.01;

/// Names of the classes, in order.
pub(crate) const CLASSES: [&str; 4] = ["bright", "middling", "dark", "all"];

/// A figure for places of a tenth of the picture's peak and more, of a hundredth and more, of
/// less, and for all.
pub(crate) type ByClass = [f64; 4];

/// Errors of the regions' pictures.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    /// Σ error² and count of the pixels, by class.
    pixels: [(f64, f64); 4],
    /// The same with the measured black's error.
    with_black: [(f64, f64); 4],
    /// Σ (error² + model error²) and count of the cells, by class.
    cells: [(f64, f64); 4],
    /// Σ error²/variance told, and count.
    told: (f64, f64),
}

/// What a plan's noise is.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Noise {
    /// Root mean square error of a pixel of a region's picture, full scales a second.
    pub pixel: ByClass,
    /// The same where the measured black is subtracted, whose error all regions share.
    pub with_black: ByClass,
    /// Of a cell of the grid, with what the solver adds for its model's error.
    pub cell: ByClass,
    /// Error over the standard deviation that the merge tells, root mean square; 1 is right.
    pub told: f64,
}

/// Classes that a place belongs to.
fn classes(truth: f64, peak: f64) -> [usize; 2] {
    let share = truth / peak;
    let class = if share >= BRIGHT {
        0
    } else if share >= MIDDLING {
        1
    } else {
        2
    };
    [class, 3]
}

impl Tally {
    /// A pixel's error without and with the measured black's, the true radiance there, the picture's peak, and the variance told.
    pub fn pixel(&mut self, errors: [f64; 2], truth: f64, peak: f64, variance: f64) {
        for class in classes(truth, peak) {
            for (sums, error) in [&mut self.pixels, &mut self.with_black].into_iter().zip(errors) {
                let (sum, count) = &mut sums[class];
                (*sum, *count) = (*sum + error * error, *count + 1.0);
            }
        }
        self.told = (self.told.0 + errors[0] * errors[0] / variance, self.told.1 + 1.0);
    }

    /// A cell's error, the true radiance there, the picture's peak, and the model's error.
    pub fn cell(&mut self, error: f64, truth: f64, peak: f64, model_error: f64) {
        for class in classes(truth, peak) {
            let (sum, count) = &mut self.cells[class];
            *sum += error * error + model_error * model_error;
            *count += 1.0;
        }
    }

    pub fn noise(&self) -> Noise {
        let rms = |(sum, count): (f64, f64)| (sum / count).sqrt();
        Noise {
            pixel: self.pixels.map(rms),
            with_black: self.with_black.map(rms),
            cell: self.cells.map(rms),
            told: rms(self.told),
        }
    }
}
