//! What a simulated rig gets wrong, as real ones do.

use crate::ResponseCurve;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Deviations of projector, lamp and camera from the ideal; the default is the rig as it has
/// always been: a projector whose light is proportional to its input, and a steady lamp.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Imperfections {
    /// The projector's light by its input.
    pub projector_response: ProjectorResponse,
    /// White over black of the projector.
    pub contrast: f64,
    /// Principal point of the projector from the middle of its picture, pixels; it may leave the
    /// picture.
    pub lens_shift_px: [f64; 2],
    /// Distortion of the projector's lens: k1, k2, p1, p2.
    pub projector_distortion: [f64; 4],
    /// The camera's response.
    pub camera_response: ResponseCurve,
    /// Loss of light in the corners of the camera's picture, relative to its middle.
    pub vignette: f64,
    /// How the lamp changes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lamp: Option<Lamp>,
    /// The colour wheel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wheel: Option<ColourWheel>,
}

/// Light of a projector by its input, both 0 to 1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ProjectorResponse {
    /// In proportion.
    Linear,
    /// The input to the power of red's, green's and blue's exponent.
    Gamma([f64; 3]),
    /// Straight lines between red's, green's and blue's light at equal steps of the input.
    Curve(Vec<[f64; 3]>),
}

/// A lamp that drifts: 1 + trend · t + ripple · sin(2π t / period).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lamp {
    /// Gain of light an hour, as a share.
    pub trend_per_hour: f64,
    /// Amplitude of the slow oscillation, as a share.
    pub ripple: f64,
    /// Its period, seconds.
    pub period_s: f64,
}

/// A wheel of a red, a green and a blue segment, equally wide, in front of the lamp.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColourWheel {
    /// One turn, seconds.
    pub turn_s: f64,
}

impl Default for Imperfections {
    fn default() -> Self {
        Self {
            projector_response: ProjectorResponse::Linear,
            contrast: 1500.0,
            lens_shift_px: [20.0, 260.0],
            projector_distortion: [0.03, 0.0, 0.0, 0.0],
            camera_response: ResponseCurve::default(),
            vignette: 0.02,
            lamp: None,
            wheel: None,
        }
    }
}

/// What no rig can be like.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{what}: expected {expected}, found {found}")]
pub struct ImperfectionError {
    what: &'static str,
    expected: &'static str,
    found: String,
}

impl Imperfections {
    /// Checks what came from a file.
    ///
    /// # Errors
    /// The first number that no rig can have.
    pub fn check(&self) -> Result<(), ImperfectionError> {
        let bad = |what, expected, found: String| Err(ImperfectionError { what, expected, found });
        let within = |from: f64, to: f64, value: f64| (from..=to).contains(&value);
        match &self.projector_response {
            ProjectorResponse::Linear => {}
            ProjectorResponse::Gamma(exponents) => {
                if !exponents.iter().all(|&g| within(0.2, 5.0, g)) {
                    return bad(
                        "projector_response",
                        "exponents from 0.2 to 5",
                        format!("{exponents:?}"),
                    );
                }
            }
            ProjectorResponse::Curve(points) => {
                let rises = points.windows(2).all(|p| (0..3).all(|c| p[0][c] <= p[1][c]));
                let ends = [points.first() == Some(&[0.0; 3]), points.last() == Some(&[1.0; 3])];
                if !(rises && ends == [true; 2]) {
                    return bad(
                        "projector_response",
                        "light that rises from 0 to 1",
                        format!("{points:?}"),
                    );
                }
            }
        }
        if !within(2.0, 1e9, self.contrast) {
            return bad("contrast", "2 to 1e9", self.contrast.to_string());
        }
        if !self.lens_shift_px.iter().all(|&s| within(-600.0, 600.0, s)) {
            return bad("lens_shift_px", "-600 to 600 pixels", format!("{:?}", self.lens_shift_px));
        }
        if !self.projector_distortion.iter().all(|&d| within(-0.2, 0.2, d)) {
            return bad(
                "projector_distortion",
                "-0.2 to 0.2 each",
                format!("{:?}", self.projector_distortion),
            );
        }
        if !within(0.0, 0.9, self.vignette) {
            return bad("vignette", "0 to 0.9", self.vignette.to_string());
        }
        if let Some(Lamp { trend_per_hour, ripple, period_s }) = self.lamp
            && !(within(-1.0, 1.0, trend_per_hour)
                && within(0.0, 0.5, ripple)
                && within(1.0, 1e6, period_s))
        {
            let found = format!("{trend_per_hour}, {ripple}, {period_s} s");
            return bad(
                "lamp",
                "a trend of -1 to 1 an hour, a ripple of 0 to 0.5, a period of 1 s or more",
                found,
            );
        }
        if let Some(ColourWheel { turn_s }) = self.wheel
            && !within(1e-3, 0.1, turn_s)
        {
            return bad("wheel", "a turn of 0.001 to 0.1 s", format!("{turn_s} s"));
        }
        self.camera_response.check().or_else(|found| {
            bad("camera_response", "a curvature of 0 to 1000 or a gamma of 0.2 to 5", found)
        })
    }

