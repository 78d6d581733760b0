//! A session's calibration in short, for the report: figures, and the two pictures that tell most.

use super::{Shown, field, residuals};
use crate::Failure;
use crate::commands::calibrate::Calibrated;
use crate::report::html::facts;
use ::calibration::Assessment;

/// Figures, how well each pixel is known, and what is left over; `calibration.html` of the session has
/// the rest.
///
/// # Errors
/// A geometry whose parts do not belong together, or a picture that cannot be encoded.
pub(crate) fn summary(calibrated: &Calibrated) -> Result<String, Failure> {
    let geometry = &calibrated.geometry;
    let assessment = Assessment::of(geometry, &[])?;
    let points = geometry.residuals();
    let shown = Shown::of(geometry, &assessment, &points);
    Ok(format!(
        "{}<h3>How well each pixel is known</h3>{}<h3>What is left over</h3>\
         <p>Seen minus explained, all views. Arrows that point every way are noise; arrows that agree with their \
         neighbours are a model that is too simple. Red: left out. calibration/calibration.html in the session shows each view.\
         </p>{}",
        figures(calibrated),
        field::pictures(&shown)?,
        residuals::together(&shown)?
    ))
}

fn figures(c: &Calibrated) -> String {
    let device = |d: &::calibration::Device| {
        let m = &d.model;
        let [k1, k2, p1, p2, ..] = m.distortion;
        format!(
            "{:.3} px RMS; focal lengths {:.1}, {:.1} px; principal point {:.1}, {:.1} px; \
             distortion ({}) {k1:.4} {k2:.4} {p1:.4} {p2:.4}",
            d.rms_px,
            m.fx,
            m.fy,
            m.cx,
            m.cy,
            d.selection.distortion.name()
        )
    };
    let geometry = &c.geometry;
    let verdict = &c.verdict;
    let mut rows = vec![
        ("Geometry", format!("{}. {}", verdict.grade.word(), verdict.sentence())),
        ("Camera", format!("{} views; {}", geometry.views.len(), device(&geometry.camera))),
    ];
    if let Some(projector) = &geometry.projector {
        rows.push(("Projector", device(&projector.device)));
        rows.push((
            "Baseline",
            format!(
                "{:.1} ± {:.1} mm",
                projector.baseline_mm, projector.baseline_standard_deviation_mm
            ),
        ));
    }
    rows.extend([
        ("Front face", format!("{:.3} px RMS", c.front_rms_px)),
        (
            "Response",
            if c.response.is_strictly_increasing() {
                "strictly increasing"
            } else {
                "not strictly increasing"
            }
            .into(),
        ),
        ("White balance", c.white_balance.gains.map(|g| format!("{g:.4}")).join(", ")),
        ("White by chart and by sheet", format!("differ by {:.2} %", 100.0 * c.white_disagreement)),
    ]);
    facts(&rows)
}
