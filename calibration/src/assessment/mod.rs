//! How good a calibration is: how far each pixel can be trusted, what the pictures covered, and a
//! verdict in words with what to do next.

pub(crate) mod coverage;
mod findings;
pub(crate) mod halves;
pub(crate) mod rays;
pub(crate) mod verdict;

use serde::{Deserialize, Serialize};

use crate::assessment::coverage::{BoardStance, Coverage, Stance, Zone};
use crate::assessment::halves::Halves;
use crate::assessment::rays::RayUncertainty;
use crate::assessment::verdict::Verdict;
use crate::error::{CalibrationError, Result};
use crate::geometry::result::{Device, Geometry};
use crate::geometry::rig_view::Sight;

/// What can be said about a calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Assessment {
    /// In words.
    pub verdict: Verdict,
    /// The camera.
    pub camera: DeviceAssessment,
    /// The projector, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<DeviceAssessment>,
    /// How the boards stood.
    pub stance: Stance,
    /// How each of them stood, in the order of the views.
    pub boards: Vec<BoardStance>,
    /// Odd against even views; None where they do not make two calibrations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub halves: Option<Halves>,
    /// Why there are no halves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub without_halves: Option<String>,
    /// Pictures without a board, each with the reason.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub missed: Vec<String>,
}

/// What can be said about one device.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeviceAssessment {
    /// How well it is known which way each pixel looks.
    pub uncertainty: RaySigma,
    /// Where its points lie in its picture.
    pub coverage: Coverage,
}

/// 1-sigma of where a device sees a ray, over its picture, the best turn of the device taken off
/// ([`RayUncertainty`]); along the worst direction, pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RaySigma {
    /// Points across and down, the picture's rim included.
    pub points: [usize; 2],
    /// At each point, row by row.
    pub sigma_px: Vec<f64>,
    /// Root of the mean square.
    pub rms_px: f64,
    /// The largest.
    pub worst_px: f64,
    /// Where that is, pixels.
    pub worst_at: [f64; 2],
    /// The part of the picture that it is in.
    pub worst_zone: Zone,
}

impl RaySigma {
    fn of(rays: &RayUncertainty, size: [usize; 2]) -> Self {
        let sigma_px = rays.sigma_px();
        let mean = sigma_px.iter().map(|s| s * s).sum::<f64>() / sigma_px.len().max(1) as f64;
        let worst = sigma_px.iter().zip(&rays.pixels).max_by(|a, b| a.0.total_cmp(b.0));
        let (worst_px, worst_at) = worst.map_or((0.0, [0.0; 2]), |(s, q)| (*s, *q));
        let worst_zone = Zone::of(worst_at, size);
        Self { points: rays.points, sigma_px, rms_px: mean.sqrt(), worst_px, worst_at, worst_zone }
    }
}

impl Assessment {
    /// Assesses a calibration; `missed` says for each picture without a board why it has none.
    ///
    /// # Errors
    /// A geometry whose parts do not belong together, or a distortion that folds a picture: files
    /// that were edited by hand.
    pub fn of(geometry: &Geometry, missed: &[String]) -> Result<Self> {
        coherent(geometry)?;
        let used: Vec<_> = geometry.residuals().into_iter().filter(|r| r.used).collect();
        let assess = |device: &Device, name, lit: bool| -> Result<DeviceAssessment> {
            let size = [device.model.width, device.model.height];
            let points = used.iter().filter(|r| (r.sight != Sight::Printed) == lit);
            let rays = RayUncertainty::of(device, name, &geometry.covariance)?;
            Ok(DeviceAssessment {
                uncertainty: RaySigma::of(&rays, size),
                coverage: Coverage::of(size, points.map(|r| r.pixel)),
            })
        };
        let camera = assess(&geometry.camera, "camera", false)?;
        let projector = geometry.projector.as_ref();
        let projector = projector.map(|p| assess(&p.device, "projector", true)).transpose()?;
        let (halves, without_halves) = match Halves::of(geometry) {
            Ok(halves) => (Some(halves), None),
            Err(error) => (None, Some(error.to_string())),
        };
        let boards = BoardStance::all(geometry);
        let mut out = Self {
            verdict: Verdict::default(),
            camera,
            projector,
            stance: Stance::of(geometry, &boards),
            boards,
            halves,
            without_halves,
            missed: missed.to_vec(),
        };
        out.verdict = findings::judge(geometry, &out);
        Ok(out)
    }
}

/// One fit and one set of observations a view, and a covariance as large as its names say.
fn coherent(geometry: &Geometry) -> Result<()> {
    let mismatch = |expected: String, found: String| CalibrationError::Mismatch {
        picture: "calibration".into(),
        expected,
        found,
    };
    let (fits, seen) = (geometry.views.len(), geometry.observations.len());
    if fits != seen || seen == 0 {
        let expected = "observations of each of its views".into();
        return Err(mismatch(expected, format!("{seen} of {fits} views")));
    }
    let n = geometry.covariance.parameters.len();
    let rows = &geometry.covariance.matrix;
    if rows.len() != n || rows.iter().any(|r| r.len() != n || !r.iter().all(|v| v.is_finite())) {
        let expected = format!("a covariance of {n} rows of {n} numbers");
        return Err(mismatch(expected, "another".into()));
    }
    Ok(())
}
