//! Plain, adaptive and multiplexed plans against each other, at the sensor that the simulated rig
//! has, from light that drowns in read noise to more than enough.

use super::tally::{Noise, Tally};
use super::view::View;
use crate::Failure;
use crate::adaptive::{GOAL, frame_noise};
use calibration::{HdrImage, Merger, NoiseModel, Photo, Response};
use rig::{ChannelBrightness, PER_FRAME_S, SMatrix, choose_exposures};
use serde::Serialize;
use simulator::{ResponseCurve, SampleSpec, Sensor};

/// What is lit and exposed, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum PlanKind {
    /// One region at a time, the whole bracket each.
    Plain,
    /// The exposures that the first region shows to be enough.
    Adaptive,
    /// The same, the model's error left out: noise alone has to stay as it is.
    AdaptiveStrict,
    /// About half of all regions at a time.
    Multiplexed,
    /// Both.
    MultiplexedAdaptive,
}

impl PlanKind {
    pub const ALL: [Self; 5] = [
        Self::Plain,
        Self::Adaptive,
        Self::AdaptiveStrict,
        Self::Multiplexed,
        Self::MultiplexedAdaptive,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Adaptive => "adaptive",
            Self::AdaptiveStrict => "adaptive, noise alone",
            Self::Multiplexed => "multiplexed",
            Self::MultiplexedAdaptive => "multiplexed, adaptive",
        }
    }
}

/// How much light there is, and whether the camera adds noise of its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Light {
    /// Over that of the simulated rig.
    pub level: f64,
    /// Read noise and dark current as the simulated camera has them; else next to none.
    pub camera_noise: bool,
}

/// One plan under one light.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    pub light: Light,
    /// Electrons of the brightest place of a region's picture in the longest exposure, were there
    /// room for them.
    pub peak_electrons: f64,
    pub plan: PlanKind,
    /// Exposures of a pattern, seconds.
    pub exposures_s: Vec<f64>,
    /// Frames of black and all patterns of the fit.
    pub frames: usize,
    /// Their exposures and what each frame takes beside, seconds.
    pub seconds: f64,
    pub noise: Noise,
}

/// What is studied.
pub(crate) struct Study {
    view: View,
    bracket_s: Vec<f64>,
    seed: u64,
}

impl Study {
    /// A block whose lit face is cut into columns and rows of `regions`, every `step`-th cell
    /// of the grid along each axis.
    pub fn new(
        sample: &SampleSpec,
        regions: [usize; 2],
        bracket_s: Vec<f64>,
        step: u32,
    ) -> Result<Self, Failure> {
        Ok(Self { view: View::new(sample, regions, step)?, bracket_s, seed: sample.seed })
    }

    /// All plans under one light.
    pub fn rows(&self, light: Light) -> Result<Vec<Row>, Failure> {
        let setting = Setting::new(self, light)?;
        PlanKind::ALL.into_iter().map(|plan| setting.row(plan)).collect()
    }
}

/// A study under one light.
struct Setting<'a> {
    study: &'a Study,
    light: Light,
    sensor: Sensor,
    noise: NoiseModel,
    response: Response,
}

/// A measured picture, the true black taken from it.
struct Shot {
    light: Vec<f64>,
    variance: Vec<f64>,
}

/// Patterns as rows of the regions that they light.
type Lit<'a> = Box<dyn Fn(usize, usize) -> bool + 'a>;

impl<'a> Setting<'a> {
    fn new(study: &'a Study, light: Light) -> Result<Self, Failure> {
        let plain = Sensor { curve: ResponseCurve::Linear, ..Sensor::default() };
        let sensor = if light.camera_noise {
            plain
        } else {
            // No less than makes a model: a hundredth of an electron.
            Sensor { read_noise: 0.01, dark_current: 0.0, ..plain }
        };
        let full_scale = sensor.full_scale();
        let noise = NoiseModel {
            black_level: sensor.black_code(),
            read_noise: sensor.read_noise_code(),
            gain: sensor.gain(),
            full_scale,
            saturation: 0.995 * full_scale,
        };
        Ok(Self { study, light, sensor, noise, response: Response::identity(3) })
    }

