//! From pictures to geometry and radiance.
mod board;
mod camera;
mod cv;
mod error;
mod exposure;
mod photo;
mod pose;

pub use board::{Board, find_board};
pub use camera::{
    CameraCalibration, CameraModel, View, ViewFit, calibrate_camera, pose_from_points,
    reprojection_rms,
};
pub use error::{CalibrationError, Result};
pub use exposure::{ExposureTable, exif_exposure_s, parse_seconds};
pub use photo::{Photo, list_pictures};
pub use pose::Pose;
