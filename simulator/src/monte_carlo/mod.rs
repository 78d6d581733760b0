//! Light through the block by radiative transfer itself, where diffusion is an approximation: Monte
//! Carlo over photons' paths.
//!
//! Every voxel has its extinction and albedo; a photon flies an exponential path (Woodcock et al.
//! 1965: against the largest extinction of all, collisions that are too many being fictitious),
//! loses what is absorbed, scores what it scatters towards the camera, dimmed by the way up the
//! column (a next-event estimate), and goes on in another direction. At the faces Fresnel's
//! equations decide. Weight windows by depth keep photons where the camera sees them.

mod importance;
mod surface;
#[cfg(test)]
mod tests;
mod voxels;
mod walk;

use diffusion::{Illuminations, Medium};
use material::{LateralBoundary, Optics};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use surface::Surface;
use voxels::Voxels;
use walk::{Tally, Walk, World};

/// Independent estimates that a result is the mean of: their spread is its standard error, known
/// to 1/√(2·64) = 9 % of itself; and as many threads are kept busy.
const BATCHES: u64 = 64;

/// What light cannot be sent through.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TransportError {
    /// κ and μ of a cell ask for σs' = 1/(3κ) − μ below 0.
    #[error(
        "3κμ must be at most 1, found κ = {kappa} mm and μ = {mu}/mm in cell (x {x}, y {y}, z {z})"
    )]
    NoScattering {
        /// κ of the cell, mm.
        kappa: f64,
        /// μ of the cell, 1/mm.
        mu: f64,
        /// Cell along x.
        x: usize,
        /// Cell along y.
        y: usize,
        /// Cell along z.
        z: usize,
    },
    /// The mean cosine of scattering.
    #[error("the mean cosine of scattering must lie between -1 and 1, found {found}")]
    Anisotropy {
        /// What was asked for.
        found: f64,
    },
    /// There is no light below none.
    #[error("pattern {pattern} is negative in cell (x {x}, y {y}) of the lit face")]
    NegativeLight {
        /// Number of the pattern.
        pattern: usize,
        /// Cell along x.
        x: usize,
        /// Cell along y.
        y: usize,
    },
    /// An estimate takes at least one photon a batch.
    #[error("at least {} photons are needed, found {found}", BATCHES)]
    TooFewPhotons {
        /// What was asked for.
        found: u64,
    },
    /// Nobody waits that long.
    #[error("at most {most} photons a pattern, found {found}")]
    TooManyPhotons {
        /// How many may be asked for.
        most: u64,
        /// What was asked for.
        found: u64,
    },
}

/// Radiance of the front face under one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct TransportMap {
    /// Mean radiance along the normal of every cell of the front face, in 1/sr times the irradiance
    /// unit; nx × ny values, x fastest. Light that was never scattered is not in it: what a
    /// mirror-like surface reflects, and the beam that shines through.
    pub radiance: Vec<f64>,
    /// Its standard error.
    pub standard_error: Vec<f64>,
    /// Where the light went.
    pub balance: Balance,
}

impl TransportMap {
    fn dark(cells: usize) -> Self {
        let nothing = vec![0.0; cells];
        Self { radiance: nothing.clone(), standard_error: nothing, balance: Balance::default() }
    }
}

/// Shares of the light that falls on the lit face; together 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Balance {
    /// Reflected by the surface before it entered.
    pub reflected: f64,
    /// Absorbed.
    pub absorbed: f64,
    /// Left through the front face.
    pub front: f64,
    /// Left through the back face.
    pub back: f64,
    /// Left through the side faces.
    pub sides: f64,
    /// Taken by roulette, which gives back as much on average.
    pub roulette: f64,
}

/// A block that light can be sent through.
pub struct MonteCarlo {
    voxels: Voxels,
    optics: Optics,
    anisotropy: f64,
}

impl MonteCarlo {
    /// The block of a medium: σs' = 1/(3κ) − μ and σa = μ of every cell, scattering with the mean
    /// cosine `anisotropy` (0: isotropic; else Henyey and Greenstein's phase function with
    /// σs = σs'/(1 − g)). Of `optics` count the refractive index, the side faces and the shape of
    /// the incoming light; a boundary convention is diffusion's way to speak of what is followed
    /// photon by photon here.
    ///
    /// # Errors
    /// A cell with 3κμ > 1, a mean cosine outside of (−1, 1).
    pub fn new(medium: &Medium, optics: &Optics, anisotropy: f64) -> Result<Self, TransportError> {
        Self::check(BATCHES, anisotropy)?;
        Ok(Self { voxels: Voxels::new(medium, anisotropy)?, optics: *optics, anisotropy })
    }

