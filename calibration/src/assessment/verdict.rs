//! Good, usable or to be done again, and why.

use serde::{Deserialize, Serialize};

/// How good something measured is.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Grade {
    /// Within what the method reaches on a well-kept rig.
    #[default]
    Good,
    /// Good enough to go on; something is worse than it need be.
    Usable,
    /// Something went wrong on the way.
    Redo,
}

impl Grade {
    /// The grade of a figure that is good and usable up to two limits. One that is no number is
    /// within neither.
    pub fn of(value: f64, [good, usable]: [f64; 2]) -> Self {
        if value <= good {
            Self::Good
        } else if value <= usable {
            Self::Usable
        } else {
            Self::Redo
        }
    }

    /// In a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Usable => "usable",
            Self::Redo => "redo",
        }
    }
}

/// One thing that a verdict rests on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reason {
    /// What it allows at best.
    pub grade: Grade,
    /// In words, with its figure.
    pub text: String,
}

/// The worst of its reasons, and what to do about them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// The worst of the reasons' grades.
    pub grade: Grade,
    /// The worst first.
    pub reasons: Vec<Reason>,
    /// What to do next, the most pressing first; empty where there is nothing to do.
    pub advice: Vec<String>,
}

impl Verdict {
    /// What the grade means, in a sentence.
    pub fn sentence(&self) -> &'static str {
        match self.grade {
            Grade::Good => "It is known well enough where each pixel looks.",
            Grade::Usable => "Good enough to go on with; it can be made better.",
            Grade::Redo => "Do not build on it: take the pictures again.",
        }
    }
}