    /// Light of red, green and blue at each input byte, white being 1; black is not quite dark.
    pub(crate) fn projector_light(&self) -> Vec<[f64; 3]> {
        let pedestal = 1.0 / self.contrast;
        let light = |byte: usize| {
            let shown = self.projector_response.light(byte as f64 / 255.0);
            shown.map(|light| pedestal + (1.0 - pedestal) * light)
        };
        (0..256).map(light).collect()
    }

    /// Light of red, green and blue over that of a steady lamp without a wheel, in an exposure of
    /// `exposure_s` that begins at `time_s`, the wheel standing wherever `chance` has put it.
    pub(crate) fn steadiness(&self, time_s: f64, exposure_s: f64, chance: [u8; 32]) -> [f64; 3] {
        let lamp = self.lamp.map_or(1.0, |lamp| {
            let phase = std::f64::consts::TAU * time_s / lamp.period_s;
            1.0 + lamp.trend_per_hour * time_s / 3600.0 + lamp.ripple * phase.sin()
        });
        let begin: f64 = ChaCha8Rng::from_seed(chance).random_range(0.0..1.0);
        let wheel = self.wheel.map_or([1.0; 3], |wheel| wheel.share(begin, exposure_s));
        wheel.map(|share| lamp * share)
    }
}

impl ProjectorResponse {
    /// Light of red, green and blue, 0 to 1, at an input from 0 to 1.
    pub fn light(&self, input: f64) -> [f64; 3] {
        match self {
            Self::Linear => [input; 3],
            Self::Gamma(exponents) => exponents.map(|g| input.powf(g)),
            Self::Curve(points) => {
                let at = input * points.len().saturating_sub(1) as f64;
                let (below, part) = (at.floor(), at - at.floor());
                let point = |i: f64| points.get(i as usize).copied().unwrap_or([1.0; 3]);
                let (a, b) = (point(below), point(below + 1.0));
                std::array::from_fn(|c| (1.0 - part) * a[c] + part * b[c])
            }
        }
    }
}

impl ColourWheel {
    /// Light of red, green and blue in an exposure that begins `begin` turns into the wheel's,
    /// over that of whole turns.
    fn share(self, begin: f64, exposure_s: f64) -> [f64; 3] {
        let turns = exposure_s / self.turn_s;
        std::array::from_fn(|channel| {
            // Turns of which this colour's third has been passed since the first turn's start.
            let passed = |at: f64| {
                let within = at - at.floor();
                at.floor() + (3.0 * within - channel as f64).clamp(0.0, 1.0)
            };
            (passed(begin + turns) - passed(begin)) / turns
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_turns_of_the_wheel_are_white() {
        let wheel = ColourWheel { turn_s: 1.0 / 120.0 };
        for begin in [0.0, 0.1, 0.5, 0.99] {
            for share in wheel.share(begin, 4.0 / 120.0) {
                assert!((share - 1.0).abs() < 1e-12, "{begin} {share}");
            }
        }
        // A third of a turn, from its start: red alone, three times as bright.
        let [r, g, b] = wheel.share(0.0, 1.0 / 360.0);
        assert!((r - 3.0).abs() < 1e-9 && g.abs() < 1e-9 && b.abs() < 1e-9, "{r} {g} {b}");
        // Whenever it begins, all light is there.
        let sum: f64 = wheel.share(0.3, 0.0031).iter().sum();
        assert!((sum - 3.0).abs() < 1e-9, "{sum}");
    }

    #[test]
    fn impossible_rigs_are_refused() {
        let refused = |spoil: &dyn Fn(&mut Imperfections)| {
            let mut rig = Imperfections::default();
            spoil(&mut rig);
            rig.check().unwrap_err().to_string()
        };
        Imperfections::default().check().unwrap();
        assert!(refused(&|r| r.contrast = f64::NAN).contains("contrast"));
        assert!(refused(&|r| r.wheel = Some(ColourWheel { turn_s: 0.0 })).contains("wheel"));
        let falls = ProjectorResponse::Curve(vec![[0.0; 3], [0.5, 0.6, 0.7], [0.4; 3], [1.0; 3]]);
        assert!(refused(&|r| r.projector_response = falls.clone()).contains("rises"));
        assert!(refused(&|r| r.camera_response = ResponseCurve::Gamma(0.0)).contains("gamma"));
    }
}
