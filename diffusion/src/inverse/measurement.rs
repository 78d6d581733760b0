//! What the camera saw, on the front face's cells.

use crate::Illuminations;
use crate::resample::FaceOverlap;
use material::Grid;

/// One pixel in this many is kept out of the fit while λ is looked for.
const KEPT_OUT: usize = 10;

/// Measured radiance of one colour channel under a set of patterns.
#[derive(Clone, Debug)]
pub struct Measurement {
    light: Illuminations,
    radiance: Vec<Vec<f64>>,
    /// 1 / variance; 0 where masked; negative where it is kept out of the fit.
    weight: Vec<Vec<f64>>,
}

/// What is wrong with a measurement.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeasurementError {
    /// Not one map a pattern, or a map of another size than the front face.
    #[error("{array} {pattern} has {found} values, {expected} were expected")]
    WrongLength {
        /// `radiance` or `variance`.
        array: &'static str,
        /// Number of the pattern.
        pattern: usize,
        /// Cells of the front face (or number of patterns).
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// NaN or infinity in a radiance that is not masked, or a variance that is NaN or not positive.
    #[error("{array} of pattern {pattern} is {value} in cell (x {x}, y {y})")]
    BadValue {
        /// `radiance` or `variance`.
        array: &'static str,
        /// Number of the pattern.
        pattern: usize,
        /// The value.
        value: f64,
        /// Cell along x.
        x: usize,
        /// Cell along y.
        y: usize,
    },
    /// Nothing is left to fit.
    #[error("all pixels of all patterns are masked")]
    AllMasked,
    /// The images are black.
    #[error("the measured radiance is zero everywhere it is not masked")]
    AllZero,
}

impl Measurement {
    /// Radiance (1/sr times the irradiance unit) and its variance, one map of nx × ny values a
    /// pattern, x fastest. An infinite variance masks a pixel.
    ///
    /// # Errors
    /// Wrong sizes, values that are not numbers, nothing unmasked, or nothing but zeros.
    pub fn new(
        grid: &Grid,
        light: Illuminations,
        radiance: Vec<Vec<f64>>,
        variance: &[Vec<f64>],
    ) -> Result<Self, MeasurementError> {
        for (array, maps) in [("radiance", &radiance[..]), ("variance", variance)] {
            if maps.len() != light.count() {
                let (expected, found) = (light.count(), maps.len());
                let pattern = found.min(expected);
                return Err(MeasurementError::WrongLength { array, pattern, expected, found });
            }
            if let Some(pattern) = maps.iter().position(|m| m.len() != grid.face_len()) {
                let (expected, found) = (grid.face_len(), maps[pattern].len());
                return Err(MeasurementError::WrongLength { array, pattern, expected, found });
            }
        }
        let nx = grid.cells()[0];
        let mut weight = Vec::with_capacity(variance.len());
        for (pattern, (l, v)) in radiance.iter().zip(variance).enumerate() {
            let bad = |array, i: usize, value| {
                let (x, y) = (i % nx, i / nx);
                MeasurementError::BadValue { array, pattern, value, x, y }
            };
            if let Some(i) = v.iter().position(|&v| v.is_nan() || v <= 0.0) {
                return Err(bad("variance", i, v[i]));
            }
            if let Some(i) = (0..l.len()).find(|&i| v[i].is_finite() && !l[i].is_finite()) {
                return Err(bad("radiance", i, l[i]));
            }
            weight.push(v.iter().map(|v| 1.0 / v).collect::<Vec<f64>>());
        }
        let this = Self { light, radiance, weight };
        if this.data() == 0 {
            return Err(MeasurementError::AllMasked);
        }
        if this.energy() == 0.0 {
            return Err(MeasurementError::AllZero);
        }
        Ok(this)
    }

    /// The same images with the same masks, every other pixel weighted alike.
    pub(crate) fn unweighted(&self) -> Self {
        let flat = |w: &Vec<f64>| w.iter().map(|w| if *w > 0.0 { 1.0 } else { 0.0 }).collect();
        Self { weight: self.weight.iter().map(flat).collect(), ..self.clone() }
    }

