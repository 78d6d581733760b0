//! `diaphane study`: what a choice costs and brings, measured on the simulated rig.

mod acquired;
mod common;
mod figure11;
mod figure13;
mod figure14;
mod methods;
mod plans;
mod table2;
mod transport;

use crate::Failure;
use crate::output::Done;
use clap::Subcommand;

#[derive(Subcommand)]
pub(crate) enum Args {
    /// A material from Monte-Carlo pictures, under light it was not fitted to
    Acquired(acquired::Args),
    /// The error of a material over the number of pictures (Wang et al. 2008, figure 11)
    Figure11(figure11::Args),
    /// Smoothness that is too strong, right, and too weak (Wang et al. 2008, figure 13)
    Figure13(figure13::Args),
    /// κ and μ by depth, against the truth (Wang et al. 2008, figure 14)
    Figure14(figure14::Args),
    /// The paper's method against the default, on the same pictures
    Methods(methods::Args),
    /// Capture time and noise of plain, adaptive and multiplexed plans
    Plans(plans::Args),
    /// Time and solves on the grids of the paper's four samples (Wang et al. 2008, Table II)
    Table2(table2::Args),
    /// The diffusion model against radiative transport
    Transport(transport::Args),
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    match args {
        Args::Acquired(args) => acquired::run(args),
        Args::Figure11(args) => figure11::run(args),
        Args::Figure13(args) => figure13::run(args),
        Args::Figure14(args) => figure14::run(args),
        Args::Methods(args) => methods::run(args),
        Args::Plans(args) => plans::run(args),
        Args::Table2(args) => table2::run(args),
        Args::Transport(args) => transport::run(args),
    }
}
