//! From pictures to geometry and radiance: chessboards, camera and projector calibration, the
//! camera's response, HDR merging with variance, white balance, and pictures laid onto the
//! sample's face.
//!
//! OpenCV is used inside and never shows in a public signature.

mod board;
mod bounded;
mod camera;
mod colour;
mod cv;
mod debevec;
mod error;
mod exposure;
mod exr_io;
mod face;
mod hdr;
mod levenberg;
mod merge;
mod noise;
mod photo;
mod pose;
mod projected;
mod projector;
mod rectify;
mod response;
mod views;

pub use board::{Board, find_board};
pub use camera::{
    CameraCalibration, CameraModel, View, ViewFit, calibrate_camera, pose_from_points,
    reprojection_rms,
};
pub use colour::{Patch, WhiteBalance, find_chart, white_balance};
pub use cv::opencv_version;
pub use debevec::{recover_response, recover_response_above};
pub use error::{CalibrationError, Result};
pub use exposure::{ExposureTable, exif_exposure_s, parse_seconds};
pub use exr_io::{read_exr, write_exr};
pub use face::FacePlane;
pub use hdr::HdrImage;
pub use merge::{Merger, merge};
pub use noise::NoiseModel;
pub use photo::{Photo, list_pictures};
pub use pose::Pose;
pub use projected::{ProjectedBoard, observe_projected_board};
pub use projector::{ProjectorCalibration, ProjectorView, ProjectorViewFit, calibrate_projector};
pub use rectify::{FaceMap, rectify};
pub use response::{KNOTS, Response};
pub use views::{BoardViews, find_views};
