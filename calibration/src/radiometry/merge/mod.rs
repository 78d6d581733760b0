//! Merging a bracket into radiance with the least variance that its noise allows.
//!
//! `solve` has the estimator, `sensor` the frame model, `censored` what clipped samples say,
//! `drift` how bright each exposure really was, `strips` the work over a whole picture.

mod censored;
pub(crate) mod drift;
mod sensor;
mod solve;
mod strips;
mod tally;

use std::path::Path;

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::radiometry::hdr::HdrImage;
use crate::radiometry::masters::{FlatField, MasterDark, refuse_other_shape};
use crate::radiometry::noise::NoiseModel;
use crate::radiometry::response::Response;
use crate::radiometry::spool::{Plane, Spool};
use drift::{ExposureCheck, Few};
use sensor::Channel;

/// Pixels that the exposures are compared on.
const FEW: usize = 4096;

/// Dark frames serve exposures of their own time, to this relative difference.
const SAME_TIME: f64 = 0.01;

/// A bracket on its way to radiance: takes the exposures one by one, in any order; several of one
/// time are averaged.
///
/// Every sample's radiance is the maximum of its quasi-likelihood over all exposures, whose
/// variance is read noise², quantisation, photons and, where dark frames are subtracted, theirs;
/// clipped samples count as "at least that much". Frames that memory does not hold wait in a
/// nameless temporary file.
pub struct Merger<'a> {
    response: &'a Response,
    noise: NoiseModel,
    channels: Vec<Channel>,
    spool: Spool,
    shape: Option<Photo>,
    frames: Vec<Frame>,
    darks: Vec<(MasterDarkShape, Plane<f32>)>,
    flat: Option<FlatField>,
    few: Vec<usize>,
}

/// A master dark without its samples.
struct MasterDarkShape {
    exposure_s: f64,
    frames: usize,
    shape: Photo,
    few: Vec<f32>,
    mean: f64,
}

struct Frame {
    name: String,
    time: f64,
    codes: Plane<u16>,
    dark: Dark,
    few: Few,
}

/// What a frame has without light.
#[derive(Clone, Copy)]
enum Dark {
    /// Its black level, as far as anybody knows.
    Unmeasured,
    /// Between two master darks, by their numbers: the second one's share, and the variance.
    Measured { masters: [usize; 2], share: f32, variance: f32 },
}

impl Dark {
    /// Exposure without light of one sample, whose level each master dark has by its number.
    #[inline(always)]
    fn exposure(self, channel: &Channel, level: impl Fn(usize) -> f32) -> f32 {
        match self {
            Dark::Unmeasured => 0.0,
            Dark::Measured { masters: [a, b], share, .. } => {
                let (a, b) = (level(a), level(b));
                channel.exposure_of(a + share * (b - a))
            }
        }
    }
}

/// What a merge found out beside the radiance.
#[derive(Clone, Debug, PartialEq)]
pub struct MergeReport {
    /// Each exposure from the shortest to the longest, under its picture's name.
    pub exposures: Vec<(String, ExposureCheck)>,
    /// Standard deviation of samples around the merged radiance over what the noise model says:
    /// median over samples, None if no sample was seen twice. 1 where the model is right.
    pub noise_ratio: Option<f64>,
    /// Samples whose exposures disagree beyond all noise: something moved. Their variance is
    /// raised by as much.
    pub moved_samples: usize,
    /// Of those how many each exposure disagrees on most, in the order of `exposures`.
    pub moved_by_exposure: Vec<usize>,
}

impl<'a> Merger<'a> {
    /// A merge that knows the camera.
    ///
    /// # Errors
    /// A noise model that makes no sense.
    pub fn new(response: &'a Response, noise: &NoiseModel) -> Result<Self> {
        noise.check()?;
        let channels = (0..response.channels()).map(|c| Channel::new(response, noise, c));
        Ok(Self {
            response,
            noise: *noise,
            channels: channels.collect(),
            spool: Spool::new(&std::env::temp_dir()),
            shape: None,
            frames: Vec::new(),
            darks: Vec::new(),
            flat: None,
            few: Vec::new(),
        })
    }

