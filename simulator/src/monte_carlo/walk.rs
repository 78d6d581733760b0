//! Photons on their way through the block.

use super::surface::Surface;
use super::voxels::Voxels;
use material::{Face, Illumination};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Exp1, UnitCircle, UnitSphere};

/// Weight times importance below which a photon plays roulette, what the survivors have, and
/// above which a photon is split.
const WINDOW: [f32; 3] = [0.25, 0.5, 2.0];
/// Most that come of one in a single collision.
const MOST_SPLIT: f32 = 16.0;

/// A photon: place in cells from the front face's corner, unit direction, and weight: what is left
/// of the one that was sent.
#[derive(Clone, Copy, Debug)]
struct Photon {
    at: [f32; 3],
    direction: [f32; 3],
    weight: f32,
}

/// Where the weight went.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    /// Sent in, after the reflection at the surface.
    pub entered: f64,
    pub absorbed: f64,
    /// Through the front face, the back face, and the sides.
    pub left: [f64; 3],
    /// What roulette took, less what it gave; about nothing.
    pub roulette: f64,
}

impl Tally {
    pub fn add(&mut self, other: &Self) {
        self.entered += other.entered;
        self.absorbed += other.absorbed;
        (0..3).for_each(|i| self.left[i] += other.left[i]);
        self.roulette += other.roulette;
    }
}

/// What every photon meets.
pub(super) struct World<'a> {
    pub voxels: &'a Voxels,
    pub surface: Surface,
    /// Of every layer.
    pub importance: Vec<f32>,
    /// Mean cosine of the phase function.
    pub anisotropy: f32,
    /// Side faces that send everything back, as the same block beside it would.
    pub mirrored_sides: bool,
    pub lit: Face,
    pub illumination: Illumination,
}

/// One batch: its random numbers and what it has seen.
pub(super) struct Walk<'a> {
    world: &'a World<'a>,
    rng: ChaCha8Rng,
    waiting: Vec<Photon>,
    /// 4π times the weight that scatters towards the camera and gets to the surface, of every column.
    pub seen: Vec<f64>,
    pub tally: Tally,
}

impl<'a> Walk<'a> {
    pub fn new(world: &'a World<'a>, rng: ChaCha8Rng) -> Self {
        let seen = vec![0.0; world.voxels.column.len()];
        Self { world, rng, waiting: Vec::new(), seen, tally: Tally::default() }
    }

    /// Sends photons onto the lit face, spread evenly over the power of its cells.
    pub fn light(&mut self, irradiance: &[f64], photons: u64) {
        let total: f64 = irradiance.iter().sum();
        let nx = self.world.voxels.cells[0];
        let (mut cell, mut below) = (0, 0.0);
        for photon in 0..photons {
            let share: f64 = self.rng.random();
            let goal = (photon as f64 + share) / photons as f64 * total;
            while cell + 1 < irradiance.len() && below + irradiance[cell] <= goal {
                below += irradiance[cell];
                cell += 1;
            }
            let corner = [(cell % nx) as f32, (cell / nx) as f32];
            self.send(corner);
        }
    }

    /// One photon into the cell of the lit face with that corner.
    fn send(&mut self, corner: [f32; 2]) {
        let World { surface, .. } = self.world;
        let (depth, inwards) = match self.world.lit {
            Face::Front => (0.0, 1.0),
            Face::Back => (self.world.voxels.cells[2] as f32, -1.0),
        };
        let at =
            [corner[0] + self.rng.random::<f32>(), corner[1] + self.rng.random::<f32>(), depth];
        let (direction, reflected) = match self.world.illumination {
            Illumination::Collimated => ([0.0, 0.0, inwards], surface.normal_reflectance),
            Illumination::Diffuse => {
                // Lambert: the square of the cosine is spread evenly.
                let outside = self.rng.random::<f32>().sqrt();
                let inside = surface.entering(outside);
                let sine = (1.0 - inside * inside).max(0.0).sqrt();
                let [x, y]: [f32; 2] = UnitCircle.sample(&mut self.rng);
                ([sine * x, sine * y, inside * inwards], surface.outer_reflectance(outside))
            }
        };
        let weight = 1.0 - reflected;
        self.tally.entered += f64::from(weight);
        self.follow(Photon { at, direction, weight });
        while let Some(photon) = self.waiting.pop() {
            self.follow(photon);
        }
    }

    /// Follows a photon to its end, by Woodcock's tracking: free paths through a block of the
    /// majorant extinction everywhere, in which all that is too much of it is fictitious.
    fn follow(&mut self, mut photon: Photon) {
        let World { voxels, .. } = self.world;
        let cells = voxels.cells;
        let last = cells.map(|n| n as i32 - 1);
        let size = cells.map(|n| n as f32);
        let per_path = voxels.spacing_mm.map(|h| 1.0 / (h as f32 * voxels.majorant));
        let plane = cells[0] * cells[1];
        loop {
            let path: f32 = Exp1.sample(&mut self.rng);
            let step: [f32; 3] = std::array::from_fn(|a| photon.direction[a] * per_path[a] * path);
            let next: [f32; 3] = std::array::from_fn(|a| photon.at[a] + step[a]);
            if (0..3).any(|a| next[a] < 0.0 || next[a] > size[a]) {
                if !self.meets_surface(&mut photon, step, next, size) {
                    return;
                }
                // Free paths have no memory: the next one begins here.
                continue;
            }
            photon.at = next;
            let cell: [usize; 3] = std::array::from_fn(|a| (next[a] as i32).min(last[a]) as usize);
            let column = cell[1] * cells[0] + cell[0];
            let voxel = voxels.voxels[cell[2] * plane + column];
            if voxel.real < 1.0 && self.rng.random::<f32>() >= voxel.real {
                continue;
            }
            let scattered = photon.weight * voxel.albedo;
            self.tally.absorbed += f64::from(photon.weight - scattered);
            photon.weight = scattered;
            let above = voxel.above + voxel.depth * (next[2] - cell[2] as f32);
            self.show(&photon, column, above);
            if !self.keep(&mut photon, cell[2]) {
                return;
            }
            photon.direction = self.scatter(photon.direction);
        }
    }

