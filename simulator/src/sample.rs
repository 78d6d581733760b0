//! Procedural samples: volumes of κ and μ as functions of position, in physically sensible units.

use diffusion::{Medium, MediumError};
use material::Grid;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// What the block is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SampleKind {
    /// Smooth and cloudy.
    Wax,
    /// Bright, with absorbing veins.
    Marble,
    /// A binder with denser and clearer inclusions.
    Stone,
}

/// A sample: a kind and a seed; every seed is another block of that kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SampleSpec {
    /// The kind.
    pub kind: SampleKind,
    /// The seed.
    pub seed: u64,
}

/// Waves summed into one cloud: enough that no direction stands out.
const WAVES: usize = 24;
/// Median diffuse reflectance of the bare surface: polished stone and wax have a few hundredths.
const SURFACE: f64 = 0.05;
/// Balls of a stone: about a sixth of the block is ball.
const BALLS: usize = 14;

impl SampleSpec {
    /// Refractive index of the block. Paraffin 1.43, calcite about 1.5, polymer stone 1.5: close
    /// enough to one another that 1.4 stands for all three.
    pub fn eta(&self) -> f64 {
        1.4
    }

    /// Mean reduced scattering coefficient of the three channels, 1/mm. Marble: Jensen et al. 2001
    /// table; wax and stone lie between it and skim milk.
    pub fn reduced_scattering_per_mm(&self) -> [f64; 3] {
        match self.kind {
            SampleKind::Wax => [1.2, 1.35, 1.5],
            SampleKind::Marble => [2.19, 2.62, 3.0],
            SampleKind::Stone => [1.7, 1.8, 1.9],
        }
    }

    /// Mean absorption coefficient of the three channels, 1/mm.
    pub fn absorption_per_mm(&self) -> [f64; 3] {
        match self.kind {
            SampleKind::Wax => [0.003, 0.006, 0.015],
            SampleKind::Marble => [0.0021, 0.0041, 0.0071],
            SampleKind::Stone => [0.006, 0.005, 0.008],
        }
    }

    /// The grid that this sample is solved on: 40 × 40 × 10 cells of a size between half and two
    /// thirds of the green channel's mean free path, rounded to 10 µm. So the block is five to
    /// seven mean free paths thick: a thin sample, which enough light gets through.
    pub fn solved_grid(&self) -> Grid {
        let spacing = match self.kind {
            SampleKind::Wax => 0.45,
            SampleKind::Marble => 0.23,
            SampleKind::Stone => 0.34,
        };
        // Constants: 40 × 40 × 10 cells of positive size are a grid.
        Grid::new([40, 40, 10], [spacing; 3]).unwrap_or_else(|_| unreachable!())
    }

    /// κ and μ of one channel (0 red, 1 green, 2 blue) on any grid, sampled at cell centres.
    ///
    /// # Errors
    /// None for the kinds there are; the type says what a medium may refuse.
    pub fn medium(&self, grid: &Grid, channel: usize) -> Result<Medium, MediumError> {
        let field = Field::new(self);
        let [nx, ny, nz] = grid.cells();
        let (mut kappa, mut mu) = (Vec::with_capacity(grid.len()), Vec::with_capacity(grid.len()));
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let (s, a) = field.factors(grid.centre_mm(x, y, z), channel);
                    let scattering = self.reduced_scattering_per_mm()[channel] * s;
                    let absorption = self.absorption_per_mm()[channel] * a;
                    kappa.push(1.0 / (3.0 * (scattering + absorption)));
                    mu.push(absorption);
                }
            }
        }
        Medium::new(*grid, kappa, mu)
    }

    /// Diffuse reflectance of the bare surface in one channel (0 red, 1 green, 2 blue), at the
    /// centres of the cells of a grid's front face: patches as wide as a third of the block, where it
    /// is about half as much or twice as much, of slightly different shape in each channel. It has
    /// nothing to do with what lies below.
    pub fn surface_reflectance(&self, grid: &Grid, channel: usize) -> Vec<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        // Not the numbers that the volume is made of.
        rng.set_stream(1);
        let scale = self.solved_grid().size_mm()[0];
        let grey = Cloud::new(&mut rng, 0.35 * scale);
        let colours: [Cloud; 3] = std::array::from_fn(|_| Cloud::new(&mut rng, 0.5 * scale));
        let [nx, ny, _] = grid.cells();
        let at = |i: usize| {
            let [x, y, _] = grid.centre_mm(i % nx, i / nx, 0);
            let p = [x, y, 0.0];
            SURFACE * (0.4 * grey.at(p) + 0.15 * colours[channel].at(p)).exp()
        };
        (0..nx * ny).map(at).collect()
    }
}

/// A smooth random function of position with mean 0 and variance 1.
struct Cloud {
    waves: Vec<([f64; 3], f64)>,
}

impl Cloud {
    /// Waves of about `length` mm.
    fn new(rng: &mut ChaCha8Rng, length: f64) -> Self {
        let wave = |rng: &mut ChaCha8Rng| {
            let mut direction = [0.0; 3];
            direction.fill_with(|| rng.random_range(-1.0..1.0));
            let norm = direction.iter().map(|d| d * d).sum::<f64>().sqrt().max(1e-3);
            let number = std::f64::consts::TAU / (length * rng.random_range(0.8..1.6));
            (direction.map(|d| d / norm * number), rng.random_range(0.0..std::f64::consts::TAU))
        };
        Self { waves: (0..WAVES).map(|_| wave(rng)).collect() }
    }

