//! Radiance with its variance, picture by picture.

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::radiometry::response::Response;

/// A merged picture: radiance and variance for every sample.
///
/// Radiance is in linearised full scales per second: a sample that just fills a linear sensor in
/// 1 s has radiance 1. `variance` is in the square of that; infinite where the scene was beyond
/// the range of every exposure (the radiance is then a lower bound) or the file had no number.
#[derive(Clone, Debug, PartialEq)]
pub struct HdrImage {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// 1 (grey) or 3 (R, G, B).
    pub channels: usize,
    /// Row by row, channels interleaved: `width · height · channels` samples, all finite.
    pub radiance: Vec<f32>,
    /// Same layout; positive, possibly infinite.
    pub variance: Vec<f32>,
    /// Whether `variance` was measured; else it is 1 wherever the radiance is finite.
    pub variance_known: bool,
    /// Pixels that are clipped in some channel even in the shortest exposure.
    pub clipped_shortest: usize,
    /// Pixels that drown in read noise in every channel even in the longest exposure.
    pub lost_longest: usize,
}

impl HdrImage {
    /// One picture through a response, in linearised full scales (exposure time 1 s). Samples at
    /// full scale have infinite variance.
    ///
    /// # Errors
    /// A picture whose samples do not match its size or the response's channels.
    pub fn from_photo(photo: &Photo, response: &Response) -> Result<Self> {
        photo.check()?;
        if response.channels() != photo.channels {
            return Err(CalibrationError::Mismatch {
                picture: photo.name.clone(),
                expected: format!("{} channel(s) as in the response", response.channels()),
                found: photo.shape(),
            });
        }
        let full = f64::from(photo.max_value);
        // JPEG leaves clipped places a little below full scale.
        let clipped = |&code: &u16| if f64::from(code) > 0.99 * full { f32::INFINITY } else { 1.0 };
        let radiance = photo.data.iter().enumerate().map(|(i, &code)| {
            response.linearise(f64::from(code) / full, i % photo.channels) as f32
        });
        Ok(Self {
            width: photo.width,
            height: photo.height,
            channels: photo.channels,
            radiance: radiance.collect(),
            variance: photo.data.iter().map(clipped).collect(),
            variance_known: false,
            clipped_shortest: 0,
            lost_longest: 0,
        })
    }

    /// Samples with a finite radiance over all samples: 1 unless something is broken.
    pub fn finite_share(&self) -> f64 {
        share(&self.radiance, |v| v.is_finite())
    }

    /// Samples that some exposure measured within its range, over all samples.
    pub fn measured_share(&self) -> f64 {
        share(&self.variance, |v| v.is_finite())
    }
}

fn share(values: &[f32], test: impl Fn(f32) -> bool) -> f64 {
    values.iter().filter(|v| test(**v)).count() as f64 / values.len().max(1) as f64
}