    fn row(&self, plan: PlanKind) -> Result<Row, Failure> {
        let view = &self.study.view;
        let bracket_s = &self.study.bracket_s;
        let count = view.regions.len();
        let matrix = SMatrix::for_regions(count);
        let multiplexed = matches!(plan, PlanKind::Multiplexed | PlanKind::MultiplexedAdaptive);
        let (patterns, lit): (usize, Lit<'_>) = if multiplexed {
            (matrix.order(), Box::new(|row, region| matrix.lights(row, region)))
        } else {
            (count, Box::new(|row, region| row == region))
        };
        // What is off in every picture alike, and cannot be told from light.
        let true_black = self.true_black();
        let black = self.picture(|_| false, bracket_s, "black")?;
        let black_off: Vec<f64> =
            black.radiance.iter().zip(&true_black).map(|(l, b)| f64::from(*l) - b).collect();
        let shot = |row: usize, times: &[f64]| -> Result<Shot, Failure> {
            let image = self.picture(|j| lit(row, j), times, &format!("{multiplexed} {row}"))?;
            let light = image.radiance.iter().zip(&true_black).map(|(l, b)| f64::from(*l) - b);
            Ok(Shot {
                light: light.collect(),
                variance: image.variance.iter().map(|v| f64::from(*v)).collect(),
            })
        };
        let first = shot(0, bracket_s)?;
        let times = match plan {
            PlanKind::Plain | PlanKind::Multiplexed => bracket_s.clone(),
            PlanKind::Adaptive | PlanKind::MultiplexedAdaptive => {
                self.choose(&first, &true_black, true)?
            }
            PlanKind::AdaptiveStrict => self.choose(&first, &true_black, false)?,
        };
        let mut tally = Tally::default();
        if multiplexed {
            let shots = std::iter::once(Ok(first)).chain((1..patterns).map(|r| shot(r, &times)));
            let shots = shots.collect::<Result<Vec<_>, _>>()?;
            let (pictures, variances): (Vec<_>, Vec<_>) =
                shots.into_iter().map(|s| (s.light, s.variance)).unzip();
            let found = matrix.demultiplex(&pictures, &variances, count).map_err(Failure::other)?;
            // Black is in every picture; of the weights that make a region of them one more is
            // positive than negative.
            let black_off: Vec<f64> =
                black_off.iter().map(|b| b * 2.0 / (matrix.order() + 1) as f64).collect();
            for (region, values) in found.values.iter().enumerate() {
                self.add(&mut tally, region, values, &found.variance, &black_off);
            }
        } else {
            let mut first = Some(first);
            for region in 0..count {
                let Shot { light, variance } =
                    first.take().map_or_else(|| shot(region, &times), Ok)?;
                self.add(&mut tally, region, &light, &variance, &black_off);
            }
        }
        let whole = 2 * bracket_s.len();
        let exposed = |times: &[f64]| times.iter().sum::<f64>();
        let frames = whole + (patterns - 1) * times.len();
        Ok(Row {
            light: self.light,
            peak_electrons: self.peak_electrons(),
            plan,
            frames,
            seconds: 2.0 * exposed(bracket_s)
                + (patterns - 1) as f64 * exposed(&times)
                + frames as f64 * PER_FRAME_S,
            exposures_s: times,
            noise: tally.noise(),
        })
    }

