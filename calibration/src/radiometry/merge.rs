//! Merging a bracket into radiance with the least variance.
//!
//! Every exposure i gives L_i = x_i / t_i with x_i the linearised code above black, and
//! var(L_i) = (gain/full · x + (dx/dcode)² (read² + 1/12)/full²) / t_i². The merge is
//! L = Σ w_i L_i / Σ w_i, w_i = 1/var(L_i), var(L) = 1/Σ w_i.
//!
//! The photon term needs the very signal that is being measured. Putting in the pixel's own code
//! would give low codes more weight and pull the dark down by about an electron; putting in the
//! mean of its 5 × 5 neighbours leaves 1/25 of that, and where the picture is not smooth costs a
//! little variance but no bias. Frames are taken one at a time; memory holds three floats a sample.

use rayon::prelude::*;

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::radiometry::hdr::HdrImage;
use crate::radiometry::noise::NoiseModel;
use crate::radiometry::response::Response;

/// Half width of the neighbourhood whose mean sets the weights.
const REACH: usize = 2;

/// Takes the exposures of a bracket one by one.
pub struct Merger<'a> {
    response: &'a Response,
    noise: NoiseModel,
    shape: Option<Photo>,
    sums: Vec<Sums>,
    times: Vec<f64>,
    clipped: (f64, usize),
    lost: (f64, usize),
}

#[derive(Clone, Copy, Default)]
struct Sums {
    weighted: f32,
    weight: f32,
    at_least: f32,
}

/// Exposure and slope of every code of one channel.
struct Table {
    exposure: Vec<f32>,
    dark_variance: Vec<f32>,
}

impl<'a> Merger<'a> {
    /// A merge that knows the camera.
    ///
    /// # Errors
    /// A noise model that makes no sense.
    pub fn new(response: &'a Response, noise: &NoiseModel) -> Result<Self> {
        noise.check()?;
        Ok(Self {
            response,
            noise: *noise,
            shape: None,
            sums: Vec::new(),
            times: Vec::new(),
            clipped: (f64::INFINITY, 0),
            lost: (0.0, 0),
        })
    }

    /// Adds an exposure of `exposure_s` seconds.
    ///
    /// # Errors
    /// A shape, depth or channel count that differs from the frames before, the response or the
    /// noise model; an exposure time that is not positive.
    pub fn add(&mut self, photo: &Photo, exposure_s: f64) -> Result<()> {
        self.check(photo, exposure_s)?;
        let channels = photo.channels;
        let tables: Vec<Table> = (0..channels).map(|c| self.table(c)).collect();
        let shot = (self.noise.gain / self.noise.full_scale) as f32;
        let time = exposure_s as f32;
        let sigma = self.noise.variance(self.noise.saturation - self.noise.black_level).sqrt();
        // A mean this close to saturation has neighbours over it: what is left of the pixel's
        // own codes would be the lower half only.
        let nearly = (self.noise.saturation - 3.0 * sigma) as f32;
        let saturation = self.noise.saturation as f32;
        let dark = (self.noise.black_level + self.noise.read_noise) as f32;
        let row = photo.width * channels;
        let (clipped, lost) = self
            .sums
            .par_chunks_mut(row)
            .enumerate()
            .map_init(
                || vec![0.0_f32; row],
                |means, (y, sums)| {
                    neighbourhood_means(photo, y, means);
                    let codes = &photo.data[y * row..(y + 1) * row];
                    let mut counts = (0_usize, 0_usize);
                    for (x, pixel) in sums.chunks_exact_mut(channels).enumerate() {
                        let (mut any_clipped, mut all_lost) = (false, true);
                        for (c, sum) in pixel.iter_mut().enumerate() {
                            let (code, mean) = (codes[x * channels + c], means[x * channels + c]);
                            let table = &tables[c];
                            let radiance = table.exposure[usize::from(code)] / time;
                            all_lost &= mean <= dark;
                            if f32::from(code) >= saturation || mean >= nearly {
                                any_clipped = true;
                                sum.at_least = sum.at_least.max(radiance);
                                continue;
                            }
                            let typical = mean.round() as usize;
                            let variance = shot * table.exposure[typical].max(0.0)
                                + table.dark_variance[typical];
                            let weight = time * time / variance;
                            sum.weighted += weight * radiance;
                            sum.weight += weight;
                        }
                        counts.0 += usize::from(any_clipped);
                        counts.1 += usize::from(all_lost);
                    }
                    counts
                },
            )
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        if exposure_s < self.clipped.0 {
            self.clipped = (exposure_s, clipped);
        }
        if exposure_s > self.lost.0 {
            self.lost = (exposure_s, lost);
        }
        self.times.push(exposure_s);
        Ok(())
    }