    /// Next-event estimate of one collision: scattered straight to the camera, or to the back face,
    /// reflected there, and then to the camera.
    fn show(&mut self, photon: &Photon, column: usize, above: f32) {
        let World { voxels, surface, .. } = self.world;
        let along = photon.direction[2];
        let mut seen = self.phase(-along) * (-above).exp();
        if !surface.matched() {
            let way = 2.0 * voxels.column[column] - above;
            seen += self.phase(along) * surface.normal_reflectance * (-way).exp();
        }
        self.seen[column] += f64::from(photon.weight * seen);
    }

    /// 4π times the phase function (Henyey–Greenstein) at the cosine of the angle of deflection.
    fn phase(&self, cosine: f32) -> f32 {
        let g = self.world.anisotropy;
        if g == 0.0 {
            return 1.0;
        }
        let base = 1.0 + g * g - 2.0 * g * cosine;
        (1.0 - g * g) / (base * base.sqrt())
    }

    /// Holds the photon to the weight window of its depth: false where roulette ends it; where it
    /// is split, the others wait.
    fn keep(&mut self, photon: &mut Photon, layer: usize) -> bool {
        let [low, survivor, high] = WINDOW;
        let worth = photon.weight * self.world.importance[layer];
        if worth < low {
            let chance = worth / survivor;
            let before = photon.weight;
            if self.rng.random::<f32>() >= chance {
                self.tally.roulette += f64::from(before);
                return false;
            }
            photon.weight = before / chance;
            self.tally.roulette += f64::from(before - photon.weight);
        } else if worth > high {
            let parts = worth.min(MOST_SPLIT).floor();
            photon.weight /= parts;
            for _ in 1..parts as u32 {
                let direction = self.scatter(photon.direction);
                self.waiting.push(Photon { direction, ..*photon });
            }
        }
        true
    }

    fn scatter(&mut self, from: [f32; 3]) -> [f32; 3] {
        let g = self.world.anisotropy;
        if g == 0.0 {
            return UnitSphere.sample(&mut self.rng);
        }
        // Henyey and Greenstein 1941; the inverse of its cumulative distribution.
        let ratio = (1.0 - g * g) / (1.0 - g + 2.0 * g * self.rng.random::<f32>());
        let cosine = ((1.0 + g * g - ratio * ratio) / (2.0 * g)).clamp(-1.0, 1.0);
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let [c, s]: [f32; 2] = UnitCircle.sample(&mut self.rng);
        turned(from, cosine, sine * c, sine * s)
    }

    /// A photon that would step out: brought to the face that it meets first, and reflected there
    /// or let out. True if it goes on.
    fn meets_surface(
        &mut self,
        photon: &mut Photon,
        step: [f32; 3],
        next: [f32; 3],
        size: [f32; 3],
    ) -> bool {
        let way = |a: usize| {
            let face = if next[a] < 0.0 { 0.0 } else { size[a] };
            ((face - photon.at[a]) / step[a]).clamp(0.0, 1.0)
        };
        let outside = (0..3).filter(|&a| next[a] < 0.0 || next[a] > size[a]);
        let Some((axis, share)) = outside.map(|a| (a, way(a))).min_by(|a, b| a.1.total_cmp(&b.1))
        else {
            return true;
        };
        for a in 0..3 {
            photon.at[a] = (photon.at[a] + share * step[a]).clamp(0.0, size[a]);
        }
        let high = next[axis] > 0.0;
        photon.at[axis] = if high { size[axis] } else { 0.0 };
        let cosine = photon.direction[axis].abs();
        let mirror = axis < 2 && self.world.mirrored_sides;
        let reflectance = if mirror { 1.0 } else { self.world.surface.inner_reflectance(cosine) };
        if reflectance > 0.0 && self.rng.random::<f32>() < reflectance {
            photon.direction[axis] = -photon.direction[axis];
            return true;
        }
        let side = match (axis, high) {
            (2, false) => 0,
            (2, true) => 1,
            _ => 2,
        };
        self.tally.left[side] += f64::from(photon.weight);
        false
    }
}

/// A unit vector deflected from `from` by the angle of that cosine, towards x and y of a frame
/// around it.
fn turned(from: [f32; 3], cosine: f32, x: f32, y: f32) -> [f32; 3] {
    // Duff et al. 2017: a frame around a vector without a branch that could lose precision.
    let [fx, fy, fz] = from;
    let sign = 1.0_f32.copysign(fz);
    let a = -1.0 / (sign + fz);
    let b = fx * fy * a;
    let (u, v) = ([1.0 + sign * fx * fx * a, sign * b, -sign * fx], [b, sign + fy * fy * a, -fy]);
    let mut out: [f32; 3] = std::array::from_fn(|i| cosine * from[i] + x * u[i] + y * v[i]);
    // Hundreds of turns in a row must not stretch it.
    let scale = 1.0 / out.iter().map(|d| d * d).sum::<f32>().sqrt();
    out.iter_mut().for_each(|d| *d *= scale);
    out
}
