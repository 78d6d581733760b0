//! What colour it was: the chart in a picture, what makes its greys grey, and the matrix from the
//! camera's colours to everybody's.

pub(crate) mod chart;
pub(crate) mod cie;
pub(crate) mod fit;
pub(crate) mod model;
pub(crate) mod patches;
pub(crate) mod reference;
pub(crate) mod white_balance;
