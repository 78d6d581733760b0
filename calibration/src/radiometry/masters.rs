//! What is averaged once and used for every picture: dark frames and the flat field.

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::radiometry::noise::NoiseModel;
use crate::radiometry::response::Response;

/// Samples in a thousand that may be saturated in a flat-field frame: dust and hot pixels.
const SATURATED_SHARE: f64 = 1e-3;

/// The mean of dark frames (lens covered) of one exposure time.
#[derive(Clone, Debug)]
pub struct MasterDark {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Mean code of each sample, DN, laid out as the pictures are.
    pub level: Vec<f32>,
    /// Pictures that were averaged.
    pub frames: usize,
    /// A picture without data that has the shape of all.
    pub(crate) shape: Photo,
}

impl MasterDark {
    /// Averages dark frames of one exposure time, one at a time.
    ///
    /// # Errors
    /// No frame, frames of different shapes, an exposure time that is not positive.
    pub fn average<E: From<CalibrationError>>(
        exposure_s: f64,
        frames: impl IntoIterator<Item = std::result::Result<Photo, E>>,
    ) -> std::result::Result<Self, E> {
        let (shape, level, count) = mean(frames, |_| Ok(()))?;
        if !(exposure_s.is_finite() && exposure_s > 0.0) {
            return Err(E::from(CalibrationError::Mismatch {
                picture: shape.name,
                expected: "a positive exposure time".into(),
                found: format!("{exposure_s} s"),
            }));
        }
        Ok(Self { exposure_s, level, frames: count, shape })
    }
}

/// How bright an evenly bright white looks at each sample, relative to the mean of its channel:
/// the lens's vignette and the pixels' own gains.
#[derive(Clone, Debug)]
pub struct FlatField {
    /// Gain of each sample, mean 1 in each channel, laid out as the pictures are.
    pub gain: Vec<f32>,
    /// Variance of a gain, relative to its square: what noise the flat frames had.
    pub relative_variance: f32,
    pub(crate) shape: Photo,
}

impl FlatField {
    /// Averages pictures of an evenly lit white, less the dark level where one is given.
    ///
    /// # Errors
    /// As [`MasterDark::average`]; a frame of which more than a thousandth is saturated, by name;
    /// a sample without light.
    pub fn average<E: From<CalibrationError>>(
        frames: impl IntoIterator<Item = std::result::Result<Photo, E>>,
        dark: Option<&MasterDark>,
        response: &Response,
        noise: &NoiseModel,
    ) -> std::result::Result<Self, E> {
        let (shape, level, count) = mean(frames, |photo| refuse_saturated(photo, noise))?;
        if let Some(dark) = dark {
            refuse_other_shape(&dark.shape, &shape)?;
        }
        let full = noise.full_scale;
        let channels = shape.channels;
        let linear =
            |v: f32, i: usize| response.linearise(f64::from(v) / full, i % channels) as f32;
        let mut gain: Vec<f32> = Vec::with_capacity(level.len());
        for (i, &v) in level.iter().enumerate() {
            let dark =
                dark.and_then(|d| d.level.get(i).copied()).unwrap_or(noise.black_level as f32);
            gain.push(linear(v, i) - linear(dark, i));
        }
        let mut relative_variance = 0.0;
        for c in 0..channels {
            let own = || gain.iter().skip(c).step_by(channels);
            let samples = own().count() as f64;
            let mean = own().map(|g| f64::from(*g)).sum::<f64>() / samples;
            // A pixel 50 times darker than the others sees no flat field.
            let least = own().copied().fold(f32::INFINITY, f32::min);
            if !(mean > 0.0 && f64::from(least) > 0.02 * mean) {
                return Err(E::from(CalibrationError::Mismatch {
                    picture: shape.name,
                    expected: "light on every pixel of the flat field".into(),
                    found: format!("{least} of a mean of {mean} in channel {c}"),
                }));
            }
            let one = noise.variance(mean * full) / (mean * full).powi(2) / count as f64;
            relative_variance += one as f32 / channels as f32;
            gain.iter_mut().skip(c).step_by(channels).for_each(|g| *g /= mean as f32);
        }
        Ok(Self { gain, relative_variance, shape })
    }
}

/// Refuses a picture that has more saturated samples than dust and hot pixels explain.
pub(crate) fn refuse_saturated(photo: &Photo, noise: &NoiseModel) -> Result<()> {
    let clipped = photo.data.iter().filter(|v| f64::from(**v) >= noise.saturation).count();
    let share = clipped as f64 / photo.data.len().max(1) as f64;
    let (found, saturation) = if share > SATURATED_SHARE {
        (share, noise.saturation)
    } else if let Some((share, code)) = pile_up(photo) {
        (share, f64::from(code))
    } else {
        return Ok(());
    };
    Err(CalibrationError::Mismatch {
        picture: photo.name.clone(),
        expected: format!("a flat field below saturation ({saturation:.0} DN)"),
        found: format!("{:.1} % of its samples saturated", 100.0 * found),
    })
}

/// Share of the samples at a picture's brightest code, and that code, where they pile up there: a
/// sensor whose full scale is below the file's.
///
/// Noise of a code or more thins out towards its brightest code: no hundredth of the samples lies
/// there with less than a quarter of that just below. In 8 bits noise may be less than a code.
fn pile_up(photo: &Photo) -> Option<(f64, u16)> {
    let top = photo.data.iter().copied().max()?;
    let count = |code: u16| photo.data.iter().filter(|v| **v == code).count();
    let (here, below) = (count(top), top.checked_sub(1).map_or(0, count));
    let share = here as f64 / photo.data.len() as f64;
    (photo.max_value > 255 && share > 0.01 && here > 4 * below).then_some((share, top))
}

pub(crate) fn refuse_other_shape(photo: &Photo, first: &Photo) -> Result<()> {
    if photo.shape() == first.shape() {
        return Ok(());
    }
    Err(CalibrationError::Mismatch {
        picture: photo.name.clone(),
        expected: format!("{} as in {}", first.shape(), first.name),
        found: photo.shape(),
    })
}

/// Mean of pictures of one shape, taken one at a time.
fn mean<E: From<CalibrationError>>(
    frames: impl IntoIterator<Item = std::result::Result<Photo, E>>,
    accept: impl Fn(&Photo) -> Result<()>,
) -> std::result::Result<(Photo, Vec<f32>, usize), E> {
    let mut shape: Option<Photo> = None;
    let mut sums: Vec<u32> = Vec::new();
    let mut count = 0_usize;
    for frame in frames {
        let photo = frame?;
        photo.check()?;
        accept(&photo)?;
        match &shape {
            Some(first) => refuse_other_shape(&photo, first)?,
            None => {
                sums = vec![0; photo.data.len()];
                shape = Some(photo.without_codes());
            }
        }
        // 65 536 pictures of 16 bits overflow; nobody takes so many.
        sums.iter_mut().zip(&photo.data).for_each(|(s, &v)| *s = s.saturating_add(v.into()));
        count += 1;
    }
    let shape = shape.ok_or(CalibrationError::BadBracket {
        expected: "at least one picture to average",
        found: "none".into(),
    })?;
    let level = sums.into_iter().map(|s| s as f32 / count as f32).collect();
    Ok((shape, level, count))
}
