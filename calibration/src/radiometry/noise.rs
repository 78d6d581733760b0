//! What the sensor adds to the light.

use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};

/// The sensor's noise and range, all in codes (DN) of the pictures that are merged.
///
/// A code is black_level + signal + noise with variance
/// read_noise² + 1/12 (quantisation) + gain · signal (photons), below `saturation`.
/// For a sensor with a response curve the photon term counts in linearised codes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseModel {
    /// Code without any light, DN.
    pub black_level: f64,
    /// Standard deviation in the dark, DN, quantisation left out.
    pub read_noise: f64,
    /// DN per electron.
    pub gain: f64,
    /// Largest code that can be written, DN: 255 or 65535.
    pub full_scale: f64,
    /// Codes from here on say nothing but "more", DN.
    pub saturation: f64,
}

impl NoiseModel {
    /// A middling sensor where nothing is known: 20 000 electrons at full scale, black at 0,
    /// read noise of 5 electrons but at least 1 code of 8 bits, where compression rules.
    pub fn for_max_value(max_value: u16) -> Self {
        let full_scale = f64::from(max_value);
        let gain = full_scale / 20_000.0;
        let read_noise = if max_value == 255 { 1.0 } else { 5.0 * gain };
        let saturation = 0.98 * full_scale;
        Self { black_level: 0.0, read_noise, gain, full_scale, saturation }
    }

    /// Variance in DN² of a code whose signal above black is `signal` DN, for a linear sensor.
    pub fn variance(&self, signal: f64) -> f64 {
        self.dark_variance() + self.gain * signal.max(0.0)
    }

    /// Read noise and quantisation, DN².
    pub(crate) fn dark_variance(&self) -> f64 {
        self.read_noise * self.read_noise + 1.0 / 12.0
    }

    /// Fails unless the figures make sense together.
    pub(crate) fn check(&self) -> Result<()> {
        let positive = |v: f64| v.is_finite() && v >= 0.0;
        let ordered = self.black_level < self.saturation && self.saturation <= self.full_scale;
        if [self.black_level, self.read_noise, self.gain].into_iter().all(positive) && ordered {
            return Ok(());
        }
        Err(CalibrationError::BadInput {
            what: "noise model".into(),
            expected: "non-negative figures with black level < saturation ≤ full scale".into(),
            found: format!("{self:?}"),
        })
    }
}