    /// Puts the temporary file, if one is needed, into `folder`.
    pub fn spool_in(mut self, folder: &Path) -> Self {
        self.spool = Spool::new(folder);
        self
    }

    /// Subtracts dark frames: of the exposure's own time where there are some, else interpolated
    /// between the next shorter and the next longer ones. Give them before the exposures.
    ///
    /// # Errors
    /// Masters of different shapes, or the temporary file fails.
    pub fn with_darks(mut self, mut masters: Vec<MasterDark>) -> Result<Self> {
        masters.sort_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
        for master in masters {
            if let Some((first, _)) = self.darks.first() {
                refuse_other_shape(&master.shape, &first.shape)?;
            }
            self.few = few_pixels(&master.shape);
            let few = self.few_of(&master.level, master.shape.channels);
            let sum: f64 = master.level.iter().map(|v| f64::from(*v)).sum();
            let shape = MasterDarkShape {
                exposure_s: master.exposure_s,
                frames: master.frames,
                mean: sum / master.level.len().max(1) as f64,
                shape: master.shape,
                few,
            };
            self.darks.push((shape, self.spool.put(master.level)?));
        }
        Ok(self)
    }

    /// Divides by a flat field.
    pub fn with_flat(mut self, flat: FlatField) -> Self {
        self.flat = Some(flat);
        self
    }

    /// Adds an exposure of `exposure_s` seconds.
    ///
    /// # Errors
    /// Names the picture: a shape, depth or channel count that differs from the frames before,
    /// the response, the noise model, the dark frames or the flat field; an exposure time that is
    /// not positive or that no dark frames fit; dark frames brighter than it.
    pub fn add(&mut self, photo: Photo, exposure_s: f64) -> Result<()> {
        self.check(&photo, exposure_s)?;
        if self.shape.is_none() {
            self.few = few_pixels(&photo);
            self.shape = Some(photo.without_codes());
        }
        let dark = self.dark_for(&photo, exposure_s)?;
        let codes = self.few_of(&photo.data, photo.channels);
        let each = self.few.len();
        let mut few = Few { time: exposure_s as f32, light: Vec::new(), dark: Vec::new() };
        for (c, (codes, channel)) in codes.chunks(each).zip(&self.channels).enumerate() {
            let level = |l: usize| dark.exposure(channel, |m| self.darks[m].0.few[c * each + l]);
            few.dark.extend((0..codes.len()).map(level));
            let dark = &few.dark[c * each..];
            let exposures = codes.iter().map(|code| channel.exposure[usize::from(*code)]);
            few.light.extend(exposures.zip(dark).map(|(all, dark)| all - dark));
        }
        let (name, codes) = (photo.name, self.spool.put(photo.data)?);
        self.frames.push(Frame { name, time: exposure_s, codes, dark, few });
        Ok(())
    }

    /// The merged picture, and what came to light on the way.
    ///
    /// # Errors
    /// Fewer than two exposures, or the temporary file fails.
    pub fn finish(mut self) -> Result<(HdrImage, MergeReport)> {
        let (Some(shape), 2..) = (self.shape.take(), self.frames.len()) else {
            return Err(CalibrationError::BadBracket {
                expected: "at least two exposures",
                found: format!("{} exposure(s)", self.frames.len()),
            });
        };
        self.frames.sort_by(|a, b| a.time.total_cmp(&b.time));
        let (checks, noise_ratio) = strips::compare(&mut self.frames, &self.channels);
        let job = strips::Job {
            shape: &shape,
            frames: &self.frames,
            channels: &self.channels,
            darks: &self.darks,
            flat: self.flat.as_ref(),
            noise: &self.noise,
            noise_ratio: noise_ratio.unwrap_or(1.0),
        };
        let (radiance, variance, tally) = strips::run(&job, &mut self.spool)?;
        let image = HdrImage {
            width: shape.width,
            height: shape.height,
            channels: shape.channels,
            radiance,
            variance,
            variance_known: true,
            clipped_shortest: tally.clipped,
            lost_longest: tally.lost,
        };
        let names = self.frames.into_iter().map(|f| f.name);
        let report = MergeReport {
            exposures: names.zip(checks).collect(),
            noise_ratio,
            moved_samples: tally.moved.iter().sum(),
            moved_by_exposure: tally.moved,
        };
        Ok((image, report))
    }

