//! `diaphane study`: what a choice costs and brings, measured on the simulated rig.

mod plans;

use crate::Failure;
use crate::output::Done;
use clap::Subcommand;

#[derive(Subcommand)]
pub(crate) enum Args {
    /// Capture time and noise of plain, adaptive and multiplexed plans
    Plans(plans::Args),
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    match args {
        Args::Plans(args) => plans::run(args),
    }
}
