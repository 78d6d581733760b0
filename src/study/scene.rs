//! A simulated block of known κ and μ, and noisy pictures of it.

use crate::Failure;
use diffusion::{Forward, Illuminations, LinearSolver, Measurement, Medium, average};
use material::{Face, Grid, Optics};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use simulator::SampleSpec;

/// Pictures come from a grid this many times as fine along every axis: no inverse crime.
pub(crate) const FINER: usize = 2;
/// Noise that no light has: of reading out, as a share of a picture's brightest cell.
const READ_NOISE: f64 = 1e-4;
/// Relative residual of the forward solves.
const TOLERANCE: f64 = 1e-6;
/// Patterns that are solved for at a time: as many as a solver reads the coefficients once for, or a
/// quarter of them where their fields would take gigabytes.
const TOGETHER: usize = 16;
const LARGE: usize = 2_000_000;

/// What is photographed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scene {
    pub sample: SampleSpec,
    /// 0 red, 1 green, 2 blue.
    pub channel: usize,
    /// The grid that is solved.
    pub grid: Grid,
    pub lit: Face,
}

impl Scene {
    /// A block of `cells` cells as large as the sample's own. Its veins or clouds are stretched with
    /// it, so that a larger grid shows the same in more detail.
    ///
    /// # Errors
    /// A grid that cannot be: fewer than two cells along an axis.
    pub fn new(
        sample: SampleSpec,
        channel: usize,
        cells: [usize; 3],
        lit: Face,
    ) -> Result<Self, Failure> {
        let grid = Grid::new(cells, sample.solved_grid().spacing_mm())?;
        Ok(Self { sample, channel, grid, lit })
    }

    pub fn optics(&self) -> Optics {
        Optics::from_eta(self.sample.eta())
    }

    /// The block's grid, `refinement` times as fine along every axis.
    fn refined(&self, refinement: usize) -> Result<Grid, Failure> {
        let h = self.grid.spacing_mm().map(|h| h / refinement as f64);
        Ok(Grid::new(self.grid.cells().map(|n| n * refinement), h)?)
    }

    /// True κ and μ at the centres of the solved grid's cells.
    pub fn truth(&self) -> Result<Medium, Failure> {
        self.medium(&self.grid)
    }

    /// True κ and μ on the grid that pictures come from.
    pub fn fine_truth(&self) -> Result<Medium, Failure> {
        self.medium(&self.refined(FINER)?)
    }

    fn medium(&self, grid: &Grid) -> Result<Medium, Failure> {
        // The sample's pattern is a function of the place: a smaller block of as many cells has all
        // of it.
        let whole = |grid: &Grid| grid.size_mm()[0].max(grid.size_mm()[1]);
        let shrink = whole(&self.sample.solved_grid()) / whole(grid);
        let small = Grid::new(grid.cells(), grid.spacing_mm().map(|h| h * shrink))?;
        let found = self.sample.medium(&small, self.channel)?;
        Ok(Medium::new(*grid, found.kappa_mm().to_vec(), found.mu_per_mm().to_vec())?)
    }

    /// A map on the solved grid's face as one on a finer grid's.
    pub fn upsampled(&self, fine: &Grid, map: &[f64]) -> Vec<f64> {
        let ([nx, _, _], [fx, fy, _]) = (self.grid.cells(), fine.cells());
        let times = fx / nx;
        (0..fx * fy).map(|i| map[i / fx / times * nx + i % fx / times]).collect()
    }