    /// The merged picture of the regions that `lit` tells. The same pattern has the same noise at
    /// the same exposure, as on the simulated rig.
    fn picture(
        &self,
        lit: impl Fn(usize) -> bool,
        times: &[f64],
        tag: &str,
    ) -> Result<HdrImage, Failure> {
        let view = &self.study.view;
        let radiance = view.under(self.light.level, lit);
        let mut merger = Merger::new(&self.response, &self.noise)?;
        for &t in times {
            let mut hash = blake3::Hasher::new();
            hash.update(&self.study.seed.to_le_bytes());
            hash.update(tag.as_bytes());
            hash.update(&self.light.level.to_le_bytes());
            hash.update(&t.to_le_bytes());
            let seed = *hash.finalize().as_bytes();
            let photo = Photo {
                width: view.width,
                height: view.height,
                channels: 3,
                max_value: u16::MAX,
                data: self.sensor.expose(&radiance, 3 * view.width, t, [1.0; 3], seed),
                name: tag.to_owned(),
            };
            merger.add(photo, t)?;
        }
        Ok(merger.finish()?.0)
    }

    /// As a session chooses: from the means of cells.
    fn choose(&self, first: &Shot, black: &[f64], floor: bool) -> Result<Vec<f64>, Failure> {
        let view = &self.study.view;
        let all: Vec<f64> = first.light.iter().zip(black).map(|(l, b)| l + b).collect();
        let (light, all) = (view.cells(&first.light), view.cells(&all));
        let channels: Vec<ChannelBrightness> = light
            .iter()
            .zip(all)
            .enumerate()
            .map(|(c, (light, radiances))| {
                let brightest = light.iter().copied().fold(0.0, f64::max);
                let floor =
                    if floor { model_error() * brightest * view.cell_px as f64 } else { 0.0 };
                ChannelBrightness {
                    noise: frame_noise(&self.noise, &self.response, c),
                    radiances,
                    floor,
                }
            })
            .collect();
        let choice = choose_exposures(&channels, &self.study.bracket_s, PER_FRAME_S, &GOAL);
        Ok(choice.map_err(Failure::other)?.exposures_s)
    }

    /// What a sample's radiance is in the merge's unit, full scales a second.
    fn unit(&self, sample: usize) -> f64 {
        self.light.level * self.sensor.sensitivity[sample % 3]
    }

    /// What is there without the projector's light, dark current included, full scales a second.
    fn true_black(&self) -> Vec<f64> {
        let dark = self.sensor.dark_current / self.sensor.full_well;
        let black = self.study.view.black.iter().enumerate();
        black.map(|(i, l)| f64::from(*l) * self.unit(i) + dark).collect()
    }

    fn peak_electrons(&self) -> f64 {
        let samples = self.study.view.regions.iter().flat_map(|r| r.iter().enumerate());
        let peak = samples.map(|(i, l)| f64::from(*l) * self.unit(i)).fold(0.0, f64::max);
        peak * self.sensor.full_well * self.study.bracket_s.iter().copied().fold(0.0, f64::max)
    }

    /// Compares a region's measured picture with the true one. `black_off` is what the measured
    /// black would take from it beside.
    fn add(
        &self,
        tally: &mut Tally,
        region: usize,
        values: &[f64],
        variance: &[f64],
        black_off: &[f64],
    ) {
        let view = &self.study.view;
        let truth: Vec<f64> = view.regions[region]
            .iter()
            .enumerate()
            .map(|(i, l)| f64::from(*l) * self.unit(i))
            .collect();
        let (means, measured) = (view.cells(&truth), view.cells(values));
        let peaks = [0, 1, 2].map(|c| means[c].iter().copied().fold(0.0, f64::max));
        for (i, (value, truth)) in values.iter().zip(&truth).enumerate() {
            if view.on_face[i] && variance[i].is_finite() {
                let error = value - truth;
                tally.pixel([error, error - black_off[i]], *truth, peaks[i % 3], variance[i]);
            }
        }
        for (c, (means, measured)) in means.iter().zip(&measured).enumerate() {
            for (truth, value) in means.iter().zip(measured) {
                tally.cell(value - truth, *truth, peaks[c], model_error() * peaks[c]);
            }
        }
    }
}

/// What the solver adds to the noise, as a share of a picture's brightest cell.
fn model_error() -> f64 {
    diffusion::InverseSettings::default().model_error
}
