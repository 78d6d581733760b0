//! Where things are: boards in pictures, camera, projector, and pictures laid onto a face.

pub(crate) mod board;
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
pub(crate) mod views;
mod zhang;