    fn check(&self, photo: &Photo, exposure_s: f64) -> Result<()> {
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
        let darks = self.darks.first().map(|(dark, _)| &dark.shape);
        let flat = self.flat.as_ref().map(|flat| &flat.shape);
        for other in [self.shape.as_ref(), darks, flat].into_iter().flatten() {
            refuse_other_shape(photo, other)?;
        }
        Ok(())
    }

    fn dark_for(&self, photo: &Photo, exposure_s: f64) -> Result<Dark> {
        let Some((shortest, _)) = self.darks.first() else { return Ok(Dark::Unmeasured) };
        let times = || self.darks.iter().map(|(d, _)| d.exposure_s);
        let same = times().position(|t| (t / exposure_s - 1.0).abs() < SAME_TIME);
        let (masters, share) = match same {
            Some(k) => ([k, k], 0.0),
            None => {
                let above = times().position(|t| t > exposure_s).unwrap_or(0);
                if above == 0 {
                    let found = times().map(|t| t.to_string()).collect::<Vec<_>>().join(", ");
                    return Err(CalibrationError::Mismatch {
                        picture: photo.name.clone(),
                        expected: format!(
                            "dark frames of {exposure_s} s, or shorter and longer ones"
                        ),
                        found: format!("dark frames of {found} s"),
                    });
                }
                let (low, high) =
                    (self.darks[above - 1].0.exposure_s, self.darks[above].0.exposure_s);
                ([above - 1, above], (exposure_s - low) / (high - low))
            }
        };
        let [a, b] = masters.map(|k| &self.darks[k].0);
        let level = a.mean + share * (b.mean - a.mean);
        let light = photo.data.iter().map(|v| f64::from(*v)).sum::<f64>() / photo.data.len() as f64;
        // The black level of a sensor that warms up moves by less than its read noise.
        if level > light + self.noise.read_noise.max(0.5) {
            return Err(CalibrationError::Mismatch {
                picture: photo.name.clone(),
                expected: format!(
                    "dark frames no brighter than the picture (mean {light:.2} DN), as {}",
                    shortest.shape.name
                ),
                found: format!("dark frames of mean {level:.2} DN"),
            });
        }
        let signal = (level - self.noise.black_level).max(0.0);
        let one = self.noise.variance(signal);
        let weights = [1.0 - share, share];
        // Twice the same master is one measurement.
        let averaged = if masters[0] == masters[1] {
            one / a.frames as f64
        } else {
            weights[0].powi(2) * one / a.frames as f64 + weights[1].powi(2) * one / b.frames as f64
        };
        // In linearised units, at the dark level.
        let slope = self.response.slope(level / self.noise.full_scale, 0) / self.noise.full_scale;
        let variance = (averaged * slope * slope) as f32;
        Ok(Dark::Measured { masters, share: share as f32, variance })
    }

    /// The few pixels' samples, channel after channel.
    fn few_of<T: Copy>(&self, data: &[T], channels: usize) -> Vec<T> {
        let pixels: Vec<&[T]> =
            self.few.iter().filter_map(|p| data.get(p * channels..(p + 1) * channels)).collect();
        (0..channels).flat_map(|c| pixels.iter().map(move |pixel| pixel[c])).collect()
    }
}

/// Pixels spread over the picture as evenly as multiples of the golden ratio are.
fn few_pixels(photo: &Photo) -> Vec<usize> {
    let pixels = photo.width * photo.height;
    if pixels <= FEW {
        return (0..pixels).collect();
    }
    let place = |k: usize| ((k as f64 * 0.618_033_988_749_895).fract() * pixels as f64) as usize;
    let mut few: Vec<usize> = (0..FEW).map(|k| place(k).min(pixels - 1)).collect();
    // In the order of memory they are read several times faster.
    few.sort_unstable();
    few
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
        merger.add(photo, exposure_s)?;
    }
    Ok(merger.finish()?.0)
}
