//! OpenCV's FileStorage (YAML, XML, JSON), written and read by OpenCV itself.

use std::io::Write;
use std::path::Path;

use material::{Overwrite, atomic_write};
use opencv::core::{FileNode, FileStorage, FileStorage_Mode, Mat};
use opencv::prelude::*;

use crate::error::{CalibrationError, Result};
use crate::geometry::camera_model::CameraModel;
use crate::geometry::distortion::Distortion;
use crate::geometry::pose::Pose;
use crate::geometry::result::{Covariance, Device, Geometry, ProjectorGeometry};
use crate::geometry::selection::Selection;

/// Writes the models under the names of OpenCV's own samples: `image_width`, `image_height`,
/// `camera_matrix`, `distortion_coefficients`, `avg_reprojection_error`; where there is a
/// projector also `projector_width`, `projector_height`, `projector_matrix`,
/// `projector_distortion_coefficients`, and `R`, `T` (mm) from camera to projector.
///
/// # Errors
/// A skewed camera, which OpenCV would read without complaint and ignore; a file that exists or
/// cannot be written.
pub fn write_opencv(path: &Path, geometry: &Geometry, overwrite: Overwrite) -> Result<()> {
    if geometry.camera.model.skew != 0.0 {
        return Err(CalibrationError::BadInput {
            what: "camera".into(),
            expected: "rows and columns at right angles: OpenCV ignores a skew".into(),
            found: format!("skew {}", geometry.camera.model.skew),
        });
    }
    let text = storage_text(path, geometry)
        .map_err(CalibrationError::opencv("writing a calibration for OpenCV"))?;
    Ok(atomic_write(path, overwrite, |out| out.write_all(text.as_bytes()))?)
}

fn storage_text(path: &Path, geometry: &Geometry) -> opencv::Result<String> {
    // In memory the name says no more than which of its formats is meant.
    let name = format!(".{}", path.extension().unwrap_or_default().to_string_lossy());
    let mode = FileStorage_Mode::WRITE as i32 | FileStorage_Mode::MEMORY as i32;
    let mut storage = FileStorage::new_def(&name, mode)?;
    let camera = &geometry.camera;
    write_device(&mut storage, ["image", "camera_matrix", ""], &camera.model)?;
    storage.write_f64("avg_reprojection_error", camera.rms_px)?;
    if let Some(projector) = &geometry.projector {
        let names = ["projector", "projector_matrix", "projector_"];
        write_device(&mut storage, names, &projector.device.model)?;
        storage.write_mat("R", &Mat::from_slice_2d(&projector.pose.rotation)?)?;
        let t = projector.pose.translation_mm.map(|t| [t]);
        storage.write_mat("T", &Mat::from_slice_2d(&t)?)?;
    }
    storage.release_and_get_string()
}

fn write_device(
    storage: &mut FileStorage,
    [size, matrix, prefix]: [&str; 3],
    m: &CameraModel,
) -> opencv::Result<()> {
    storage.write_i32(&format!("{size}_width"), m.width as i32)?;
    storage.write_i32(&format!("{size}_height"), m.height as i32)?;
    let k = [[m.fx, m.skew, m.cx], [0.0, m.fy, m.cy], [0.0, 0.0, 1.0]];
    storage.write_mat(matrix, &Mat::from_slice_2d(&k)?)?;
    let count = if m.distortion[5..] == [0.0; 3] { 5 } else { 8 };
    let d = Mat::from_slice(&m.distortion[..count])?.try_clone()?;
    storage.write_mat(&format!("{prefix}distortion_coefficients"), &d)
}