    /// Whether a block of that mean cosine can be lit by that many photons.
    pub(crate) fn check(photons: u64, anisotropy: f64) -> Result<(), TransportError> {
        if !(anisotropy > -1.0 && anisotropy < 1.0) {
            return Err(TransportError::Anisotropy { found: anisotropy });
        }
        if photons < BATCHES {
            return Err(TransportError::TooFewPhotons { found: photons });
        }
        Ok(())
    }

    /// Radiance of the front face under every pattern, each from that many photons (rounded up to
    /// whole batches). The same seed gives the same maps on any number of threads.
    ///
    /// # Errors
    /// A pattern with negative light, too few photons.
    ///
    /// # Panics
    /// If the patterns are made for another grid.
    pub fn radiance(
        &self,
        light: &Illuminations,
        photons: u64,
        seed: [u8; 32],
    ) -> Result<Vec<TransportMap>, TransportError> {
        Self::check(photons, self.anisotropy)?;
        let voxels = &self.voxels;
        let c = self.optics.boundary_constant;
        let world = World {
            voxels,
            surface: Surface::new(self.optics.eta),
            importance: importance::by_depth(voxels, c, light.face()),
            anisotropy: self.anisotropy as f32,
            mirrored_sides: self.optics.lateral == LateralBoundary::NoFlux,
            lit: light.face(),
            illumination: self.optics.illumination,
        };
        let per_batch = photons.div_ceil(BATCHES);
        let one = |(pattern, map): (usize, &Vec<f64>)| {
            assert_eq!(map.len(), voxels.column.len(), "a pattern for another grid");
            if let Some(i) = map.iter().position(|e| *e < 0.0) {
                let nx = voxels.cells[0];
                return Err(TransportError::NegativeLight { pattern, x: i % nx, y: i / nx });
            }
            if map.iter().all(|e| *e == 0.0) {
                return Ok(TransportMap::dark(map.len()));
            }
            let batch = |batch: u64| {
                let mut rng = ChaCha8Rng::from_seed(seed);
                rng.set_stream(pattern as u64 * BATCHES + batch);
                let mut walk = Walk::new(&world, rng);
                walk.light(map, per_batch);
                (walk.seen, walk.tally)
            };
            let batches: Vec<_> = (0..BATCHES).into_par_iter().map(batch).collect();
            Ok(world.combine(map, &batches, per_batch))
        };
        light.maps().iter().enumerate().map(one).collect()
    }
}

impl World<'_> {
    /// The mean of all batches, in their order.
    fn combine(
        &self,
        irradiance: &[f64],
        batches: &[(Vec<f64>, Tally)],
        photons: u64,
    ) -> TransportMap {
        let eta2 = f64::from(self.surface.eta()).powi(2);
        let r = f64::from(self.surface.normal_reflectance);
        // A photon stands for that much irradiance on one cell; radiance grows with η² inside.
        let total: f64 = irradiance.iter().sum();
        let unit = total / photons as f64 * (1.0 - r) / eta2 / (4.0 * std::f64::consts::PI);
        let n = batches.len() as f64;
        let cell = |c: usize| {
            let (sum, squares) = batches.iter().fold((0.0, 0.0), |(sum, squares), (seen, _)| {
                (sum + seen[c], squares + seen[c] * seen[c])
            });
            let variance = ((squares - sum * sum / n) / (n - 1.0)).max(0.0);
            // To and fro between the faces, again and again, along the normal.
            let way = f64::from(self.voxels.column[c]);
            let unit = unit / (1.0 - r * r * (-2.0 * way).exp());
            (unit * sum / n, unit * (variance / n).sqrt())
        };
        let (radiance, standard_error) = (0..irradiance.len()).map(cell).unzip();
        let mut tally = Tally::default();
        batches.iter().for_each(|(_, one)| tally.add(one));
        let sent = n * photons as f64;
        let [front, back, sides] = tally.left.map(|w| w / sent);
        let balance = Balance {
            reflected: 1.0 - tally.entered / sent,
            absorbed: tally.absorbed / sent,
            front,
            back,
            sides,
            roulette: tally.roulette / sent,
        };
        TransportMap { radiance, standard_error, balance }
    }
}
