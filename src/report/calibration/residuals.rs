//! Residuals where they are: arrows, all views together and each alone.

use super::maps::map;
use super::{Shown, scatter};
use crate::Failure;
use crate::report::chart::round_step;
use crate::report::html::escape;
use ::calibration::{Geometry, PointResidual};
use std::fmt::Write;

/// Most views that are shown by themselves, the worst first: the page stays light.
const MOST: usize = 24;

pub(super) fn residuals(geometry: &Geometry, shown: &[Shown<'_>]) -> Result<String, Failure> {
    let together = together(shown)?;
    let noise = Shown::each(shown, |s| Ok(scatter::cloud(s) + &scatter::histogram(s)))?;
    let mut order: Vec<usize> = (0..geometry.views.len()).collect();
    let rms = |i: &usize| geometry.views[*i].camera_rms_px;
    order.sort_by(|a, b| rms(b).total_cmp(&rms(a)));
    let mut alone = String::new();
    let camera = shown.first();
    for &view in order.iter().take(MOST) {
        let Some(camera) = camera else { break };
        let fit = &geometry.views[view];
        let arrows = arrows(camera, magnified(camera), 2.0, |r| r.view == view);
        let label = format!("residuals of view {}", view + 1);
        let _ = write!(
            alone,
            "<figure>{}<figcaption><b>{}</b> {} {:.3} px</figcaption></figure>",
            map(camera.size(), &label, &arrows),
            view + 1,
            escape(&fit.name),
            fit.camera_rms_px
        );
    }
    let which = if order.len() > MOST {
        format!("The {MOST} views that fit worst",)
    } else {
        "Each view, the worst first,".to_owned()
    };
    Ok(format!(
        "<p>Seen minus explained. Arrows that point every way are noise; arrows that agree with their \
         neighbours are a model that is too simple, a bent board or a board that moved. Red: left out.\
         </p>{together}<h3>{which} by itself, magnified alike</h3><div class=\"views\">{alone}</div>\
         <h3>Is it noise?</h3><p>Noise is a round cloud without a hole or a tail, and its histogram \
         follows the normal law (the line) of the same spread.</p>{noise}"
    ))
}

/// All views of each device in one picture.
pub(super) fn together(shown: &[Shown<'_>]) -> Result<String, Failure> {
    Shown::each(shown, |s| {
        let times = magnified(s);
        let arrows = arrows(s, times, 1.0, |_| true);
        let label = format!("residuals of the {}", s.name);
        Ok(format!(
            "<figure><figcaption><b>{}</b>: {:.3} px RMS, drawn {times} times as long</figcaption>{}</figure>",
            s.name,
            s.device.rms_px,
            map(s.size(), &label, &arrows)
        ))
    })
}

/// How many times the arrows are magnified: a usual one is a fiftieth of the picture long.
fn magnified(shown: &Shown<'_>) -> f64 {
    let rms = shown.device.rms_px.max(1e-9);
    round_step(shown.size()[0] / (50.0 * rms))
}

/// Arrows of the points that `of` picks, `times` as long; `bold` times as thick as usual.
fn arrows(shown: &Shown<'_>, times: f64, bold: f64, of: impl Fn(&PointResidual) -> bool) -> String {
    let w = shown.size()[0];
    let (mut used, mut out, mut dots) = (String::new(), String::new(), String::new());
    for r in shown.points.iter().filter(|r| of(r)) {
        let ([x, y], [dx, dy]) = (r.pixel, r.residual_px);
        // Outliers can be anywhere: their arrows end at a tenth of the picture.
        let shorter = (0.1 * w / (times * dx.hypot(dy)).max(1e-9)).min(1.0);
        let (dx, dy) = (times * shorter * dx, times * shorter * dy);
        let (line, tail) =
            if r.used { (&mut used, &mut dots) } else { (&mut out, &mut String::new()) };
        let _ = write!(line, "M{x:.1} {y:.1}l{dx:.1} {dy:.1}");
        let _ = write!(tail, "M{x:.1} {y:.1}h0");
    }
    format!(
        "<path class=\"left\" stroke-width=\"{:.2}\" d=\"{used}\"/>\
         <path class=\"left dots\" stroke-width=\"{:.2}\" d=\"{dots}\"/>\
         <path class=\"out\" stroke-width=\"{:.2}\" d=\"{out}\"/>",
        bold * w / 450.0,
        bold * w / 160.0,
        bold * w / 250.0
    )
}
