//! What people choose where a material goes to renderers, and what they are told of it.

use crate::Failure;
use crate::output::counted;
use material::{Conversion, FileError, Impossible, SceneUnit};

/// Flags of commands that write renderers' formats.
#[derive(clap::Args)]
pub(crate) struct ConversionArgs {
    /// Length that is 1 in the renderer's scene: mm, cm or m
    #[arg(long, default_value = "mm")]
    unit: SceneUnit,
    /// Give voxels that no scattering medium has (3κμ > 1) no scattering instead of refusing them
    #[arg(long)]
    clamp: bool,
}

impl ConversionArgs {
    pub fn conversion(&self) -> Conversion {
        let impossible = if self.clamp { Impossible::Clamp } else { Impossible::Refuse };
        Conversion { unit: self.unit, impossible }
    }
}

/// The way out where voxels are impossible.
pub(crate) fn may_be_clamped(error: FileError) -> Failure {
    let impossible = matches!(error, FileError::Impossible { .. });
    let failure = Failure::from(error);
    if impossible { failure.hint("add --clamp to write them without scattering") } else { failure }
}

pub(crate) fn warn_of_clamped(clamped: usize) {
    if clamped > 0 {
        eprintln!("warning: clamped to no scattering: {}", counted(clamped, "voxel value"));
    }
}
