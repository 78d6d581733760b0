//! Where things are: camera, projector, and pictures laid onto a face.

pub(crate) mod camera;
pub(crate) mod face;
pub(crate) mod levenberg;
pub(crate) mod pose;
pub(crate) mod projected;
pub(crate) mod projector;
pub(crate) mod rectify;
