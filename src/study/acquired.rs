//! A veined slab acquired from Monte-Carlo pictures by diffusion, and tried under other light.

use super::transport::{Case, Series};
use crate::Failure;
use diffusion::{
    CpuSolver, Forward, Illuminations, InverseSettings, Measurement, Progress, average, invert,
};
use material::{Face, Grid, LateralBoundary, Optics};
use serde::Serialize;
use simulator::MonteCarlo;

/// Reduced extinction of the slab outside of its veins, 1/mm: a [`Case`] counts in mean free paths.
const EXTINCTION: f64 = 1.2;
/// Width and thickness, mm.
const SIZE_MM: [f64; 2] = [40.0, 12.0];
/// Edge of a cell that photons fly through, mm.
const FINE_MM: f64 = 0.25;
/// Columns and rows of regions that are fitted.
const REGIONS: usize = 4;

/// A pattern that is not fitted.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct HeldOut {
    pub pattern: &'static str,
    /// ‖γL − L_MC‖/‖L_MC‖ over the cells, with the picture's noise in it.
    pub relative_rms: f64,
    /// The picture's own noise.
    pub noise: f64,
}

/// A material from these pictures.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Acquired {
    pub eta: f64,
    pub cell_mm: f64,
    /// Noise of the fitted pictures, relative.
    pub noise: f64,
    /// Whether the gain was free beside κ and μ, or known to be 1.
    pub free_gain: bool,
    pub gain: f64,
    pub fit: f64,
    pub chi2: f64,
    pub linear_solves: usize,
    pub held_out: Vec<HeldOut>,
    /// Mean of their errors.
    pub mean_relative_rms: f64,
}

/// Two independent pictures of each pattern.
pub(crate) struct Pictures {
    case: Case,
    fine: Grid,
    halves: Vec<[Vec<f64>; 2]>,
}

/// Where light falls, by the place on the face in mm.
type Lit = Box<dyn Fn(f64, f64) -> bool>;

