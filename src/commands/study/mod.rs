//! `diaphane study`: what a choice costs and brings, measured on the simulated rig.

mod acquired;
mod plans;
mod transport;

use crate::Failure;
use crate::output::Done;
use clap::Subcommand;

#[derive(Subcommand)]
pub(crate) enum Args {
    /// A material from Monte-Carlo pictures, under light it was not fitted to
    Acquired(acquired::Args),
    /// Capture time and noise of plain, adaptive and multiplexed plans
    Plans(plans::Args),
    /// The diffusion model against radiative transport
    Transport(transport::Args),
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    match args {
        Args::Acquired(args) => acquired::run(args),
        Args::Plans(args) => plans::run(args),
        Args::Transport(args) => transport::run(args),
    }
}
