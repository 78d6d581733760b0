//! The noise model measured from flat and dark frames: photon transfer (Janesick 2007, chapter 5;
//! EMVA 1288 release 4.0, chapter 2).
//!
//! Two frames of one exposure and one light differ by noise only, whatever pattern they share:
//! half the variance of their difference is the variance of a frame. Over signal it is a straight
//! line, variance = read² + 1/12 + gain · signal, whose slope is the gain in DN an electron.

use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;
use crate::radiometry::masters::{refuse_other_shape, refuse_saturated};
use crate::radiometry::noise::NoiseModel;

/// Largest relative difference of brightness between the two frames of a pair: lamps flicker less.
const SAME_LIGHT: f64 = 0.02;

/// Brightnesses that differ by less than this share of the largest are one: no line to be seen.
const LEAST_RANGE: f64 = 0.2;

/// A figure with its 1-sigma uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The figure.
    pub value: f64,
    /// Its standard deviation, in the same unit.
    pub sigma: f64,
}

/// One pair of frames, one channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TransferPoint {
    /// The first picture of the pair.
    pub picture: String,
    /// Mean code, DN.
    pub mean: f64,
    /// Variance in time of a code, DN².
    pub variance: f64,
    /// Pixels that both were measured on.
    pub pixels: usize,
    /// Exposure time, s, of dark frames; None for flat frames.
    pub dark_s: Option<f64>,
}

/// What a sensor's noise was found to be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorNoise {
    /// For the merge.
    pub noise: NoiseModel,
    /// Electrons a DN.
    pub electrons_per_dn: Estimate,
    /// Read noise without quantisation, electrons.
    pub read_noise_e: Estimate,
    /// Code without light or time, DN.
    pub black_level_dn: Estimate,
    /// DN a second; None if all dark frames had one exposure time.
    pub dark_current_dn_s: Option<Estimate>,
    /// Electrons between black and saturation.
    pub full_well_e: Estimate,
    /// Squared distance of the points from the line over their variance and freedom: 1 for a
    /// linear camera; far more where the codes went through a curve.
    pub reduced_chi2: f64,
    /// What the line was fitted to.
    pub points: Vec<TransferPoint>,
}

/// Takes pairs of frames, then fits.
#[derive(Default)]
pub struct PhotonTransfer {
    saturation: Option<f64>,
    shape: Option<Photo>,
    points: Vec<TransferPoint>,
}

impl PhotonTransfer {
    /// A measurement; codes from `saturation` on are clipped, full scale if not given.
    pub fn new(saturation: Option<f64>) -> Self {
        Self { saturation, ..Self::default() }
    }

    /// Adds two frames of an evenly lit white, of one exposure.
    ///
    /// # Errors
    /// Names the picture: saturated, of another shape than the first, or not as bright as its
    /// partner.
    pub fn add_flats(&mut self, one: &Photo, other: &Photo) -> Result<()> {
        let noise = self.clipping(one);
        refuse_saturated(one, &noise)?;
        refuse_saturated(other, &noise)?;
        self.add(one, other, None)
    }

    /// Adds two frames with the lens covered, of `exposure_s` seconds.
    ///
    /// # Errors
    /// As [`Self::add_flats`].
    pub fn add_darks(&mut self, one: &Photo, other: &Photo, exposure_s: f64) -> Result<()> {
        self.add(one, other, Some(exposure_s))
    }

    fn clipping(&self, photo: &Photo) -> NoiseModel {
        let full = f64::from(photo.max_value);
        let saturation = self.saturation.unwrap_or(full);
        NoiseModel { saturation, ..NoiseModel::for_max_value(photo.max_value) }
    }

