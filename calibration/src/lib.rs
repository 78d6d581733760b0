//! From pictures to geometry and radiance: chessboards, camera and projector calibration, the
//! camera's response, HDR merging with variance, white balance, and pictures laid onto the
//! sample's face.
//!
//! OpenCV is used inside and never shows in a public signature.

mod assessment;
mod colour;
mod cv;
mod detection;
mod error;
mod formats;
mod geometry;
mod median;
mod photo;
mod radiometry;
mod structured_light;

pub use assessment::coverage::{BoardStance, Coverage, Stance, Zone};
pub use assessment::halves::{HalfDifference, Halves};
pub use assessment::rays::{RayUncertainty, ray_difference};
pub use assessment::verdict::{Grade, Reason, Verdict};
pub use assessment::{Assessment, DeviceAssessment, RaySigma};
pub use colour::chart::{find_chart, read_chart};
pub use colour::cie::{delta_e2000, srgb_to_linear};
pub use colour::fit::{ColourCalibration, DeltaE, ModelScore, PatchFit, calibrate_colour};
pub use colour::model::{ColourCorrection, ColourModel};
pub use colour::patches::Patch;
pub use colour::reference::{ChartReference, Illuminant, PATCH_NAMES};
pub use colour::white_balance::{WhiteBalance, white_balance};
pub use cv::opencv_version;
pub use detection::board::{Board, Markers};
pub use detection::dictionary::MarkerDictionary;
pub use detection::found::{DroppedCorner, FoundBoard, SeenCorner, detect_board, find_board};
pub use detection::missing::NoBoard;
pub use detection::quality::BoardQuality;
pub use detection::views::{BoardViews, find_views};
pub use error::{CalibrationError, Result};
pub use formats::cameramodel::write_cameramodel;
pub use formats::native::{read_geometry, write_geometry};
pub use formats::opencv_storage::{read_opencv, write_opencv};
pub use geometry::calibrate::{Choice, calibrate_geometry};
pub use geometry::camera::{View, pose_from_points, reprojection_rms};
pub use geometry::camera_model::{CameraModel, INTRINSIC_NAMES, INTRINSICS};
pub use geometry::distortion::Distortion;
pub use geometry::face::FacePlane;
pub use geometry::pose::Pose;
pub use geometry::rectify::{FaceMap, rectify};
pub use geometry::result::{
    Covariance, Device, Geometry, Outlier, PointResidual, ProjectorGeometry, ViewFit,
};
pub use geometry::rig_view::{CodedCorner, ProjectedPoint, RigView, Sight};
pub use geometry::selection::{ModelTrial, Selection};
pub use photo::{Photo, list_pictures};
pub use radiometry::brightness::{Brightness, check_brightness};
pub use radiometry::colour_wheel::{BurstFrame, ColourWheel, find_colour_wheel};
pub use radiometry::debevec::{recover_response, recover_response_above};
pub use radiometry::exposure::{ExposureTable, exif_exposure_s, parse_seconds};
pub use radiometry::exr_io::{ExrPrecision, read_exr, write_exr, write_exr_as};
pub use radiometry::hdr::HdrImage;
pub use radiometry::masters::{FlatField, MasterDark};
pub use radiometry::merge::drift::ExposureCheck;
pub use radiometry::merge::{MergeReport, Merger, merge};
pub use radiometry::mosaic::{merge_mosaic, quads};
pub use radiometry::noise::NoiseModel;
pub use radiometry::projector_light::{
    ChannelLight, ProjectorFlatField, ProjectorLight, measure_projector_light,
};
pub use radiometry::raw::{RawPhoto, read_raw};
pub use radiometry::response::{KNOTS, Response};
pub use radiometry::transfer::{Estimate, PhotonTransfer, SensorNoise, TransferPoint};
pub use raw::{Bayer, is_raw};
pub use structured_light::corners::{LitCorner, coded_corners, light_corners};
pub use structured_light::decode::{CodeMap, Decoded, decode};
pub use structured_light::layout::{CodeLayout, CodePicture, PhaseShift};
