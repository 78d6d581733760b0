//! Camera pictures laid onto the cells of the sample's front face.

use rayon::prelude::*;

use crate::error::{CalibrationError, Result};
use crate::geometry::face::FacePlane;
use crate::radiometry::hdr::HdrImage;

/// A picture on the face's grid: one value per cell and channel.
///
/// Stored x fastest, then y, channel slowest: `channels · nx · ny` values. Cell (i, j) covers
/// [i·hx, (i+1)·hx] × [j·hy, (j+1)·hy] of the sample frame. `variance` is infinite where a cell
/// could not be measured: it leaves the picture or touches clipped pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct FaceMap {
    /// Cells along x.
    pub nx: usize,
    /// Cells along y.
    pub ny: usize,
    /// 1 or 3 (R, G, B).
    pub channels: usize,
    /// Mean radiance of each cell, in the picture's unit.
    pub radiance: Vec<f32>,
    /// Variance of that mean, for independent pixels.
    pub variance: Vec<f32>,
}

/// Averages a picture over `cells` = [nx, ny] cells of `spacing_mm` = [hx, hy] on the face.
///
/// Each cell is sampled at k × k evenly spaced points with bilinear interpolation, k being twice
/// its extent in pixels (2 to 64), so that every pixel inside weighs about its share of the cell
/// and a cell smaller than a pixel is interpolated. The points' weights are gathered per pixel
/// before the variance is propagated: Σ c² var.
///
/// # Errors
/// A picture of another size than the camera's, or an empty grid.
pub fn rectify(
    image: &HdrImage,
    face: &FacePlane,
    cells: [usize; 2],
    spacing_mm: [f64; 2],
) -> Result<FaceMap> {
    let ([nx, ny], [hx, hy]) = (cells, spacing_mm);
    let samples = image.width * image.height * image.channels;
    if (image.width, image.height) != (face.device.width, face.device.height)
        || image.radiance.len() != samples
        || image.variance.len() != samples
    {
        return Err(CalibrationError::Mismatch {
            picture: "picture to rectify".into(),
            expected: format!("{}x{} pixels as calibrated", face.device.width, face.device.height),
            found: format!("{}x{} pixels", image.width, image.height),
        });
    }
    if nx == 0 || ny == 0 || !(hx > 0.0 && hy > 0.0) {
        return Err(CalibrationError::BadInput {
            what: "face grid".into(),
            expected: "at least one cell of positive size".into(),
            found: format!("{nx}x{ny} cells of {hx}x{hy} mm"),
        });
    }
    let channels = image.channels;
    let cells: Vec<[(f32, f32); 3]> = (0..nx * ny)
        .into_par_iter()
        .map_init(Footprint::default, |footprint, cell| {
            let corner = [(cell % nx) as f64 * hx, (cell / nx) as f64 * hy];
            if footprint.gather(image, face, corner, [hx, hy]) {
                footprint.average(image)
            } else {
                [(0.0, f32::INFINITY); 3]
            }
        })
        .collect();
    let plane = |pick: fn((f32, f32)) -> f32| {
        (0..channels).flat_map(|c| cells.iter().map(move |cell| pick(cell[c]))).collect()
    };
    let (radiance, variance) = (plane(|(value, _)| value), plane(|(_, variance)| variance));
    Ok(FaceMap { nx, ny, channels, radiance, variance })
}

/// How much each pixel contributes to one cell.
#[derive(Default)]
struct Footprint {
    left: usize,
    top: usize,
    width: usize,
    weights: Vec<f64>,
    places: Vec<[f64; 2]>,
}

impl Footprint {
    /// False where the cell is not wholly in the picture.
    fn gather(
        &mut self,
        image: &HdrImage,
        face: &FacePlane,
        [x, y]: [f64; 2],
        [hx, hy]: [f64; 2],
    ) -> bool {
        let outline = [[x, y], [x + hx, y], [x, y + hy], [x + hx, y + hy]];
        let mut corners = [[0.0; 2]; 4];
        for (pixel, place) in corners.iter_mut().zip(outline) {
            match face.face_to_pixel(place) {
                Some(seen) => *pixel = seen,
                None => return false,
            }
        }
        let limit = [image.width as f64 - 1.0, image.height as f64 - 1.0];
        let inside = |p: &[f64; 2]| (0..2).all(|a| p[a] >= 0.0 && p[a] <= limit[a]);
        let far = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
        let extent = far(corners[0], corners[3]).max(far(corners[1], corners[2]));
        let k = ((2.0 * extent).ceil()).clamp(2.0, 64.0) as usize;
        self.places.clear();
        for i in 0..k * k {
            let (s, t) = ((i % k) as f64 + 0.5, (i / k) as f64 + 0.5);
            let place = [x + hx * s / k as f64, y + hy * t / k as f64];
            match face.face_to_pixel(place).filter(inside) {
                Some(pixel) => self.places.push(pixel),
                None => return false,
            }
        }
        if !corners.iter().all(inside) {
            return false;
        }
        self.spread(image);
        true
    }

    fn spread(&mut self, image: &HdrImage) {
        let (mut low, mut high) = ([usize::MAX; 2], [0_usize; 2]);
        let base = |p: &[f64; 2]| {
            let last = [image.width.saturating_sub(2), image.height.saturating_sub(2)];
            [(p[0] as usize).min(last[0]), (p[1] as usize).min(last[1])]
        };
        for p in &self.places {
            let at = base(p);
            for a in 0..2 {
                low[a] = low[a].min(at[a]);
                high[a] = high[a].max(at[a] + 1);
            }
        }
        [self.left, self.top] = low;
        self.width = high[0] - low[0] + 1;
        self.weights.clear();
        self.weights.resize(self.width * (high[1] - low[1] + 1), 0.0);
        let share = 1.0 / self.places.len() as f64;
        for p in &self.places {
            let [u, v] = base(p);
            let (fu, fv) = (p[0] - u as f64, p[1] - v as f64);
            let at = (v - self.top) * self.width + (u - self.left);
            self.weights[at] += share * (1.0 - fu) * (1.0 - fv);
            self.weights[at + 1] += share * fu * (1.0 - fv);
            self.weights[at + self.width] += share * (1.0 - fu) * fv;
            self.weights[at + self.width + 1] += share * fu * fv;
        }
    }

    fn average(&self, image: &HdrImage) -> [(f32, f32); 3] {
        let mut cell = [(0.0, 0.0); 3];
        for (i, &weight) in self.weights.iter().enumerate() {
            if weight <= 0.0 {
                continue;
            }
            let (u, v) = (self.left + i % self.width, self.top + i / self.width);
            let at = (v * image.width + u) * image.channels;
            for (c, (mean, variance)) in cell.iter_mut().take(image.channels).enumerate() {
                *mean += weight * f64::from(image.radiance[at + c]);
                *variance += weight * weight * f64::from(image.variance[at + c]);
            }
        }
        cell.map(|(mean, variance)| (mean as f32, variance as f32))
    }
}