    fn add(&mut self, one: &Photo, other: &Photo, dark_s: Option<f64>) -> Result<()> {
        for photo in [one, other] {
            photo.check()?;
            refuse_other_shape(photo, self.shape.as_ref().unwrap_or(one))?;
        }
        // Noise never repeats itself; a frame that was copied would count as one without any.
        if dark_s.is_none() && one.data == other.data {
            return Err(CalibrationError::Mismatch {
                picture: other.name.clone(),
                expected: format!("another frame than {}", one.name),
                found: "the same, sample by sample".into(),
            });
        }
        for c in 0..one.channels {
            let own = |photo: &'_ Photo| {
                let codes = photo.data.iter().skip(c).step_by(photo.channels);
                codes.map(|v| f64::from(*v)).collect::<Vec<_>>()
            };
            let (a, b) = (own(one), own(other));
            let n = a.len() as f64;
            let (mean_a, mean_b) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
            let mean = 0.5 * (mean_a + mean_b);
            // EMVA 1288, equation 19: what both frames differ by on average is no noise.
            let squares: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum();
            let variance = 0.5 * (squares / n - (mean_a - mean_b).powi(2)) * n / (n - 1.0);
            if (mean_a - mean_b).abs() > SAME_LIGHT * mean + 1.0 {
                return Err(CalibrationError::Mismatch {
                    picture: other.name.clone(),
                    expected: format!("the brightness of {} ({mean_a:.1} DN)", one.name),
                    found: format!("{mean_b:.1} DN"),
                });
            }
            let (picture, pixels) = (one.name.clone(), a.len());
            self.points.push(TransferPoint { picture, mean, variance, pixels, dark_s });
        }
        self.shape.get_or_insert_with(|| Photo { data: Vec::new(), ..one.clone() });
        Ok(())
    }

    /// Fits the line.
    ///
    /// # Errors
    /// No dark pair, fewer than two flat pairs of different brightness, or variance that does
    /// not grow with the signal.
    pub fn finish(self) -> Result<SensorNoise> {
        let few = |what: &'static str, needed: usize, found: usize| {
            Err(CalibrationError::TooFewViews { what, needed, found })
        };
        let darks: Vec<&TransferPoint> =
            self.points.iter().filter(|p| p.dark_s.is_some()).collect();
        let Some(shape) = self.shape.as_ref().filter(|_| !darks.is_empty()) else {
            return few("photon transfer (pairs of dark frames)", 1, darks.len());
        };
        // Each pair counts once, whatever its channels.
        let lit = |p: &&TransferPoint| p.dark_s.is_none();
        let flats = self.points.iter().filter(lit).count() / shape.channels.max(1);
        if flats < 2 {
            return few("photon transfer (pairs of flat frames)", 2, flats);
        }
        let range = |channel: usize| {
            let own = self.points.iter().filter(lit).skip(channel).step_by(shape.channels.max(1));
            own.fold((f64::MAX, f64::MIN), |(l, m), p| (l.min(p.mean), m.max(p.mean)))
        };
        if (0..shape.channels).map(range).all(|(least, most)| most - least < LEAST_RANGE * most) {
            let (least, most) = range(0);
            return Err(CalibrationError::BadInput {
                what: "flat frames".into(),
                expected: "pairs of different brightness, from dark to just below saturation"
                    .into(),
                found: format!("{flats} pairs of {least:.0} to {most:.0} DN"),
            });
        }
        let (black, dark_current) = dark_line(&darks);
        let mut line = ([1.0, 1.0], [[0.0; 2]; 2]);
        // The weights need the line itself.
        for _ in 0..8 {
            line = fit(&self.points, black.value, line.0)?;
        }
        let ([constant, gain], covariance) = line;
        if !(gain > 0.0 && gain > 3.0 * covariance[1][1].sqrt()) {
            return Err(CalibrationError::NotConverged {
                what: "photon transfer",
                reason: format!(
                    "the variance does not grow with the signal (gain {gain:.4} ± {:.4} DN an electron)",
                    covariance[1][1].sqrt()
                ),
            });
        }
        let freedom = (self.points.len() as f64 - 2.0).max(1.0);
        let reduced_chi2 = self
            .points
            .iter()
            .map(|p| {
                let expected = constant + gain * (p.mean - black.value);
                (p.variance - expected).powi(2) / variance_of_variance(p, black.value, line.0)
            })
            .sum::<f64>()
            / freedom;
        let noise = self.clipping(shape);
        let read2 = (constant - 1.0 / 12.0).max(0.0);
        let read = read2.sqrt();
        // Where quantisation is all there is, the square is what is known.
        let sigma_read2 = covariance[0][0].sqrt();
        let sigma_read = (0.5 * sigma_read2 / read.max(1e-9)).min(sigma_read2.sqrt());
        let sigma_gain = covariance[1][1].sqrt() / gain;
        // Read noise in electrons is √constant/gain: both are known from one fit.
        let mixed = covariance[0][1] / (read2.max(1e-9) * gain);
        let relative = (sigma_read / read.max(1e-9)).powi(2) + sigma_gain.powi(2) - mixed;
        let saturation = noise.saturation;
        let full_well = (saturation - black.value) / gain;
        Ok(SensorNoise {
            noise: NoiseModel { black_level: black.value, read_noise: read, gain, ..noise },
            electrons_per_dn: Estimate { value: 1.0 / gain, sigma: sigma_gain / gain },
            read_noise_e: Estimate {
                value: read / gain,
                sigma: if read > 0.0 {
                    read / gain * relative.max(0.0).sqrt()
                } else {
                    sigma_read / gain
                },
            },
            black_level_dn: black,
            dark_current_dn_s: dark_current,
            full_well_e: Estimate { value: full_well, sigma: full_well * sigma_gain },
            reduced_chi2,
            points: self.points,
        })
    }
}

