//! A simulated block as the camera sees it, one region of its lit face after the other.

use crate::Failure;
use material::Face;
use rig::{Pattern, Target};
use simulator::{SampleSpec, SimulatedRig};

/// Noise-free pictures of the part of the camera's picture that shows the front face.
pub(super) struct View {
    pub width: usize,
    pub height: usize,
    /// Samples that see the face, of `width · height · 3`.
    pub on_face: Vec<bool>,
    /// Radiance under the projector's black, three interleaved channels.
    pub black: Vec<f32>,
    /// What each region adds to it.
    pub regions: Vec<Vec<f32>>,
    /// Pixels along each edge of a cell of the grid that the block is solved on.
    pub cell_px: usize,
}

impl View {
    /// `regions` columns and rows; the pixels of every `step`-th cell along each axis.
    pub fn new(sample: &SampleSpec, regions: [usize; 2], step: u32) -> Result<Self, Failure> {
        let rig = SimulatedRig::new(sample, Face::Back)?;
        let setup = rig.truth().setup;
        let [w, h, depth] = setup.block_mm;
        let to_face = |pixel: [f64; 2]| {
            let (from, ray) = (setup.projector.position, setup.projector.ray(pixel.into()));
            let at = from + ray * ((depth - from.z) / ray.z);
            Some([at.x / w, at.y / h])
        };
        let [columns, rows] = setup.camera.size;
        let sees_face = |x: u32, y: u32| {
            let ray = setup.camera.ray([f64::from(x), f64::from(y)].into());
            let at = setup.camera.position - ray * (setup.camera.position.z / ray.z);
            (0.0..w).contains(&at.x) && (0.0..h).contains(&at.y)
        };
        let all = || (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
        let seen: Vec<(u32, u32)> = all().filter(|&(x, y)| sees_face(x, y)).collect();
        let ends = |pick: fn(&(u32, u32)) -> u32| {
            let values = || seen.iter().map(pick);
            (values().min().unwrap_or(0), values().max().unwrap_or(0) + 1)
        };
        let ((x0, x1), (y0, y1)) = (ends(|p| p.0), ends(|p| p.1));
        let [nx, ny, _] = sample.solved_grid().cells();
        let cell_px = ((seen.len() as f64 / (nx * ny) as f64).sqrt().round() as u32).max(1);
        // Whole cells, so that their means are as noisy as those of all.
        let kept = |from: u32, to: u32| -> Vec<u32> {
            (from..to).filter(|at| ((at - from) / cell_px).is_multiple_of(step.max(1))).collect()
        };
        let (across, down) = (kept(x0, x1), kept(y0, y1));
        let (width, height) = (across.len(), down.len());
        let places: Vec<(u32, u32)> =
            down.iter().flat_map(|&y| across.iter().map(move |&x| (x, y))).collect();
        let crop = |whole: Vec<f32>| -> Vec<f32> {
            let pixel = |&(x, y): &(u32, u32)| 3 * (y as usize * columns as usize + x as usize);
            places.iter().flat_map(|p| whole[pixel(p)..pixel(p) + 3].to_vec()).collect()
        };
        let [px, py] = rig.projector_px();
        let picture = |pattern: &Pattern| -> Result<Vec<f32>, Failure> {
            let image = pattern
                .render(px, py, Some(&to_face))
                .ok_or_else(|| Failure::other("a pattern that does not lie on the face"))?;
            Ok(crop(rig.radiance(&Target::Sample, &image)?))
        };
        let black = picture(&Pattern::Black)?;
        let region = |index| -> Result<Vec<f32>, Failure> {
            let lit = picture(&Pattern::region(regions[0], regions[1], index))?;
            Ok(lit.iter().zip(&black).map(|(l, b)| l - b).collect())
        };
        let lit = (0..regions[0] * regions[1]).map(region).collect::<Result<_, _>>()?;
        Ok(Self {
            width,
            height,
            on_face: places.iter().flat_map(|&(x, y)| [sees_face(x, y); 3]).collect(),
            black,
            regions: lit,
            cell_px: cell_px as usize,
        })
    }

    /// Radiance where the regions are lit that `lit` tells, times `light`.
    pub fn under(&self, light: f64, lit: impl Fn(usize) -> bool) -> Vec<f32> {
        let mut out = self.black.clone();
        for (_, region) in self.regions.iter().enumerate().filter(|(j, _)| lit(*j)) {
            out.iter_mut().zip(region).for_each(|(sum, l)| *sum += l);
        }
        out.iter_mut().for_each(|l| *l = (f64::from(*l) * light) as f32);
        out
    }

    /// Means of `values` over blocks of the size of a cell that lie on the face as a whole,
    /// `[channel][block]`.
    pub fn cells(&self, values: &[f64]) -> [Vec<f64>; 3] {
        let size = self.cell_px;
        let (across, down) = (self.width / size, self.height / size);
        std::array::from_fn(|c| {
            let block = |(i, j): (usize, usize)| {
                let pixels = (0..size).flat_map(|v| (0..size).map(move |u| (u, v)));
                let at = |(u, v)| 3 * ((j * size + v) * self.width + i * size + u) + c;
                let inside = pixels.clone().all(|p| self.on_face[at(p)]);
                let mean = || pixels.map(|p| values[at(p)]).sum::<f64>() / (size * size) as f64;
                inside.then(mean)
            };
            (0..down).flat_map(|j| (0..across).map(move |i| (i, j))).filter_map(block).collect()
        })
    }
}
