//! From pictures to geometry and radiance: chessboards, camera and projector calibration, the
//! camera's response, HDR merging with variance, white balance, and pictures laid onto the
//! sample's face.
//!
//! OpenCV is used inside and never shows in a public signature.

mod colour;
mod cv;
mod error;
mod geometry;
mod photo;
mod radiometry;

pub use colour::chart::{Patch, WhiteBalance, find_chart, white_balance};
pub use cv::opencv_version;
pub use error::{CalibrationError, Result};
pub use geometry::board::{Board, find_board};
pub use geometry::camera::{
    CameraCalibration, CameraModel, View, ViewFit, calibrate_camera, pose_from_points,
    reprojection_rms,
};
pub use geometry::face::FacePlane;
pub use geometry::pose::Pose;
pub use geometry::projected::{ProjectedBoard, observe_projected_board};
pub use geometry::projector::{
    ProjectorCalibration, ProjectorView, ProjectorViewFit, calibrate_projector,
};
pub use geometry::rectify::{FaceMap, rectify};
pub use geometry::views::{BoardViews, find_views};
pub use photo::{Photo, list_pictures};
pub use radiometry::debevec::{recover_response, recover_response_above};
pub use radiometry::exposure::{ExposureTable, exif_exposure_s, parse_seconds};
pub use radiometry::exr_io::{ExrPrecision, read_exr, write_exr, write_exr_as};
pub use radiometry::hdr::HdrImage;
pub use radiometry::masters::{FlatField, MasterDark};
pub use radiometry::merge::drift::ExposureCheck;
pub use radiometry::merge::{MergeReport, Merger, merge};
pub use radiometry::mosaic::{Bayer, merge_mosaic};
pub use radiometry::noise::NoiseModel;
pub use radiometry::response::{KNOTS, Response};
pub use radiometry::transfer::{Estimate, PhotonTransfer, SensorNoise, TransferPoint};
