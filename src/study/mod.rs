//! Studies: what a choice costs and brings, measured on the simulated rig.

pub(crate) mod drawing;
pub(crate) mod plans;
pub(crate) mod tally;
mod view;