/// Reads a calibration that OpenCV, or a program with its samples' habits, has written.
///
/// Names understood: `camera_matrix`, `cameraMatrix`, `K`, `M1`, `K1`; `distortion_coefficients`,
/// `dist_coeffs`, `distCoeffs`, `D`, `D1`; `image_width` and `image_height`; the projector's as
/// written by [`write_opencv`]. There is no evidence in such a file: no covariance, no views.
///
/// # Errors
/// No such file, not FileStorage, a name that is missing, a matrix that is no camera's, or more
/// than eight coefficients (thin prism, tilt) that are not zero.
pub fn read_opencv(path: &Path) -> Result<Geometry> {
    let bad = |found: String| CalibrationError::BadFile {
        path: path.into(),
        expected: "OpenCV's camera_matrix, distortion_coefficients, image_width, image_height"
            .into(),
        found,
    };
    let text = std::fs::read_to_string(path).map_err(CalibrationError::io(path))?;
    let mode = FileStorage_Mode::READ as i32 | FileStorage_Mode::MEMORY as i32;
    let storage = FileStorage::new_def(&text, mode).map_err(|e| bad(e.message))?;
    let reader = Reader { storage: &storage };
    let camera = reader
        .device(
            ["image_width", "image_height"],
            &["camera_matrix", "cameraMatrix", "K", "M1", "K1"],
            &["distortion_coefficients", "dist_coeffs", "distCoeffs", "D", "D1"],
        )
        .map_err(bad)?;
    let mut out = Geometry {
        rms_px: reader.number("avg_reprojection_error").unwrap_or(0.0),
        warp_mm: None,
        camera: unproven(camera),
        projector: None,
        covariance: Covariance { parameters: Vec::new(), matrix: Vec::new() },
        views: Vec::new(),
        outliers: Vec::new(),
        observations: Vec::new(),
    };
    out.camera.rms_px = out.rms_px;
    if reader.number("projector_width").is_some() {
        let model = reader
            .device(
                ["projector_width", "projector_height"],
                &["projector_matrix"],
                &["projector_distortion_coefficients"],
            )
            .map_err(bad)?;
        let rotation = reader.matrix(&["R"], 9).map_err(bad)?;
        let shift = reader.matrix(&["T"], 3).map_err(bad)?;
        let pose = Pose {
            rotation: [0, 1, 2].map(|i| [0, 1, 2].map(|j| rotation[3 * i + j])),
            translation_mm: [shift[0], shift[1], shift[2]],
        };
        out.projector = Some(ProjectorGeometry {
            baseline_mm: shift.iter().map(|t| t * t).sum::<f64>().sqrt(),
            baseline_standard_deviation_mm: 0.0,
            device: unproven(model),
            pose,
            pose_standard_deviations: [0.0; 6],
        });
    }
    Ok(out)
}

/// A device of which nothing but the model is known.
fn unproven(model: CameraModel) -> Device {
    let used = model.distortion.iter().rposition(|d| *d != 0.0);
    let distortion = match used {
        None => Distortion::None,
        Some(0) => Distortion::K1,
        Some(1) => Distortion::K1K2,
        Some(2 | 3) => Distortion::K1K2P1P2,
        Some(4) => Distortion::Five,
        Some(_) => Distortion::Rational,
    };
    Device {
        rms_px: 0.0,
        noise_px: 0.0,
        selection: Selection { distortion, trials: Vec::new() },
        standard_deviations: [0.0; crate::INTRINSICS],
        model,
    }
}

struct Reader<'a> {
    storage: &'a FileStorage,
}

impl Reader<'_> {
    fn node(&self, names: &[&str]) -> Option<FileNode> {
        names.iter().find_map(|name| {
            let node = self.storage.get(name).ok()?;
            (!node.empty().unwrap_or(true)).then_some(node)
        })
    }

    fn number(&self, name: &str) -> Option<f64> {
        let node = self.node(&[name])?;
        let number = node.is_int().unwrap_or(false) || node.is_real().unwrap_or(false);
        number.then(|| node.to_f64().ok()).flatten().filter(|v| v.is_finite())
    }

    /// At least `count` numbers of the first matrix that is there.
    fn matrix(&self, names: &[&str], count: usize) -> std::result::Result<Vec<f64>, String> {
        let missing = || format!("no {}", names[0]);
        let node = self.node(names).ok_or_else(missing)?;
        let mat = node.mat().map_err(|e| e.message)?;
        let mut double = Mat::default();
        mat.convert_to(&mut double, opencv::core::CV_64F, 1.0, 0.0).map_err(|e| e.message)?;
        let values = double.data_typed::<f64>().map_err(|e| e.message)?.to_vec();
        if values.len() < count || values.iter().any(|v| !v.is_finite()) {
            let found = values.len();
            return Err(format!("{} of {found} numbers, or one not finite", names[0]));
        }
        Ok(values)
    }

    fn device(
        &self,
        size: [&str; 2],
        matrix: &[&str],
        distortion: &[&str],
    ) -> std::result::Result<CameraModel, String> {
        let side = |name: &str| match self.number(name) {
            Some(v) if (1.0..1e6).contains(&v) => Ok(v as usize),
            Some(v) => Err(format!("{name} {v}")),
            None => Err(format!("no {name}")),
        };
        let [width, height] = [side(size[0])?, side(size[1])?];
        let k = self.matrix(matrix, 9)?;
        if k[0] <= 0.0 || k[4] <= 0.0 || k[8] != 1.0 {
            return Err(format!("{} that is no camera's", matrix[0]));
        }
        let found = self.matrix(distortion, 0)?;
        if found.iter().skip(8).any(|v| *v != 0.0) {
            return Err(format!("{} coefficients; at most 8 are understood", found.len()));
        }
        let mut model = CameraModel::pinhole([width, height], [k[0], k[4]], [k[2], k[5]]);
        model.skew = k[1];
        model.distortion.iter_mut().zip(&found).for_each(|(d, f)| *d = *f);
        match model.fold() {
            None => Ok(model),
            Some([x, y]) => {
                Err(format!("a distortion that folds the picture at pixel ({x:.0}, {y:.0})"))
            }
        }
    }
}
