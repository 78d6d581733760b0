//! What the page says in numbers.

use super::Shown;
use crate::report::colour::distinct;
use crate::report::html::escape;
use ::calibration::{Assessment, Device, Geometry, HalfDifference, INTRINSIC_NAMES, Sight};
use std::fmt::Write;

/// Most outliers that are named.
const MOST: usize = 60;

/// The intrinsics with their sigmas; the projector's beside the camera's.
pub(super) fn parameters(geometry: &Geometry) -> String {
    let projector = geometry.projector.as_ref();
    let devices: Vec<&Device> =
        [Some(&geometry.camera), projector.map(|p| &p.device)].into_iter().flatten().collect();
    let mut rows = String::new();
    for (k, name) in INTRINSIC_NAMES.iter().enumerate() {
        let fitted = |d: &&Device| d.standard_deviations[k] > 0.0 || d.model.parameters()[k] != 0.0;
        if !devices.iter().any(fitted) {
            continue;
        }
        let cells: String = devices
            .iter()
            .map(|d| {
                let told = if fitted(d) {
                    plus_minus(d.model.parameters()[k], d.standard_deviations[k])
                } else {
                    "–".into()
                };
                format!("<td class=\"number\">{told}</td>")
            })
            .collect();
        let _ =
            write!(rows, "<tr><th>{name}</th>{cells}<td class=\"soft\">{}</td></tr>", MEANING[k]);
    }
    let heads = if projector.is_some() { "<th class=\"number\">projector</th>" } else { "" };
    let mut out = format!(
        "<div class=\"wide\"><table><thead><tr><th></th><th class=\"number\">camera</th>{heads}<th></th></tr></thead>\
         {rows}</table></div><p class=\"note\">± is one standard deviation; the truth lies within it in two of \
         three calibrations.</p>"
    );
    if let Some(p) = projector {
        let shift: Vec<String> = (0..3)
            .map(|a| plus_minus(p.pose.translation_mm[a], p.pose_standard_deviations[3 + a]))
            .collect();
        let turn = p.pose.rotation_vector();
        let turn: Vec<String> = (0..3)
            .map(|a| {
                let sigma = p.pose_standard_deviations[a].to_degrees();
                plus_minus(turn[a].to_degrees(), sigma)
            })
            .collect();
        let _ = write!(
            out,
            "<p>From camera to projector: baseline {} mm; shift {} mm; turn {} degrees about x, y, z.</p>",
            plus_minus(p.baseline_mm, p.baseline_standard_deviation_mm),
            shift.join(", "),
            turn.join(", ")
        );
    }
    if let Some([x, y]) = geometry.warp_mm {
        let sigma = |name| geometry.covariance.of(name, name).max(0.0).sqrt();
        let _ = write!(
            out,
            "<p>The board's middle stands {} mm out of its plane by bending along x and {} mm by bending along y.</p>",
            plus_minus(x, sigma("warp.x")),
            plus_minus(y, sigma("warp.y"))
        );
    }
    out
}

const MEANING: [&str; INTRINSIC_NAMES.len()] = [
    "focal length along x, pixels",
    "focal length along y, pixels",
    "principal point x, pixels",
    "principal point y, pixels",
    "skew of the axes",
    "radial distortion",
    "radial distortion",
    "tangential distortion",
    "tangential distortion",
    "radial distortion",
    "denominator of the radial distortion",
    "denominator of the radial distortion",
    "denominator of the radial distortion",
];

/// A value with as many digits as its sigma warrants: two of the sigma.
fn plus_minus(value: f64, sigma: f64) -> String {
    if !(sigma > 0.0 && sigma.is_finite()) {
        return format!("{value:.4}");
    }
    let decimals = (1.0 - sigma.log10().floor()).clamp(0.0, 8.0) as usize;
    format!("{value:.decimals$} ± {sigma:.decimals$}").replace('-', "−")
}

/// Every view, the worst first.
pub(super) fn views(geometry: &Geometry, assessment: &Assessment) -> String {
    let lit = geometry.projector.is_some();
    let mut order: Vec<usize> = (0..geometry.views.len()).collect();
    let rms = |i: &usize| geometry.views[*i].camera_rms_px;
    order.sort_by(|a, b| rms(b).total_cmp(&rms(a)));
    let worst = order.first().map_or(1.0, rms).max(1e-12);
    let mut rows = String::new();
    for i in order {
        let view = &geometry.views[i];
        let lost = geometry.outliers.iter().filter(|o| o.view == view.name).count();
        let (tilt, distance) = assessment
            .boards
            .get(i)
            .map_or((f64::NAN, f64::NAN), |b| (b.tilt_rad.to_degrees(), b.distance_mm));
        let projector = if lit {
            let told = view.projector_rms_px.map_or("–".into(), |r| format!("{r:.3}"));
            format!("<td class=\"number\">{told}</td>")
        } else {
            String::new()
        };
        let _ = write!(
            rows,
            "<tr><td><span class=\"swatch\" style=\"background:{}\"></span>{}</td><td>{}</td>\
             <td class=\"number\">{:.3}</td><td><span class=\"fit\" style=\"width:{:.0}px\"></span></td>{projector}\
             <td class=\"number\">{tilt:.0}°</td><td class=\"number\">{distance:.0} mm</td><td class=\"number\">{lost}</td></tr>",
            distinct(i),
            i + 1,
            escape(&view.name),
            view.camera_rms_px,
            80.0 * view.camera_rms_px / worst
        );
    }
    let heads = if lit { "<th class=\"number\">projector, px</th>" } else { "" };
    format!(
        "<div class=\"wide\"><table><thead><tr><th></th><th>view</th><th class=\"number\">camera, px RMS</th><th></th>{heads}\
         <th class=\"number\">tilt</th><th class=\"number\">distance</th><th class=\"number\">left out</th></tr></thead>{rows}</table></div>"
    )
}

