//! What a session remembers of its projector's colour wheel: exposures that take whole turns.

use crate::Failure;
use crate::session::PlanConfig;
use calibration::ColourWheel;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The measurement of the projector's light, in a session.
pub(crate) const LIGHT: &str = "calibration/light.json";

/// A measured wheel, and the sample's exposures that follow from it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct KnownWheel {
    pub wheel: ColourWheel,
    /// The sample's exposures in `session.toml` when the wheel was measured, seconds.
    asked_s: Vec<f64>,
    /// Those that are taken in their place, seconds. Kept, so that a wheel that is measured again
    /// to another digit does not make other exposures of the pictures that are there.
    taken_s: Vec<f64>,
}

impl KnownWheel {
    /// `there`: exposures of sample pictures that were taken before, which stay.
    pub fn new(wheel: ColourWheel, asked_s: &[f64], there: Option<Vec<f64>>) -> Self {
        let taken_s = there.unwrap_or_else(|| whole_turns(&wheel, asked_s));
        Self { wheel, asked_s: asked_s.to_vec(), taken_s }
    }

    /// The wheel that a session's measurement of the light found, if there is one.
    pub fn read(session: &Path) -> Option<Self> {
        /// The part of the file that counts here.
        #[derive(Deserialize)]
        struct Part {
            #[serde(default)]
            known_wheel: Option<KnownWheel>,
        }
        let path = session.join(LIGHT);
        let bytes = std::fs::read(&path).ok()?;
        match serde_json::from_slice::<Part>(&bytes) {
            Ok(part) => part.known_wheel,
            Err(e) => {
                let path = path.display();
                eprintln!("warning: {path}: damaged or of another version, not used: {e}");
                None
            }
        }
    }

    /// The sample's exposures where `session.toml` asks for these.
    pub fn bracket_s(&self, asked_s: &[f64]) -> Vec<f64> {
        if asked_s == self.asked_s {
            self.taken_s.clone()
        } else {
            whole_turns(&self.wheel, asked_s)
        }
    }

    /// Makes all exposures of a plan whole turns.
    pub fn set(&self, plan: &mut PlanConfig) {
        let brackets =
            [&mut plan.bracket_s, &mut plan.reference_bracket_s, &mut plan.response_bracket_s];
        for bracket in brackets {
            *bracket = whole_turns(&self.wheel, bracket);
        }
        plan.board_exposure_s = self.wheel.whole_turns_s(plan.board_exposure_s);
    }
}

/// The nearest whole turns of at least 1/30 s; those that become equal are taken once.
fn whole_turns(wheel: &ColourWheel, asked_s: &[f64]) -> Vec<f64> {
    let mut out: Vec<f64> = asked_s.iter().map(|t| wheel.whole_turns_s(*t)).collect();
    out.dedup();
    out
}

/// The wheel of another session on the same rig.
pub(crate) fn of_session(folder: &Path) -> Result<KnownWheel, Failure> {
    KnownWheel::read(folder).ok_or_else(|| {
        let path = folder.join(LIGHT);
        Failure::input(format!("{}: expected a measured colour wheel, found none", path.display()))
            .hint(format!(
                "measure it with: diaphane capture {0} --light && diaphane calibrate light {0}; a \
                 projector without a wheel needs no --light",
                folder.display()
            ))
    })
}
