//! Studies: what a choice costs and brings, measured on the simulated rig.

pub(crate) mod acquired;
pub(crate) mod drawing;
pub(crate) mod figure11;
pub(crate) mod figure13;
pub(crate) mod figure14;
pub(crate) mod kept;
pub(crate) mod methods;
pub(crate) mod plans;
pub(crate) mod scene;
pub(crate) mod solving;
pub(crate) mod table2;
pub(crate) mod tally;
pub(crate) mod transport;
pub(crate) mod truth;
mod view;
