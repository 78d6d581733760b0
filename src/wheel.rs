//! What a session remembers of its projector's colour wheel: exposures that take whole turns.

use crate::Failure;
use crate::session::{PlanConfig, Session};
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
    Session::refuse_none(folder).map_err(|e| {
        let error = format!("--light: {}", e.error);
        Failure { error, ..e }.hint("name a session on the same rig that has measured its light")
    })?;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A wheel of so long a turn; its fields besides are calibration's own.
    fn wheel(turn_s: f64) -> ColourWheel {
        let json = serde_json::json!({
            "turn_s": turn_s, "turn_sigma_s": 1e-6, "depth": [1.0], "floor": [0.0],
        });
        serde_json::from_value(json).unwrap()
    }

    fn close(found: &[f64], expected: &[f64]) {
        let same = found.iter().zip(expected).all(|(f, e)| (f / e - 1.0).abs() < 1e-12);
        assert!(same && found.len() == expected.len(), "{found:?}, not {expected:?}");
    }

    #[test]
    fn exposures_are_whole_turns_of_at_least_a_thirtieth_of_a_second() {
        let known = KnownWheel::new(wheel(0.01), &[0.001, 0.0349, 0.052, 0.0549, 0.1], None);
        // Four turns are the fewest of 1/30 s; three exposures that become one are taken once.
        let asked = [0.001, 0.0349, 0.052, 0.0549, 0.1];
        close(&known.bracket_s(&asked), &[0.04, 0.05, 0.1]);
        close(&known.bracket_s(&[0.0751]), &[0.08]);
        let mut plan = PlanConfig {
            board_exposure_s: 0.0333334,
            response_bracket_s: vec![0.0333334, 0.052],
            ..PlanConfig::default()
        };
        known.set(&mut plan);
        close(&[plan.board_exposure_s], &[0.04]);
        close(&plan.response_bracket_s, &[0.04, 0.05]);
    }

    /// A wheel that is measured again to another digit must not ask for other pictures.
    #[test]
    fn exposures_of_pictures_that_are_there_stay() {
        let asked = [0.05, 0.4];
        let first = KnownWheel::new(wheel(0.0111), &asked, None).bracket_s(&asked);
        let again = KnownWheel::new(wheel(0.011_100_1), &asked, Some(first.clone()));
        assert_eq!(again.bracket_s(&asked), first);
        // The plan was changed since: whole turns of the wheel as it is known now.
        close(&again.bracket_s(&[0.05, 0.8]), &[5.0 * 0.011_100_1, 72.0 * 0.011_100_1]);

        let folder = tempfile::tempdir().unwrap();
        assert!(KnownWheel::read(folder.path()).is_none());
        let file = folder.path().join(LIGHT);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        let text = serde_json::json!({ "known_wheel": again, "more": 1 }).to_string();
        std::fs::write(&file, text).unwrap();
        // To the last digit, through the file.
        assert_eq!(KnownWheel::read(folder.path()).unwrap().bracket_s(&asked), first);
    }
}