    /// The same images with (share · peak of the image)² added to every variance.
    pub(crate) fn with_model_error(&self, share: f64) -> Self {
        let images = self.radiance.iter().zip(&self.weight);
        let soften = |(l, w): (&Vec<f64>, &Vec<f64>)| -> Vec<f64> {
            let seen = l.iter().zip(w).filter(|(_, w)| **w > 0.0).map(|(l, _)| *l);
            let floor = (share * seen.fold(0.0, f64::max)).powi(2);
            w.iter().map(|w| if *w > 0.0 { 1.0 / (1.0 / w + floor) } else { 0.0 }).collect()
        };
        Self { weight: images.map(soften).collect(), ..self.clone() }
    }

    /// The same images with every tenth pixel kept out of the fit, to try it on. Which ones it is
    /// changes from pattern to pattern, so that no part of the face is left to itself.
    pub(crate) fn with_pixels_kept_out(&self, grid: &Grid) -> Self {
        let nx = grid.cells()[0];
        let mut out = self.clone();
        for (pattern, map) in out.weight.iter_mut().enumerate() {
            for (i, w) in map.iter_mut().enumerate() {
                if (i % nx + 3 * (i / nx) + 7 * pattern).is_multiple_of(KEPT_OUT) {
                    *w = -*w;
                }
            }
        }
        out
    }

    /// The same images on a coarser grid of the same block. A pixel of which more than half is
    /// masked is masked.
    pub(crate) fn averaged(&self, from: &Grid, to: &Grid) -> Self {
        let overlap = FaceOverlap::new(from, to);
        let mut out = Self {
            light: self.light.averaged(&overlap),
            radiance: Vec::with_capacity(self.radiance.len()),
            weight: Vec::with_capacity(self.weight.len()),
        };
        for (l, w) in self.radiance.iter().zip(&self.weight) {
            let pixel = |cell: &mut dyn Iterator<Item = (usize, f64)>| {
                let (mut seen, mut sum, mut variance) = (0.0, 0.0, 0.0);
                for (i, share) in cell.filter(|(i, _)| w[*i] > 0.0) {
                    seen += share;
                    sum += share * l[i];
                    variance += share * share / w[i];
                }
                if seen > 0.5 { (sum / seen, seen * seen / variance) } else { (0.0, 0.0) }
            };
            let (l, w) = overlap.cells().map(|mut cell| pixel(&mut cell)).unzip();
            out.radiance.push(l);
            out.weight.push(w);
        }
        out
    }

    /// The patterns.
    pub fn light(&self) -> &Illuminations {
        &self.light
    }

    /// Radiance maps.
    pub fn radiance(&self) -> &[Vec<f64>] {
        &self.radiance
    }

    /// 1 / variance; 0 where masked; −1 / variance where kept out of the fit.
    pub(crate) fn weight(&self) -> &[Vec<f64>] {
        &self.weight
    }

    /// (weight, radiance) of every pixel that is fitted.
    fn pixels(&self) -> impl Iterator<Item = (f64, f64)> {
        let maps = self.weight.iter().zip(&self.radiance);
        maps.flat_map(|(w, l)| w.iter().copied().zip(l.iter().copied())).filter(|(w, _)| *w > 0.0)
    }

    /// Number of pixels that are kept out of the fit.
    pub(crate) fn kept_out(&self) -> usize {
        self.weight.iter().flatten().filter(|w| **w < 0.0).count()
    }

    /// Number of pixels that are not masked (and not kept out).
    pub fn data(&self) -> usize {
        self.pixels().count()
    }

    /// Σ L² over pixels that are not masked.
    pub fn energy(&self) -> f64 {
        self.pixels().map(|(_, l)| l * l).sum()
    }

    /// Σ w L².
    pub(crate) fn weighted_energy(&self) -> f64 {
        self.pixels().map(|(w, l)| w * l * l).sum()
    }
}