/// Of ½ mean (a − b)²: 2σ⁴ + κ₄/2 over the pixels, κ₄ the photons' fourth cumulant.
fn variance_of_variance(point: &TransferPoint, black: f64, [constant, gain]: [f64; 2]) -> f64 {
    let signal = (point.mean - black).max(0.0);
    let variance = (constant + gain * signal).max(1e-6);
    (2.0 * variance * variance + 0.5 * gain.abs().powi(3) * signal) / point.pixels as f64
}

/// Weighted least squares of variance = constant + gain · signal, with its covariance.
fn fit(points: &[TransferPoint], black: f64, line: [f64; 2]) -> Result<([f64; 2], [[f64; 2]; 2])> {
    let (mut w, mut wx, mut wxx, mut wy, mut wxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for p in points {
        let weight = 1.0 / variance_of_variance(p, black, line);
        let (x, y) = (p.mean - black, p.variance);
        w += weight;
        wx += weight * x;
        wxx += weight * x * x;
        wy += weight * y;
        wxy += weight * x * y;
    }
    let determinant = w * wxx - wx * wx;
    if determinant.is_nan() || determinant <= 1e-12 * w * wxx {
        return Err(CalibrationError::NotConverged {
            what: "photon transfer",
            reason: "flat frames are all as bright as the dark ones".into(),
        });
    }
    let covariance = [[wxx / determinant, -wx / determinant], [-wx / determinant, w / determinant]];
    let constant = (wxx * wy - wx * wxy) / determinant;
    Ok(([constant, (w * wxy - wx * wy) / determinant], covariance))
}

/// Black level and dark current: the line through the means of dark frames over time.
fn dark_line(darks: &[&TransferPoint]) -> (Estimate, Option<Estimate>) {
    let (mut w, mut wt, mut wtt, mut wy, mut wty) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for p in darks {
        // Two frames' pixels.
        let weight = 2.0 * p.pixels as f64 / p.variance.max(1.0 / 12.0);
        let t = p.dark_s.unwrap_or(0.0);
        w += weight;
        wt += weight * t;
        wtt += weight * t * t;
        wy += weight * p.mean;
        wty += weight * t * p.mean;
    }
    let determinant = w * wtt - wt * wt;
    if determinant <= 1e-9 * w * wtt {
        return (Estimate { value: wy / w, sigma: w.recip().sqrt() }, None);
    }
    let black = (wtt * wy - wt * wty) / determinant;
    let rate = (w * wty - wt * wy) / determinant;
    let sigma = |square: f64| square.max(0.0).sqrt();
    (
        Estimate { value: black, sigma: sigma(wtt / determinant) },
        Some(Estimate { value: rate, sigma: sigma(w / determinant) }),
    )
}