/// Odd against even views.
pub(super) fn halves(assessment: &Assessment) -> String {
    let Some(halves) = assessment.halves else {
        let reason = assessment.without_halves.as_deref().unwrap_or_default();
        return format!(
            "<p>Odd and even views do not make two calibrations to compare: {}.</p>",
            escape(reason)
        );
    };
    let row = |name: &str, d: HalfDifference| {
        format!(
            "<tr><th>{name}</th><td class=\"number\">{:.3}</td><td class=\"number\">{:.3}</td><td class=\"number\">{:.3}</td></tr>",
            d.rms_px, d.max_px, d.predicted_px
        )
    };
    let rows = row("camera", halves.camera)
        + &halves.projector.map_or(String::new(), |d| row("projector", d));
    format!(
        "<p>The odd and the even views calibrated apart, and how far the two put the same ray over the picture, the \
         best turn taken off. A difference far beyond the predicted one means that something changed \
         between the pictures or that the model is too simple. The calibration from all views is about \
         half as far from the truth.</p><div class=\"wide\"><table><thead><tr><th></th><th class=\"number\">RMS, px</th>\
         <th class=\"number\">largest, px</th><th class=\"number\">predicted RMS, px</th></tr></thead>{rows}</table></div>"
    )
}

/// How the distortion was chosen.
pub(super) fn selection(shown: &[Shown<'_>]) -> String {
    let mut out = String::new();
    for s in shown {
        let selection = &s.device.selection;
        let taken = selection.distortion;
        if selection.trials.is_empty() {
            let _ = write!(out, "<p>{}: {}, as asked for.</p>", s.name, taken.name());
            continue;
        }
        let mut rows = String::new();
        for trial in &selection.trials {
            let class = if trial.distortion == taken { " class=\"taken\"" } else { "" };
            let held = trial.held_out_px.map_or("–".into(), |v| {
                // Models that fall apart without a few views: how far is no matter.
                if v < 100.0 { format!("{v:.4}") } else { "&gt; 100".into() }
            });
            let told = match &trial.refused {
                Some(reason) => escape(reason),
                None if trial.distortion == taken => "taken".into(),
                None => String::new(),
            };
            let _ = write!(
                rows,
                "<tr{class}><td>{}</td><td class=\"number\">{held}</td><td>{told}</td></tr>",
                trial.distortion.name()
            );
        }
        let _ = write!(
            out,
            "<h3>{}</h3><div class=\"wide\"><table><thead><tr><th>distortion</th><th class=\"number\">held-out RMS, px</th><th></th></tr></thead>{rows}</table></div>",
            s.name
        );
    }
    out + "<p class=\"note\">Each model is fitted without some of the views, in turn, and asked to explain them. The simplest \
           whose squared error exceeds the least by no more than two standard errors of the difference is taken.</p>"
}

/// Points that do not go with the others, and pictures without a board.
pub(super) fn left_out(geometry: &Geometry, assessment: &Assessment) -> String {
    let mut out = String::new();
    if !assessment.missed.is_empty() {
        let items: String =
            assessment.missed.iter().map(|m| format!("<li>{}</li>", escape(m))).collect();
        let _ = write!(out, "<h3>Pictures without a board</h3><ul>{items}</ul>");
    }
    if geometry.outliers.is_empty() {
        return out;
    }
    let mut outliers: Vec<_> = geometry.outliers.iter().collect();
    let length = |d: [f64; 2]| d[0].hypot(d[1]);
    outliers.sort_by(|a, b| length(b.residual_px).total_cmp(&length(a.residual_px)));
    let mut rows = String::new();
    for o in outliers.iter().take(MOST) {
        let kind = match o.sight {
            Sight::Printed => "printed corner",
            Sight::Coded => "projector pixel of a corner",
            Sight::Projected => "projected point",
        };
        let [x, y] = o.residual_px;
        let _ = write!(
            rows,
            "<tr><td>{}</td><td>{kind}</td><td class=\"number\">{}</td><td class=\"number\">{x:+.2}, {y:+.2}</td><td class=\"number\">{:.2}</td></tr>",
            escape(&o.view),
            o.point + 1,
            length(o.residual_px)
        );
    }
    let more = outliers.len().saturating_sub(MOST);
    let more =
        if more > 0 { format!("<p class=\"note\">and {more} more</p>") } else { String::new() };
    out + &format!(
        "<h3>Points that do not go with the others</h3><div class=\"wide\"><table><thead><tr><th>view</th><th>what</th>\
         <th class=\"number\">number</th><th class=\"number\">off by x, y, px</th><th class=\"number\">px</th></tr></thead>{rows}</table></div>{more}"
    )
}
