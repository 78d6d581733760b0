//! What went wrong, in words, and the way out of it.

use serde_json::json;

/// A command that did not do what it was asked to.
#[derive(Debug)]
pub struct Failure {
    /// What was expected, what was found and where.
    pub error: String,
    /// What to do about it.
    pub hint: Option<String>,
    /// 2: wrong usage or input; 1: anything else.
    pub code: u8,
    /// More for `--json`: an object whose keys stand beside `error` and `hint`.
    pub details: Option<serde_json::Value>,
}

impl Failure {
    /// Wrong usage or input: exit code 2.
    pub fn input(error: impl ToString) -> Self {
        Self { error: error.to_string(), hint: None, code: 2, details: None }
    }

    /// Something else: exit code 1.
    pub fn other(error: impl ToString) -> Self {
        Self { error: error.to_string(), hint: None, code: 1, details: None }
    }

    /// The same failure with a way out.
    pub fn hint(self, hint: impl Into<String>) -> Self {
        Self { hint: Some(hint.into()), ..self }
    }

    /// A result of an earlier step that is not there yet.
    pub fn missing(what: &str, command: &str) -> Self {
        Self::input(format!("{what} is not there yet")).hint(format!("make it with: {command}"))
    }

    pub(crate) fn json(&self) -> serde_json::Value {
        let mut out = json!({ "error": self.error, "hint": self.hint });
        if let (Some(out), Some(serde_json::Value::Object(more))) =
            (out.as_object_mut(), &self.details)
        {
            out.extend(more.clone());
        }
        out
    }
}

impl From<material::FileError> for Failure {
    fn from(error: material::FileError) -> Self {
        let failure = Self::input(&error);
        match error {
            material::FileError::Exists { .. } => failure.hint("add --force to replace it"),
            _ => failure,
        }
    }
}

impl From<calibration::CalibrationError> for Failure {
    fn from(error: calibration::CalibrationError) -> Self {
        use calibration::CalibrationError as E;
        let counted;
        let hint = match &error {
            E::BoardNotFound {
                reason: calibration::NoBoard::OtherBoard { seen: Some(s), .. },
                ..
            } => {
                counted = format!(
                    "count the inner corners, columns x rows: this may be --board {}x{}",
                    s[0], s[1]
                );
                &counted
            }
            E::TooFewViews { .. } => "take more pictures: ten or so, tilted and placed differently",
            E::Degenerate { .. } => {
                "tilt the board by 20 to 40 degrees, about another axis in each picture"
            }
            E::Folded { .. } => {
                "leave the choice to --distortion auto, or add views that reach into that corner"
            }
            _ => "",
        };
        match error {
            E::File(error) => error.into(),
            error if hint.is_empty() => Self::input(error),
            error => Self::input(error).hint(hint),
        }
    }
}

macro_rules! from_input {
    ($($error:ty),* $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::input(error)
            }
        })*
    };
}
// What these report is always in what was given: a file, a picture, a setting.
from_input!(
    diffusion::IlluminationError,
    diffusion::MeasurementError,
    diffusion::MediumError,
    material::GridError,
    material::MaterialError,
    rig::FrameError,
    rig::PlanError,
);

macro_rules! from_other {
    ($($error:ty),* $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::other(error)
            }
        })*
    };
}
from_other!(diffusion::BssrdfError, renderer::RelightError, rig::DeviceError,);

impl From<diffusion::GpuError> for Failure {
    fn from(error: diffusion::GpuError) -> Self {
        use diffusion::GpuError as E;
        match error {
            E::NoAdapter { .. } | E::Limit { .. } => {
                Self::input(error).hint("use --device cpu, or install the GPU's Vulkan driver")
            }
            E::OutOfMemory { .. } => Self::input(error)
                .hint("use --device cpu, or a coarser grid (diaphane init --cells)"),
            E::Device { .. } | E::Lost { .. } => {
                Self::other(error).hint("use --device cpu, or try again")
            }
        }
    }
}

impl From<diffusion::SolveError> for Failure {
    fn from(error: diffusion::SolveError) -> Self {
        match error {
            diffusion::SolveError::Gpu(error) => error.into(),
            other => Self::other(other),
        }
    }
}

impl From<diffusion::InverseError> for Failure {
    fn from(error: diffusion::InverseError) -> Self {
        match error {
            diffusion::InverseError::Solve(error) => error.into(),
            other => Self::other(other),
        }
    }
}

impl From<rig::RunError> for Failure {
    fn from(error: rig::RunError) -> Self {
        match error {
            rig::RunError::Device { ref source, .. }
                if source.kind() == rig::DeviceErrorKind::Declined =>
            {
                Self::other(error)
                    .hint("see to that and run the same command again: nothing is lost")
            }
            rig::RunError::Device { .. } => Self::other(error)
                .hint("mend the device and run the same command again: nothing is lost"),
            rig::RunError::NoSpace { .. } => {
                Self::other(error).hint("make room and run the same command again: nothing is lost")
            }
            rig::RunError::Journal(error) => error.into(),
            error => Self::input(error),
        }
    }
}

impl From<rig::JournalError> for Failure {
    fn from(error: rig::JournalError) -> Self {
        use rig::JournalError as E;
        let hint = match &error {
            E::InUse { .. } => "wait until it has ended, or end it with Ctrl-C".to_owned(),
            E::Damaged { path, .. } => format!(
                "move {} away and capture again: frames that are whole are kept",
                path.display()
            ),
            E::Io { .. } => return Self::input(error),
        };
        Self::input(error).hint(hint)
    }
}