/// The fitted regions, and then those that are not fitted, with names.
fn patterns() -> Vec<(&'static str, Lit)> {
    let edge = SIZE_MM[0] / REGIONS as f64;
    let middle = |v: f64| (v - SIZE_MM[0] / 2.0).abs() < 2.0;
    let mut out: Vec<(&'static str, Lit)> = Vec::new();
    for i in 0..REGIONS * REGIONS {
        let (column, row) = (i % REGIONS, i / REGIONS);
        let inside = move |v: f64, n: usize| (v / edge) as usize == n;
        out.push(("region", Box::new(move |x, y| inside(x, column) && inside(y, row))));
    }
    out.push(("full face", Box::new(|_, _| true)));
    out.push(("stripe", Box::new(move |x, _| middle(x))));
    out.push(("spot", Box::new(move |x, y| middle(x) && middle(y))));
    out
}

fn light(grid: &Grid) -> Result<Illuminations, Failure> {
    let [nx, ny, _] = grid.cells();
    let map = |lit: &Lit| {
        let cell = |i: usize| {
            let [x, y, _] = grid.centre_mm(i % nx, i / nx, 0);
            f64::from(u8::from(lit(x / EXTINCTION, y / EXTINCTION)))
        };
        (0..nx * ny).map(cell).collect()
    };
    let maps = patterns().iter().map(|(_, lit)| map(lit)).collect();
    Ok(Illuminations::new(grid, Face::Back, maps)?)
}

impl Pictures {
    /// Number of patterns.
    pub fn count() -> usize {
        patterns().len()
    }

    /// Photographs of the slab, that many photons each; `go_on` is told how many are done.
    pub fn take(
        eta: f64,
        photons: u64,
        seed: u64,
        mut go_on: impl FnMut(usize) -> bool,
    ) -> Result<Self, Failure> {
        let case = Case {
            series: Series::Veins,
            thickness: SIZE_MM[1] * EXTINCTION,
            width: SIZE_MM[0] * EXTINCTION,
            albedo: 0.995,
            eta,
            cell: FINE_MM * EXTINCTION,
            lit: Face::Back,
            sides: LateralBoundary::Open,
            veins: true,
        };
        let fine = case.grid(1)?;
        let optics = Optics::from_eta(eta);
        let block = MonteCarlo::new(&case.medium(&fine)?, &optics, 0.0).map_err(Failure::other)?;
        let all = light(&fine)?;
        let mut halves = Vec::new();
        for (pattern, map) in all.maps().iter().enumerate() {
            if !go_on(pattern) {
                return Err(Failure::other("interrupted").hint("run the same command again"));
            }
            let one = Illuminations::new(&fine, Face::Back, vec![map.clone()])?;
            let half = |number: u8| -> Result<Vec<f64>, Failure> {
                let mut hash = blake3::Hasher::new();
                hash.update(format!("acquired {seed} {eta} {pattern} {number}").as_bytes());
                let seed = *hash.finalize().as_bytes();
                let maps = block.radiance(&one, photons / 2, seed).map_err(Failure::other)?;
                Ok(maps.into_iter().flat_map(|map| map.radiance).collect())
            };
            halves.push([half(0)?, half(1)?]);
        }
        Ok(Self { case, fine, halves })
    }

    /// The material on cells of that edge, and what it makes of the other patterns.
    pub fn acquire(
        &self,
        cell_mm: f64,
        free_gain: bool,
        mut go_on: impl FnMut(&Progress) -> bool,
    ) -> Result<Acquired, Failure> {
        let grid = Case { cell: cell_mm * EXTINCTION, ..self.case }.grid(1)?;
        let optics = Optics::from_eta(self.case.eta);
        let light = light(&grid)?;
        let fitted = REGIONS * REGIONS;
        let halves: Vec<[Vec<f64>; 2]> = self
            .halves
            .iter()
            .map(|pair| [0, 1].map(|h| average(&self.fine, &grid, &pair[h])))
            .collect();
        let sum = |pick: &dyn Fn(f64, f64) -> f64, patterns: &[[Vec<f64>; 2]]| -> f64 {
            patterns
                .iter()
                .map(|[a, b]| a.iter().zip(b).map(|(a, b)| pick(*a, *b)).sum::<f64>())
                .sum()
        };
        let spread = |a: f64, b: f64| (a - b).powi(2) / 4.0;
        let square = |a: f64, b: f64| (a + b).powi(2) / 4.0;
        // Counted photons: the variance goes with the radiance.
        let known = &halves[..fitted];
        let per_radiance = sum(&spread, known) / sum(&|a, b| (a + b) / 2.0, known);
        let radiance: Vec<Vec<f64>> = halves
            .iter()
            .map(|[a, b]| a.iter().zip(b).map(|(a, b)| (a + b) / 2.0).collect())
            .collect();
        let variance: Vec<Vec<f64>> = radiance[..fitted]
            .iter()
            .map(|map| {
                let mean = map.iter().sum::<f64>() / map.len() as f64;
                // Where hardly a photon came, one more would not be a surprise.
                map.iter().map(|l| per_radiance * l.max(1e-3 * mean)).collect()
            })
            .collect();
        let maps = light.maps()[..fitted].to_vec();
        let measured = Measurement::new(
            &grid,
            Illuminations::new(&grid, Face::Back, maps)?,
            radiance[..fitted].to_vec(),
            &variance,
        )?;
        let settings = InverseSettings { free_gain, ..InverseSettings::default() };
        let mut solver = CpuSolver::<f32>::new();
        let found = invert(&grid, &optics, &measured, &settings, &mut solver, &mut go_on)?;
        let medium = diffusion::Medium::new(grid, found.kappa_mm.clone(), found.mu_per_mm.clone())?;
        let mut forward = Forward::new(medium, &optics, &mut solver)?;
        let images = forward.images(&light, 1e-6)?;
        let held_out: Vec<HeldOut> = (fitted..light.count())
            .map(|m| {
                let size = sum(&square, &halves[m..=m]);
                let off: f64 = images[m]
                    .iter()
                    .zip(&radiance[m])
                    .map(|(l, seen)| (found.gain * l - seen).powi(2))
                    .sum();
                HeldOut {
                    pattern: patterns()[m].0,
                    relative_rms: (off / size).sqrt(),
                    noise: (sum(&spread, &halves[m..=m]) / size).sqrt(),
                }
            })
            .collect();
        let errors = held_out.iter().map(|h| h.relative_rms);
        Ok(Acquired {
            eta: self.case.eta,
            cell_mm,
            noise: (sum(&spread, known) / sum(&square, known)).sqrt(),
            free_gain,
            gain: found.gain,
            fit: found.fit,
            chi2: found.chi2,
            linear_solves: found.work.linear_solves,
            mean_relative_rms: errors.sum::<f64>() / held_out.len() as f64,
            held_out,
        })
    }
}
