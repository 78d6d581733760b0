//! The plane of the sample's face, seen by a camera or lit by a projector.

use serde::{Deserialize, Serialize};

use crate::geometry::camera_model::CameraModel;
use crate::geometry::pose::Pose;

/// Maps places on a face of the sample (x, y in mm in the sample frame) to pixels and back.
///
/// The device is a camera or a projector; for a projector this is what turns a wanted region of
/// the face into a picture to show.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FacePlane {
    /// Camera or projector.
    pub device: CameraModel,
    /// Sample frame to device frame.
    pub pose: Pose,
    /// z of the plane in the sample frame, mm: 0 for the front face, the thickness for the back.
    pub z_mm: f64,
}

impl FacePlane {
    /// The pixel where a place on the face is seen (or lit from).
    ///
    /// None where it lies behind the device. The pixel may lie outside the picture.
    pub fn face_to_pixel(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let pixel = self.device.project(self.pose.apply([x, y, self.z_mm]));
        pixel[0].is_finite().then_some(pixel)
    }

    /// The place on the face, mm, that a pixel sees (or lights).
    ///
    /// None where its ray misses the plane or the distortion has no inverse.
    pub fn pixel_to_face(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let [x, y, _] = intersect(&self.device, &self.pose, self.z_mm, pixel)?;
        Some([x, y])
    }
}

/// Where a pixel's ray meets the plane z = `z_mm` of the object frame, in the object frame, mm.
pub(crate) fn intersect(
    device: &CameraModel,
    pose: &Pose,
    z_mm: f64,
    pixel: [f64; 2],
) -> Option<[f64; 3]> {
    let [a, b] = device.undistort(pixel)?;
    let back = pose.inverse();
    let (eye, ray) = (back.translation_mm, back.rotate([a, b, 1.0]));
    let distance = (z_mm - eye[2]) / ray[2];
    (distance.is_finite() && distance > 0.0)
        .then(|| std::array::from_fn(|i| eye[i] + distance * ray[i]))
}
