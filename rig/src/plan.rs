//! The capture plan as data, so that it can be read, checked and timed without a rig.

use serde::{Deserialize, Serialize};

use crate::{CameraInfo, Pattern, PatternError, Target, Timing};

/// Below this, a colour-wheel projector may show less than a whole turn, and a display less
/// than a whole frame.
const SHORTEST_SAFE_S: f64 = 1.0 / 30.0;
/// Part of an exposure that may be no whole turn of a colour wheel: so much its brightness can
/// change at most, less than the merge corrects.
const MOST_OF_A_TURN: f64 = 0.002;

/// Everything that is to be photographed, in order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// The shots.
    pub shots: Vec<Shot>,
}

/// One thing under one pattern, at one or more exposures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shot {
    /// Names the folder and the files: lower-case letters, digits and hyphens.
    pub name: String,
    /// What for.
    pub purpose: Purpose,
    /// Exposure times, seconds.
    pub exposures_s: Vec<f64>,
    /// Frames at each exposure.
    pub repeats: u32,
    /// What is in front of the camera.
    pub target: Target,
    /// What the projector shows.
    pub pattern: Pattern,
}

/// What a shot is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Purpose {
    /// Where camera and projector are.
    Geometry,
    /// The camera's response to exposure.
    Response,
    /// The camera's colours.
    Colour,
    /// Black level, ambient light, projector white.
    Reference,
    /// The projector's response and black.
    Light,
    /// The projector's colour wheel, which short exposures are to show.
    Wheel,
    /// The camera's noise.
    Noise,
    /// Goes into the fit.
    Fit,
    /// Kept out of the fit, to check it.
    HeldOut,
    /// What the surface of a front-lit block itself sends back: all of its face is lit.
    Surface,
}

/// Why a plan cannot be carried out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// Nothing to do.
    #[error("a plan needs at least one shot, found none")]
    Empty,
    /// A name that is no good for a folder.
    #[error(
        "shot {0:?}: names are 1 to 60 lower-case letters, digits and hyphens, beginning with a letter or digit"
    )]
    Name(String),
    /// Two shots of one name.
    #[error("two shots are named {0:?}")]
    SameName(String),
    /// No exposure, or one that is not positive and finite.
    #[error("shot {shot:?}: exposure times must be positive and finite, found {found:?} s")]
    Exposures {
        /// The shot.
        shot: String,
        /// Its exposure times, seconds.
        found: Vec<f64>,
    },
    /// No frames at all.
    #[error("shot {0:?}: repeats must be at least 1, found 0")]
    Repeats(String),
    /// An impossible pattern.
    #[error("shot {shot:?}: {source}")]
    Pattern {
        /// The shot.
        shot: String,
        /// What is wrong with its pattern.
        source: PatternError,
    },
}

/// What is doubtful about a plan, though it can be carried out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlanWarning {
    /// An exposure shorter than a turn of a colour wheel.
    #[error(
        "shot {shot:?} exposes for {shortest_s} s: below 1/30 s a projector's colour wheel or refresh shows in the frames"
    )]
    ShortExposure {
        /// The shot.
        shot: String,
        /// Its shortest exposure, seconds.
        shortest_s: f64,
    },
    /// An exposure that ends within a turn of the projector's colour wheel.
    #[error(
        "shot {shot:?} exposes for {:.2} ms, which is no whole number of the colour wheel's turns of {:.3} ms: its brightness depends on when it begins",
        1e3 * exposure_s,
        1e3 * turn_s
    )]
    PartialTurn {
        /// The shot.
        shot: String,
        /// The exposure that is farthest from whole turns for its length, seconds.
        exposure_s: f64,
        /// One turn, seconds.
        turn_s: f64,
    },
}

/// What a plan amounts to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PlanSummary {
    /// Shots.
    pub shots: usize,
    /// Frames, over all exposures and repeats.
    pub frames: usize,
    /// Times that something has to be put on the bench.
    pub placements: usize,
    /// Sum of all exposure times, seconds.
    pub exposure_s: f64,
    /// Time that it should take, seconds.
    pub estimated_s: f64,
    /// Standard deviation of that, seconds.
    pub spread_s: f64,
    /// Disk space, but for some hundred bytes a frame.
    pub bytes: u64,
}

