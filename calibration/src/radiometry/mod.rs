//! How much light there was: exposure times, response, noise, and the merge of a bracket.

pub(crate) mod bounded;
pub(crate) mod brightness;
pub(crate) mod colour_wheel;
pub(crate) mod debevec;
pub(crate) mod exposure;
pub(crate) mod exr_io;
pub(crate) mod hdr;
pub(crate) mod knots;
pub(crate) mod masters;
pub(crate) mod merge;
pub(crate) mod mosaic;
pub(crate) mod noise;
pub(crate) mod projector_light;
pub(crate) mod raw;
pub(crate) mod response;
pub(crate) mod sights;
pub(crate) mod spool;
pub(crate) mod transfer;
