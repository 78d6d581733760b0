//! What colour it was: the chart in a picture, and what makes its greys grey.

pub(crate) mod chart;