impl Shot {
    /// Frames of this shot.
    pub fn frames(&self) -> usize {
        self.exposures_s.len() * self.repeats as usize
    }
}

impl Plan {
    /// Checks a plan that came from outside.
    ///
    /// # Errors
    /// The first thing that would keep it from being carried out.
    pub fn check(&self) -> Result<(), PlanError> {
        if self.shots.is_empty() {
            return Err(PlanError::Empty);
        }
        let mut names = std::collections::HashSet::new();
        for shot in &self.shots {
            let name = || shot.name.clone();
            let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            let length = (1..=60).contains(&shot.name.len());
            if !length || !shot.name.chars().all(allowed) || shot.name.starts_with('-') {
                return Err(PlanError::Name(name()));
            }
            if !names.insert(&shot.name) {
                return Err(PlanError::SameName(name()));
            }
            let exposures = &shot.exposures_s;
            if exposures.is_empty() || exposures.iter().any(|t| !(t.is_finite() && *t > 0.0)) {
                return Err(PlanError::Exposures { shot: name(), found: exposures.clone() });
            }
            if shot.repeats == 0 {
                return Err(PlanError::Repeats(name()));
            }
            shot.pattern.check().map_err(|source| PlanError::Pattern { shot: name(), source })?;
        }
        Ok(())
    }

    /// BLAKE3 of the plan as JSON, by which [`crate::Event::Started`] names it.
    pub fn blake3(&self) -> String {
        blake3::hash(&serde_json::to_vec(self).unwrap_or_default()).to_hex().to_string()
    }

    /// What is worth a second thought before starting, with the turn of the projector's colour
    /// wheel where it is known, seconds.
    pub fn warnings(&self, turn_s: Option<f64>) -> Vec<PlanWarning> {
        let short = |shot: &Shot| {
            let shortest_s = shot.exposures_s.iter().copied().fold(f64::INFINITY, f64::min);
            // A written 0.0333 means 1/30.
            (shortest_s < SHORTEST_SAFE_S * 0.999 && shot.purpose != Purpose::Wheel)
                .then(|| PlanWarning::ShortExposure { shot: shot.name.clone(), shortest_s })
        };
        let partial = |shot: &Shot| {
            let turn_s = turn_s.filter(|t| *t > 0.0)?;
            // The part of a turn by which an exposure misses whole ones.
            let off = |t: f64| (t - (t / turn_s).round() * turn_s).abs() / t;
            let worst = |a: &f64, b: &f64| off(*a).total_cmp(&off(*b));
            let exposure_s = shot.exposures_s.iter().copied().max_by(worst)?;
            (off(exposure_s) > MOST_OF_A_TURN && shot.purpose != Purpose::Wheel)
                .then(|| PlanWarning::PartialTurn { shot: shot.name.clone(), exposure_s, turn_s })
        };
        self.shots.iter().flat_map(|s| [short(s), partial(s)]).flatten().collect()
    }

    /// How much there is to do, and what it takes on a rig of that timing.
    pub fn summary(&self, camera: &CameraInfo, timing: &Timing) -> PlanSummary {
        let frames = self.shots.iter().map(Shot::frames).sum();
        let exposure = |s: &Shot| s.exposures_s.iter().sum::<f64>() * f64::from(s.repeats);
        let exposure_s = self.shots.iter().map(exposure).sum();
        let changes = self.shots.windows(2).filter(|pair| pair[0].target != pair[1].target);
        let placements = changes.count() + usize::from(!self.shots.is_empty());
        let frame_bytes = [camera.width, camera.height, u32::from(camera.channels), 2]
            .into_iter()
            .fold(1, |bytes: u64, n| bytes.saturating_mul(u64::from(n)));
        let [estimated_s, spread_s] = timing.estimate(frames, exposure_s, placements);
        PlanSummary {
            shots: self.shots.len(),
            frames,
            placements,
            exposure_s,
            estimated_s,
            spread_s,
            bytes: (frames as u64).saturating_mul(frame_bytes),
        }
    }
}