    fn at(&self, p: [f64; 3]) -> f64 {
        let sum: f64 = self
            .waves
            .iter()
            .map(|(k, phase)| (k[0] * p[0] + k[1] * p[1] + k[2] * p[2] + phase).cos())
            .sum();
        sum * (2.0 / WAVES as f64).sqrt()
    }
}

/// Relative scattering and absorption as functions of position.
struct Field {
    kind: SampleKind,
    clouds: [Cloud; 3],
    balls: Vec<Ball>,
    /// Edge of the block that lengths are measured by, mm.
    scale: f64,
}

struct Ball {
    centre: [f64; 3],
    radius: f64,
    clear: bool,
}

impl Field {
    fn new(spec: &SampleSpec) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        let size = spec.solved_grid().size_mm();
        let scale = size[0];
        let clouds = [0.5, 0.8, 0.6].map(|share| Cloud::new(&mut rng, share * scale));
        let ball = |rng: &mut ChaCha8Rng| Ball {
            centre: size.map(|s| rng.random_range(0.0..s)),
            radius: scale * rng.random_range(0.06..0.13),
            clear: rng.random_range(0.0..1.0) < 0.4,
        };
        let balls = (0..BALLS).map(|_| ball(&mut rng)).collect();
        Self { kind: spec.kind, clouds, balls, scale }
    }

    fn factors(&self, p: [f64; 3], channel: usize) -> (f64, f64) {
        let [a, b, c] = [0, 1, 2].map(|i| self.clouds[i].at(p));
        match self.kind {
            SampleKind::Wax => ((0.12 * a).exp(), (0.25 * b).exp()),
            SampleKind::Marble => {
                // Sheets along the zero set of a cloud; about a tenth of the block is vein, greyish
                // green: it absorbs red and blue a little more.
                let vein = (-(b / 0.22).powi(2)).exp();
                let tint = [4.0, 3.0, 4.5][channel];
                ((0.08 * a - 0.35 * vein).exp(), (0.15 * c).exp() * (1.0 + tint * vein))
            }
            SampleKind::Stone => {
                let (mut s, mut m) = ((0.08 * a).exp(), (0.15 * c).exp());
                for ball in &self.balls {
                    let r = (0..3).map(|i| (p[i] - ball.centre[i]).powi(2)).sum::<f64>().sqrt();
                    // Edges as soft as a cell is wide: a grid cannot say more.
                    let inside = 0.5 - 0.5 * ((r - ball.radius) / (0.02 * self.scale)).tanh();
                    let (scatter, absorb) = if ball.clear { (0.6, 0.7) } else { (1.5, 3.0) };
                    s *= 1.0 + inside * (scatter - 1.0);
                    m *= 1.0 + inside * (absorb - 1.0);
                }
                (s, m)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [SampleKind; 3] = [SampleKind::Wax, SampleKind::Marble, SampleKind::Stone];

    /// A reflectance everywhere, with something to find in it, another one for each seed and channel,
    /// and the same on a finer grid: cells of half the size differ from the mean of their four by
    /// less than a hundredth.
    #[test]
    fn every_surface_is_physical_and_its_own() {
        let mut seen: Vec<Vec<f64>> = Vec::new();
        for seed in [1, 2, 77] {
            let spec = SampleSpec { kind: SampleKind::Marble, seed };
            let coarse = spec.solved_grid();
            let fine =
                Grid::new(coarse.cells().map(|n| 2 * n), coarse.spacing_mm().map(|h| h / 2.0));
            let fine = fine.unwrap();
            for channel in 0..3 {
                let map = spec.surface_reflectance(&coarse, channel);
                let low = map.iter().copied().fold(f64::INFINITY, f64::min);
                let high = map.iter().copied().fold(0.0, f64::max);
                assert!(low > 0.005 && high < 0.3 && high > 2.0 * low, "{low}..{high}");
                let finer = spec.surface_reflectance(&fine, channel);
                for (i, rho) in map.iter().enumerate() {
                    let corner = 2 * (i / 40) * 80 + 2 * (i % 40);
                    let four = [0, 1, 80, 81].map(|k| finer[corner + k]);
                    let mean = four.iter().sum::<f64>() / 4.0;
                    assert!((mean / rho - 1.0).abs() < 0.01, "{i}: {mean}, {rho}");
                }
                assert!(seen.iter().all(|s| *s != map));
                seen.push(map);
            }
        }
    }

    /// Every kind and seed is a scattering medium (3κμ < 1) of moderate contrast, and differs
    /// from every other.
    #[test]
    fn every_sample_is_physical_and_its_own() {
        let mut seen: Vec<Vec<f64>> = Vec::new();
        for kind in KINDS {
            for seed in [1, 2, 77] {
                let spec = SampleSpec { kind, seed };
                for channel in 0..3 {
                    let m = spec.medium(&spec.solved_grid(), channel).unwrap();
                    let pairs = m.kappa_mm().iter().zip(m.mu_per_mm());
                    let worst = pairs.map(|(k, mu)| 3.0 * k * mu).fold(0.0, f64::max);
                    assert!(worst < 0.2, "{spec:?} {channel}: 3κμ = {worst}");
                    let low = m.kappa_mm().iter().copied().fold(f64::INFINITY, f64::min);
                    let high = m.kappa_mm().iter().copied().fold(0.0, f64::max);
                    assert!(high / low > 1.2 && high / low < 20.0, "{spec:?}: {low}..{high}");
                    assert!(seen.iter().all(|s| s != m.kappa_mm()));
                    seen.push(m.kappa_mm().to_vec());
                }
            }
        }
    }
}
