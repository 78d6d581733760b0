//! What a session knows of its camera's noise: measured in it, else as the rig is described.

use crate::Failure;
use crate::commands::calibrate::{described, frame_and_time};
use crate::session::Session;
use calibration::{MasterDark, Merger, NoiseModel, Response, SensorNoise};
use rig::frame_path;
use serde::Serialize;
use std::fmt;

/// What `calibrate noise SESSION` writes.
pub(crate) const NOISE: &str = "calibration/noise.json";
/// Beyond this the points of a photon transfer do not lie on a line: the camera is not linear.
pub(crate) const CURVED: f64 = 5.0;
/// Relative difference of exposure times that are one.
const SAME_TIME: f64 = 1e-3;

/// Noise and dark frames for the merges of a session.
pub(crate) struct Sensor {
    noise: NoiseModel,
    measured: bool,
    darks: Vec<MasterDark>,
}

impl Sensor {
    /// Takes what was measured in the session. Noise from flat frames is that of a linear camera;
    /// where a curve between light and code bends their line the described one stays.
    pub fn of(session: &Session) -> Result<Self, Failure> {
        let mut noise = described(session)?.1;
        let mut measured = false;
        if session.path(NOISE).is_file() {
            let found: SensorNoise =
                session.read_json(NOISE, "diaphane calibrate noise SESSION")?;
            measured = found.reduced_chi2 <= CURVED;
            if measured {
                noise = NoiseModel {
                    saturation: noise.saturation.min(found.noise.saturation),
                    ..found.noise
                };
            }
        }
        Ok(Self { noise, measured, darks: darks(session)? })
    }

    /// The camera's noise.
    pub fn noise(&self) -> &NoiseModel {
        &self.noise
    }

    /// Where noise and black of a merge of exposures of these times come from.
    pub fn source(&self, times: &[f64]) -> Source {
        let used = self.fitting_darks(times).iter().map(|d| d.exposure_s).collect();
        Source { noise_measured: self.measured, dark_frames_s: used }
    }

    /// The dark frames, if they reach over all of these times.
    fn fitting_darks(&self, times: &[f64]) -> &[MasterDark] {
        let same = |t: f64| self.darks.iter().any(|d| (d.exposure_s / t - 1.0).abs() < SAME_TIME);
        let between = |t: f64| {
            self.darks.iter().any(|d| d.exposure_s < t)
                && self.darks.iter().any(|d| d.exposure_s > t)
        };
        if times.iter().all(|&t| same(t) || between(t)) { &self.darks } else { &[] }
    }

    /// A merge of exposures of these times; dark frames are used where they reach over all.
    pub fn merger<'a>(&self, response: &'a Response, times: &[f64]) -> Result<Merger<'a>, Failure> {
        let merger = Merger::new(response, &self.noise)?;
        Ok(merger.with_darks(self.fitting_darks(times).to_vec())?)
    }
}

/// What a merge took for the camera's noise and black.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Source {
    /// The noise was measured in the session; else it is what `session.toml` says.
    pub noise_measured: bool,
    /// Exposure times of the dark frames that were subtracted, seconds; empty if none were.
    pub dark_frames_s: Vec<f64>,
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let measured = self.noise_measured;
        f.write_str(if measured { "measured in this session" } else { "as session.toml says" })?;
        match self.dark_frames_s.len() {
            0 => f.write_str("; no dark frames"),
            n => write!(f, "; dark frames of {n} exposure times"),
        }
    }
}

/// The dark frames of `capture --noise`, averaged by exposure; none unless all are there.
fn darks(session: &Session) -> Result<Vec<MasterDark>, Failure> {
    let plan = session.acquisition().noise_plan();
    let Some(shot) = plan.shots.iter().find(|s| s.name == rig::NOISE_DARK_SHOT) else {
        return Ok(Vec::new());
    };
    let place = |e: usize, repeat: u32| session.path(&frame_path(&shot.name, e, repeat));
    let all = (0..shot.exposures_s.len()).all(|e| (0..shot.repeats).all(|r| place(e, r).is_file()));
    if !all {
        return Ok(Vec::new());
    }
    let master = |e: usize| {
        // Their own times count: the plan's may have become whole turns since.
        let (_, seconds) = frame_and_time(session, &shot.name, e, 0)?;
        let frames = (0..shot.repeats).map(|r| Ok(frame_and_time(session, &shot.name, e, r)?.0));
        MasterDark::average::<Failure>(seconds, frames)
    };
    (0..shot.exposures_s.len()).map(master).collect()
}
