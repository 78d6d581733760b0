//! Studies: what a choice costs and brings, measured on the simulated rig.

pub(crate) mod acquired;
pub(crate) mod drawing;
pub(crate) mod plans;
pub(crate) mod tally;
pub(crate) mod transport;
mod view;
