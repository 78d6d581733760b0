//! mrcal's `.cameramodel`: a Python dictionary in text (mrcal 2, "camera model" in its manual).

use std::io::Write;
use std::path::Path;

use material::{Overwrite, atomic_write};

use crate::error::{CalibrationError, Result};
use crate::geometry::camera_model::CameraModel;
use crate::geometry::pose::Pose;

/// Millimetres in mrcal's customary unit.
const MM_PER_M: f64 = 1000.0;

/// Writes a device for mrcal; `pose` takes the reference frame (the camera's) to the device's.
///
/// A pinhole becomes LENSMODEL_PINHOLE, five coefficients LENSMODEL_OPENCV5, a denominator
/// LENSMODEL_OPENCV8. Translations are in metres.
///
/// # Errors
/// A skewed device, which mrcal has no model for; a file that exists or cannot be written.
pub fn write_cameramodel(
    path: &Path,
    model: &CameraModel,
    pose: &Pose,
    overwrite: Overwrite,
) -> Result<()> {
    if model.skew != 0.0 {
        return Err(CalibrationError::BadInput {
            what: "device".into(),
            expected: "rows and columns at right angles: mrcal has no skew".into(),
            found: format!("skew {}", model.skew),
        });
    }
    let d = model.distortion;
    let (name, coefficients): (&str, &[f64]) = if d == [0.0; 8] {
        ("LENSMODEL_PINHOLE", &[])
    } else if d[5..] == [0.0; 3] {
        ("LENSMODEL_OPENCV5", &d[..5])
    } else {
        ("LENSMODEL_OPENCV8", &d)
    };
    let list =
        |values: &[f64]| values.iter().map(|v| format!("{v:.17e}")).collect::<Vec<_>>().join(", ");
    let intrinsics = [&[model.fx, model.fy, model.cx, model.cy], coefficients].concat();
    let turn = pose.rotation_vector();
    let shift = pose.translation_mm.map(|t| t / MM_PER_M);
    let text = format!(
        "{{\n    'lensmodel':  '{name}',\n\n    # fx, fy, cx, cy, then the distortion\n    \
         'intrinsics': [ {} ],\n\n    # reference frame to this device: rotation vector, \
         translation in metres\n    'extrinsics': [ {} ],\n\n    'imagersize': [ {}, {} ]\n}}\n",
        list(&intrinsics),
        list(&[turn, shift].concat()),
        model.width,
        model.height
    );
    Ok(atomic_write(path, overwrite, |out| out.write_all(text.as_bytes()))?)
}
