//! Two calibrations from half of the views each: how far apart are they?

use serde::{Deserialize, Serialize};

use crate::assessment::rays::{RayUncertainty, ray_difference};
use crate::error::{CalibrationError, Result};
use crate::geometry::calibrate::{Choice, calibrate_geometry};
use crate::geometry::result::{Device, Geometry};
use crate::geometry::rig_view::RigView;

/// Odd and even views calibrated apart, with the distortion that all of them together chose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Halves {
    /// The camera's two calibrations.
    pub camera: HalfDifference,
    /// The projector's, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub projector: Option<HalfDifference>,
}

/// Difference of two calibrations of one device over its picture, the best turn taken off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HalfDifference {
    /// sqrt(mean(dx² + dy²)), pixels.
    pub rms_px: f64,
    /// The largest, pixels.
    pub max_px: f64,
    /// The RMS that the two covariances predict, pixels: views that differ by noise alone come
    /// near it.
    pub predicted_px: f64,
}

impl Halves {
    /// # Errors
    /// A half that cannot be calibrated.
    pub(crate) fn of(geometry: &Geometry) -> Result<Self> {
        let size = |d: &Device| [d.model.width, d.model.height];
        let projector = geometry.projector.as_ref();
        let choice = Choice {
            camera: Some(geometry.camera.selection.distortion),
            projector: projector.map(|p| p.device.selection.distortion),
            skew: geometry.covariance.parameters.iter().any(|name| name == "camera.skew"),
            warp: geometry.warp_mm.is_some(),
        };
        let half = |odd: usize| {
            let views: Vec<RigView> =
                geometry.observations.iter().skip(odd).step_by(2).cloned().collect();
            let lit = projector.map(|p| size(&p.device));
            calibrate_geometry(&views, size(&geometry.camera), lit, choice)
        };
        let (even, odd) = (half(0)?, half(1)?);
        let camera = compare("camera", [(&even.camera, &even), (&odd.camera, &odd)])?;
        let projector = match (&even.projector, &odd.projector) {
            (Some(a), Some(b)) => {
                Some(compare("projector", [(&a.device, &even), (&b.device, &odd)])?)
            }
            _ => None,
        };
        Ok(Self { camera, projector })
    }
}

fn compare(name: &'static str, pair: [(&Device, &Geometry); 2]) -> Result<HalfDifference> {
    let [a, b] = pair;
    let folded = || CalibrationError::Degenerate {
        what: name,
        reason: "a half of the views leaves a distortion that folds the picture".into(),
    };
    let apart = ray_difference(&a.0.model, &b.0.model).ok_or_else(folded)?;
    let squares: Vec<f64> = apart.iter().map(|d| d[0] * d[0] + d[1] * d[1]).collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let mut predicted = 0.0;
    for (device, geometry) in pair {
        let rays = RayUncertainty::of(device, name, &geometry.covariance)?;
        let traces: Vec<f64> = rays.covariance_px.iter().map(|c| c[0][0] + c[1][1]).collect();
        predicted += mean(&traces);
    }
    Ok(HalfDifference {
        rms_px: mean(&squares).sqrt(),
        max_px: squares.iter().copied().fold(0.0, f64::max).sqrt(),
        predicted_px: predicted.sqrt(),
    })
}
