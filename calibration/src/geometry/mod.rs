//! Where things are: camera, projector, and pictures laid onto a face.

mod bundle;
pub(crate) mod calibrate;
pub(crate) mod camera;
pub(crate) mod camera_model;
pub(crate) mod distortion;
pub(crate) mod face;
pub(crate) mod pose;
pub(crate) mod rectify;
mod resection;
pub(crate) mod result;
pub(crate) mod rig_view;
pub(crate) mod selection;
mod zhang;
