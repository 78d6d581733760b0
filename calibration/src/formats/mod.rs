//! Calibrations on disk: our own TOML with all evidence, OpenCV's YAML, mrcal's `.cameramodel`.

pub(crate) mod cameramodel;
pub(crate) mod native;
pub(crate) mod opencv_storage;
