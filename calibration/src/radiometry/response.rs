//! The camera's response: which exposure each code stands for.

use serde::{Deserialize, Serialize};

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;

/// Knots of a response curve; knot k stands at code k/255 of full scale.
pub const KNOTS: usize = 256;

/// Knot at which every curve has the exposure of a linear sensor, so that mid grey stays grey.
const MID: usize = 128;

/// Inverse of the camera's transfer function, one curve per channel.
///
/// A curve gives the relative exposure (radiance times time) at 256 knots over the code range,
/// positive but for the darkest and strictly increasing; between knots it is linear, so that a
/// linear sensor is represented exactly. Every curve passes through code 128/255 → 128/255: the
/// scale between channels, which no bracket can tell, is fixed by keeping mid grey neutral.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawResponse", into = "RawResponse")]
pub struct Response {
    exposure: Vec<Vec<f64>>,
}

impl Response {
    /// A linear sensor of one or three channels (at least one): exposure = code.
    pub fn identity(channels: usize) -> Self {
        let line: Vec<f64> = (0..KNOTS).map(|k| k as f64 / (KNOTS - 1) as f64).collect();
        Self { exposure: vec![line; channels.max(1)] }
    }

    /// Curves from exposures at the knots, one vector of 256 per channel, scaled as documented.
    ///
    /// # Errors
    /// No channel, another number of knots, or a curve that does not increase strictly.
    pub fn from_exposures(exposure: Vec<Vec<f64>>) -> Result<Self> {
        let good = |curve: &Vec<f64>| {
            curve.len() == KNOTS
                && curve.iter().all(|x| x.is_finite() && *x >= 0.0)
                && curve.windows(2).all(|w| w[0] < w[1])
        };
        if exposure.is_empty() || !exposure.iter().all(good) {
            return Err(CalibrationError::BadInput {
                what: "response curve".into(),
                expected: format!("{KNOTS} strictly increasing exposures for each channel"),
                found: format!(
                    "{} channels of {:?} knots, strictly increasing: {:?}",
                    exposure.len(),
                    exposure.iter().map(Vec::len).collect::<Vec<_>>(),
                    exposure.iter().map(good).collect::<Vec<_>>()
                ),
            });
        }
        let anchored = |curve: Vec<f64>| {
            let scale = MID as f64 / (KNOTS - 1) as f64 / curve[MID];
            curve.into_iter().map(|x| x * scale).collect()
        };
        Ok(Self { exposure: exposure.into_iter().map(anchored).collect() })
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.exposure.len()
    }

    /// The relative exposure of a code (0..1 of full scale); beyond both ends the last segment
    /// goes on. A channel that is not there answers as channel 0.
    pub fn linearise(&self, code: f64, channel: usize) -> f64 {
        let (low, step, fraction) = self.segment(code, channel);
        low + step * fraction
    }

    /// d exposure / d code at a code (0..1), positive.
    pub fn slope(&self, code: f64, channel: usize) -> f64 {
        self.segment(code, channel).1 * (KNOTS - 1) as f64
    }

    /// Debevec & Malik's g(Z) = ln exposure at the knots, 0 at mid grey; −∞ for exposure 0.
    pub fn log_exposure(&self, channel: usize) -> Vec<f64> {
        let curve = self.curve(channel);
        curve.iter().map(|x| (x / curve[MID]).ln()).collect()
    }

    /// Whether every code stands for more exposure than the one below.
    pub fn is_strictly_increasing(&self) -> bool {
        self.exposure.iter().all(|curve| curve.windows(2).all(|w| w[0] < w[1]))
    }

    /// Whether all curves are those of a linear sensor, exposure = code.
    pub fn is_identity(&self) -> bool {
        let line = |k: usize| k as f64 / (KNOTS - 1) as f64;
        let straight =
            |curve: &Vec<f64>| curve.iter().enumerate().all(|(k, x)| (x - line(k)).abs() < 1e-12);
        self.exposure.iter().all(straight)
    }

    /// How well neighbouring exposures of a bracket agree once linearised: the median over pixels
    /// of |log2((x₂/x₁)/(t₂/t₁))| in each channel, over codes from 20/255 to 235/255 in both; None
    /// where no pixel is. 0.04 is a good photograph, 0.7 a wrong curve.
    pub fn agreement(&self, bracket: &[(Photo, f64)]) -> Vec<Option<f64>> {
        let mut sorted: Vec<&(Photo, f64)> = bracket.iter().collect();
        sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
        let channel = |c: usize| {
            let mut errors = Vec::new();
            for pair in sorted.windows(2) {
                let ((short, t1), (long, t2)) = (pair[0], pair[1]);
                let full = f64::from(short.max_value);
                let codes = |photo: &Photo| {
                    let own = photo.data.iter().skip(c).step_by(photo.channels.max(1));
                    own.map(|v| f64::from(*v) / full).collect::<Vec<_>>()
                };
                let usable = 20.0 / 255.0..=235.0 / 255.0;
                for (a, b) in codes(short).into_iter().zip(codes(long)) {
                    if usable.contains(&a) && usable.contains(&b) {
                        let ratio = self.linearise(b, c) / self.linearise(a, c);
                        errors.push((ratio / (t2 / t1)).log2().abs());
                    }
                }
            }
            let middle = errors.len() / 2;
            (!errors.is_empty()).then(|| *errors.select_nth_unstable_by(middle, f64::total_cmp).1)
        };
        (0..self.channels()).map(channel).collect()
    }

    fn curve(&self, channel: usize) -> &[f64] {
        self.exposure.get(channel).unwrap_or(&self.exposure[0])
    }

    fn segment(&self, code: f64, channel: usize) -> (f64, f64, f64) {
        let curve = self.curve(channel);
        let position = code * (KNOTS - 1) as f64;
        let k = (position.floor().max(0.0) as usize).min(KNOTS - 2);
        (curve[k], curve[k + 1] - curve[k], position - k as f64)
    }
}

#[derive(Serialize, Deserialize)]
struct RawResponse {
    exposure: Vec<Vec<f64>>,
}

impl TryFrom<RawResponse> for Response {
    type Error = CalibrationError;
    fn try_from(raw: RawResponse) -> Result<Self> {
        Self::from_exposures(raw.exposure)
    }
}

impl From<Response> for RawResponse {
    fn from(response: Response) -> Self {
        Self { exposure: response.exposure }
    }
}
