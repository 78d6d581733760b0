//! What the camera sees: radiance of every pixel for a target and a projector image.

use crate::targets::FlatTarget;
use crate::transport::{LitBlock, Transport};
use crate::{Imperfections, OpticalSetup, SampleSpec, TransportError};
use diffusion::{IlluminationError, Medium, MediumError, SolveError};
use glam::{DVec2, DVec3};
use material::{Face, Grid, GridError, Optics};
use rayon::prelude::*;
use rig::{ProjectorImage, Target};

/// Irradiance of the room on everything, in units of projector white.
const AMBIENT: f64 = 2e-4;
/// Rays along each edge of a camera pixel.
const SAMPLES: u32 = 3;
const PER_PIXEL: usize = (SAMPLES * SAMPLES) as usize;
/// Rays along each edge of a fine cell of the lit face.
const FACE_SAMPLES: u32 = 4;
/// Radiance of the light panel that fills the camera's picture.
const PANEL: f64 = 0.15;

/// Why a scene cannot be rendered.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SceneError {
    #[error(transparent)]
    Medium(#[from] MediumError),
    #[error(transparent)]
    Grid(#[from] GridError),
    #[error(transparent)]
    Light(#[from] IlluminationError),
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error(transparent)]
    Transport(#[from] TransportError),
}

/// The sample and the optics around it.
pub(crate) struct Scene {
    pub setup: OpticalSetup,
    block: LitBlock,
    /// Diffuse reflectance of the bare surface, red, green and blue, on the fine grid's front face;
    /// empty where the sample is lit from the back, and nobody sees it.
    surface: Vec<Vec<f64>>,
    seed: u64,
    /// Unit direction of every sub-pixel of the camera.
    rays: Vec<DVec3>,
    /// Light of the projector at each input byte.
    light: Vec<[f64; 3]>,
    vignette: f64,
}

impl Scene {
    /// The sample on a grid `refinement` times finer, along each axis, than the one it is
    /// solved on.
    pub fn new(
        sample: &SampleSpec,
        lit: Face,
        rig: &Imperfections,
        refinement: usize,
        transport: Transport,
    ) -> Result<Self, SceneError> {
        let coarse = sample.solved_grid();
        let fine = Grid::new(
            coarse.cells().map(|n| n * refinement),
            coarse.spacing_mm().map(|h| h / refinement as f64),
        )?;
        let media = (0..3).map(|c| sample.medium(&fine, c)).collect::<Result<_, _>>()?;
        let surface = match lit {
            Face::Front => (0..3).map(|c| sample.surface_reflectance(&fine, c)).collect(),
            Face::Back => Vec::new(),
        };
        let block = LitBlock::new(media, Optics::from_eta(sample.eta()), lit, transport)?;
        let setup = OpticalSetup::new(sample, lit, rig);
        let [width, height] = setup.camera.size;
        let rays = (0..height)
            .into_par_iter()
            .flat_map_iter(|y| (0..width).flat_map(move |x| sub_samples(x, y, SAMPLES)))
            .map(|pixel| setup.camera.ray(pixel))
            .collect();
        Ok(Self {
            setup,
            block,
            surface,
            seed: sample.seed,
            rays,
            light: rig.projector_light(),
            vignette: rig.vignette,
        })
    }

    /// True coefficients, one medium a channel, on the fine grid.
    pub fn media(&self) -> &[Medium] {
        self.block.media()
    }

    /// True reflectance of the bare surface, one map a channel, on the fine grid's front face; none
    /// where it is not lit.
    pub fn surface(&self) -> &[Vec<f64>] {
        &self.surface
    }

    /// How light gets in and out.
    pub fn optics(&self) -> Optics {
        *self.block.optics()
    }

    /// Radiance of every camera pixel, three interleaved channels.
    pub fn render(&self, target: &Target, image: &ProjectorImage) -> Result<Vec<f32>, SceneError> {
        match target {
            Target::Dark => return Ok(vec![0.0; 3 * self.rays.len() / PER_PIXEL]),
            Target::Flat => return Ok(self.gather(|_| [PANEL; 3])),
            _ => {}
        }
        match FlatTarget::new(target, &self.setup) {
            Some(flat) => Ok(self.gather(|ray| {
                let Some((point, at)) = flat.hit(self.setup.camera.position, ray) else {
                    return [0.0; 3];
                };
                let light = self.irradiance(point, flat.normal(), image);
                let albedo = flat.albedo(at);
                std::array::from_fn(|c| albedo[c] * (light[c] / std::f64::consts::PI))
            })),
            None => self.render_sample(image),
        }
    }

    fn render_sample(&self, image: &ProjectorImage) -> Result<Vec<f32>, SceneError> {
        let mut hash = blake3::Hasher::new();
        hash.update(b"photons").update(&self.seed.to_le_bytes()).update(&image.data);
        let seed = *hash.finalize().as_bytes();
        let exit = self.block.exit_radiance(|| self.face_irradiance(image), seed)?;
        let grid = self.media()[0].grid();
        let [nx, ny, _] = grid.cells();
        let [hx, hy, _] = grid.spacing_mm();
        let camera = self.setup.camera.position;
        Ok(self.gather(|ray| {
            let point = camera + ray * (-camera.z / ray.z);
            let at = DVec2::new(point.x / hx, point.y / hy);
            if at.min_element() < 0.0 || at.x >= nx as f64 || at.y >= ny as f64 {
                let Some(albedo) = self.setup.tile_albedo(point.x, point.y) else {
                    return [0.0; 3];
                };
                let light = self.irradiance(point, DVec3::Z, image);
                return light.map(|light| albedo * light / std::f64::consts::PI);
            }
            let mut out = interpolate(&exit, [nx, ny], at - 0.5);
            if !self.surface.is_empty() {
                let light = self.irradiance(point, DVec3::Z, image);
                let surface = interpolate(&self.surface, [nx, ny], at - 0.5);
                (0..3).for_each(|c| out[c] += surface[c] * (light[c] / std::f64::consts::PI));
            }
            out
        }))
    }

    /// Irradiance of the lit face's fine cells, red, green and blue.
    fn face_irradiance(&self, image: &ProjectorImage) -> Vec<[f64; 3]> {
        let grid = self.media()[0].grid();
        let [nx, _, _] = grid.cells();
        let [hx, hy, _] = grid.spacing_mm();
        let z = match self.setup.lit_face {
            Face::Front => 0.0,
            Face::Back => self.setup.block_mm[2],
        };
        (0..grid.face_len())
            .into_par_iter()
            .map(|i| {
                let points = sub_samples((i % nx) as u32, (i / nx) as u32, FACE_SAMPLES);
                let mut sum = [0.0; 3];
                for p in points {
                    let point = DVec3::new((p.x + 0.5) * hx, (p.y + 0.5) * hy, z);
                    let light = self.irradiance(point, DVec3::Z, image);
                    (0..3).for_each(|c| sum[c] += light[c]);
                }
                sum.map(|s| s / f64::from(FACE_SAMPLES * FACE_SAMPLES))
            })
            .collect()
    }

    /// Irradiance at a point of a surface: projector and room. White at the middle of the lit
    /// face is 1; distance, obliquity and the projector's own vignetting take from it.
    fn irradiance(&self, point: DVec3, normal: DVec3, image: &ProjectorImage) -> [f64; 3] {
        let lens = &self.setup.projector;
        let Some(pixel) = lens.project(point) else { return [AMBIENT; 3] };
        let (x, y) = (pixel.x.round(), pixel.y.round());
        let [width, height] = lens.size.map(f64::from);
        if !(0.0..width).contains(&x) || !(0.0..height).contains(&y) {
            return [AMBIENT; 3];
        }
        let byte = image.data[y as usize * lens.size[0] as usize + x as usize];
        let [w, h, d] = self.setup.block_mm;
        let middle =
            DVec3::new(w / 2.0, h / 2.0, if self.setup.lit_face == Face::Back { d } else { 0.0 });
        let falloff = |p: DVec3, n: DVec3| {
            let v = p - lens.position;
            v.dot(n).abs() / v.length().powi(3)
        };
        let off_centre = (pixel - DVec2::new(width, height) / 2.0).length() / width;
        let vignette = 1.0 - 0.3 * off_centre * off_centre;
        let light = self.light[usize::from(byte)];
        light.map(|l| AMBIENT + l * vignette * falloff(point, normal) / falloff(middle, DVec3::Z))
    }

    /// Averages `radiance(ray)` over the sub-pixels of every camera pixel.
    fn gather(&self, radiance: impl Fn(DVec3) -> [f64; 3] + Sync) -> Vec<f32> {
        let [width, height] = self.setup.camera.size.map(f64::from);
        let middle = DVec2::new(width, height) / 2.0;
        self.rays
            .par_chunks(PER_PIXEL)
            .enumerate()
            .flat_map_iter(|(i, rays)| {
                let mut sum = [0.0; 3];
                for ray in rays {
                    let l = radiance(*ray);
                    (0..3).for_each(|c| sum[c] += l[c]);
                }
                let at = DVec2::new((i % width as usize) as f64, (i / width as usize) as f64);
                let corner = (at - middle).length_squared() / middle.length_squared();
                let scale = (1.0 - self.vignette * corner) / PER_PIXEL as f64;
                sum.map(|s| (s * scale) as f32)
            })
            .collect()
    }
}

/// Positions of n × n samples inside pixel (x, y), the pixel's centre being (x, y).
fn sub_samples(x: u32, y: u32, n: u32) -> impl Iterator<Item = DVec2> {
    let offset = move |i: u32| (f64::from(i) + 0.5) / f64::from(n) - 0.5;
    (0..n * n).map(move |k| DVec2::new(f64::from(x) + offset(k % n), f64::from(y) + offset(k / n)))
}

/// Bilinear interpolation in maps of cell means; flat beyond the outermost cell centres.
fn interpolate(maps: &[Vec<f64>], [nx, ny]: [usize; 2], at: DVec2) -> [f64; 3] {
    let at = at.clamp(DVec2::ZERO, DVec2::new(nx as f64 - 1.0, ny as f64 - 1.0));
    let (x, y) = ((at.x as usize).min(nx - 2), (at.y as usize).min(ny - 2));
    let (fx, fy) = (at.x - x as f64, at.y - y as f64);
    let mut out = [0.0; 3];
    for (o, map) in out.iter_mut().zip(maps) {
        let row = |y: usize| map[y * nx + x] * (1.0 - fx) + map[y * nx + x + 1] * fx;
        *o = row(y) * (1.0 - fy) + row(y + 1) * fy;
    }
    out
}