    /// The merged picture.
    ///
    /// # Errors
    /// Fewer than two exposures.
    pub fn finish(self) -> Result<HdrImage> {
        let (Some(shape), 2..) = (self.shape, self.times.len()) else {
            return Err(CalibrationError::BadBracket {
                expected: "at least two exposures",
                found: format!("{} exposure(s)", self.times.len()),
            });
        };
        let (radiance, variance) = self
            .sums
            .into_par_iter()
            .map(|sum| {
                if sum.weight > 0.0 {
                    (sum.weighted / sum.weight, 1.0 / sum.weight)
                } else {
                    (sum.at_least, f32::INFINITY)
                }
            })
            .unzip();
        Ok(HdrImage {
            width: shape.width,
            height: shape.height,
            channels: shape.channels,
            radiance,
            variance,
            variance_known: true,
            clipped_shortest: self.clipped.1,
            lost_longest: self.lost.1,
        })
    }

    fn check(&mut self, photo: &Photo, exposure_s: f64) -> Result<()> {
        photo.check()?;
        let mismatch = |expected: String, found: String| CalibrationError::Mismatch {
            picture: photo.name.clone(),
            expected,
            found,
        };
        if !(exposure_s.is_finite() && exposure_s > 0.0) {
            let found = format!("{exposure_s} s");
            return Err(mismatch("a positive exposure time".into(), found));
        }
        if self.response.channels() != photo.channels {
            let expected = format!("{} channel(s) as in the response", self.response.channels());
            return Err(mismatch(expected, photo.shape()));
        }
        if self.noise.full_scale != f64::from(photo.max_value) {
            let expected = format!("full scale {} as in the noise model", self.noise.full_scale);
            return Err(mismatch(expected, photo.max_value.to_string()));
        }
        match &self.shape {
            Some(first) if first.shape() != photo.shape() => {
                Err(mismatch(format!("{} as in {}", first.shape(), first.name), photo.shape()))
            }
            Some(_) => Ok(()),
            None => {
                self.sums = vec![Sums::default(); photo.samples()];
                self.shape = Some(Photo { data: Vec::new(), ..photo.clone() });
                Ok(())
            }
        }
    }

    fn table(&self, channel: usize) -> Table {
        let full = self.noise.full_scale;
        let black = self.response.linearise(self.noise.black_level / full, channel);
        let codes = 0..=full as usize;
        let exposure = codes
            .clone()
            .map(|v| (self.response.linearise(v as f64 / full, channel) - black) as f32);
        let dark_variance = codes.map(|v| {
            let slope = self.response.slope(v as f64 / full, channel);
            (slope * slope * self.noise.dark_variance() / (full * full)) as f32
        });
        Table { exposure: exposure.collect(), dark_variance: dark_variance.collect() }
    }
}

/// Merges a bracket, frame by frame as the iterator yields them.
///
/// # Errors
/// What the iterator yields as an error, and as [`Merger::new`], [`Merger::add`] and
/// [`Merger::finish`].
pub fn merge<E: From<CalibrationError>>(
    frames: impl IntoIterator<Item = std::result::Result<(Photo, f64), E>>,
    response: &Response,
    noise: &NoiseModel,
) -> std::result::Result<HdrImage, E> {
    let mut merger = Merger::new(response, noise)?;
    for frame in frames {
        let (photo, exposure_s) = frame?;
        merger.add(&photo, exposure_s)?;
    }
    Ok(merger.finish()?)
}

/// Mean code of the neighbourhood of every sample in row `y`, cut off at the picture's edges.
fn neighbourhood_means(photo: &Photo, y: usize, means: &mut [f32]) {
    let (n, row) = (photo.channels, photo.width * photo.channels);
    let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(photo.height);
    let tall = rows.len();
    let mut columns = vec![0_u32; row];
    for line in photo.data[rows.start * row..rows.end * row].chunks_exact(row) {
        columns.iter_mut().zip(line).for_each(|(sum, &v)| *sum += u32::from(v));
    }
    for c in 0..n {
        let mut sum: u32 = (0..REACH.min(photo.width)).map(|x| columns[x * n + c]).sum();
        for x in 0..photo.width {
            if x + REACH < photo.width {
                sum += columns[(x + REACH) * n + c];
            }
            if x > REACH {
                sum -= columns[(x - REACH - 1) * n + c];
            }
            let wide = (x + REACH + 1).min(photo.width) - x.saturating_sub(REACH);
            means[x * n + c] = sum as f32 / (tall * wide) as f32;
        }
    }
}