    /// Pictures under one of `regions` × `regions` regions after the other, each pixel with normal
    /// noise of `noise` times its radiance. Lit from the front, what is lit directly is masked.
    ///
    /// # Errors
    /// A solve fails, everything is masked, or `go_on` returns false.
    pub fn photographed<S: LinearSolver>(
        &self,
        regions: usize,
        noise: f64,
        seed: u64,
        solver: &mut S,
        mut go_on: impl FnMut() -> Result<(), Failure>,
    ) -> Result<Measurement, Failure> {
        let truth = self.fine_truth()?;
        let fine = *truth.grid();
        let light = Illuminations::regions(&self.grid, self.lit, regions)?;
        let mut forward = Forward::new(truth, &self.optics(), solver)?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (mut radiance, mut variance) = (Vec::new(), Vec::new());
        let together = if fine.len() > LARGE { TOGETHER / 4 } else { TOGETHER };
        for maps in light.maps().chunks(together) {
            go_on()?;
            let fine_maps = maps.iter().map(|map| self.upsampled(&fine, map)).collect();
            let some = Illuminations::new(&fine, self.lit, fine_maps)?;
            for (image, lit) in forward.images(&some, TOLERANCE)?.iter().zip(maps) {
                let image = average(&fine, &self.grid, image);
                let peak = image.iter().copied().fold(0.0, f64::max);
                let (mut noisy, mut spread) = (Vec::new(), Vec::new());
                for (l, e) in image.iter().zip(lit) {
                    let sigma = noise * l.abs() + READ_NOISE * peak;
                    let normal: f64 = StandardNormal.sample(&mut rng);
                    noisy.push(l + sigma * normal);
                    let direct = self.lit == Face::Front && *e > 0.0;
                    spread.push(if direct { f64::INFINITY } else { sigma * sigma });
                }
                radiance.push(noisy);
                variance.push(spread);
            }
        }
        Ok(Measurement::new(&self.grid, light, radiance, &variance)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diffusion::CpuSolver;
    use simulator::SampleKind;

    fn scene(lit: Face) -> Scene {
        let sample = SampleSpec { kind: SampleKind::Marble, seed: 1 };
        Scene::new(sample, 1, [12, 12, 4], lit).unwrap()
    }

    fn pictures(lit: Face, noise: f64, seed: u64) -> Measurement {
        let solver = &mut CpuSolver::<f32>::new();
        scene(lit).photographed(2, noise, seed, solver, || Ok(())).unwrap()
    }

    /// A grid twice as large has what the sample's own has at half the distance, but for rounding of
    /// places, and the sample's own grid has the sample.
    #[test]
    fn a_larger_block_has_the_pattern_in_more_cells() {
        let sample = scene(Face::Back).sample;
        let own = sample.solved_grid();
        let block = |cells| Scene::new(sample, 1, cells, Face::Back).unwrap();
        let (large, same) = (block(own.cells().map(|n| 2 * n)), block(own.cells()));
        let pairs = large.truth().unwrap();
        let fine = same.fine_truth().unwrap();
        let mut pairs = pairs.kappa_mm().iter().zip(fine.kappa_mm());
        assert!(pairs.all(|(a, b)| (a / b - 1.0).abs() < 1e-9));
        let medium = sample.medium(&own, 1).unwrap();
        assert_eq!(same.truth().unwrap().kappa_mm(), medium.kappa_mm());
    }

    /// Over 4 × 144 pixels a standard deviation is known to 3 %; 12 % is four of these.
    #[test]
    fn noise_is_as_large_as_asked_for_and_follows_the_seed() {
        let (clean, noisy) = (pictures(Face::Back, 0.0, 1), pictures(Face::Back, 0.02, 1));
        let pairs = clean.radiance().iter().flatten().zip(noisy.radiance().iter().flatten());
        let squares: Vec<f64> = pairs.map(|(c, n)| (n / c - 1.0).powi(2)).collect();
        let sd = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!((sd / 0.02 - 1.0).abs() < 0.12, "{sd}");
        assert_eq!(noisy.radiance(), pictures(Face::Back, 0.02, 1).radiance());
        assert_ne!(noisy.radiance(), pictures(Face::Back, 0.02, 2).radiance());
    }

    /// Each of the four regions is a quarter of the face, and does not count in its own picture.
    #[test]
    fn what_is_lit_directly_is_masked() {
        assert_eq!(pictures(Face::Back, 0.02, 1).data(), 4 * 144);
        assert_eq!(pictures(Face::Front, 0.02, 1).data(), 4 * 144 * 3 / 4);
    }
}
