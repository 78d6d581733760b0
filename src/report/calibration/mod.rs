//! A calibration on one page: the verdict first, then what it rests on. One HTML file that needs
//! nothing else.

mod contour;
mod field;
mod maps;
mod residuals;
mod scatter;
mod summary;
mod tables;
#[cfg(test)]
mod tests;

use crate::Failure;
use crate::output::counted;
use crate::report::html::{self, capital, escape, section};
use ::calibration::{Assessment, Device, DeviceAssessment, Geometry, PointResidual, Sight};

pub(crate) use summary::summary;

/// What the pictures of a calibration need beside the style that all pages share.
pub(crate) const STYLE: &str = include_str!("style.css");

/// One device with everything that the page shows of it.
struct Shown<'a> {
    /// "camera" or "projector".
    name: &'static str,
    device: &'a Device,
    assessed: &'a DeviceAssessment,
    /// The points of every view in its picture, outliers included.
    points: Vec<&'a PointResidual>,
}

impl<'a> Shown<'a> {
    /// The camera, and the projector where there is one.
    fn of(
        geometry: &'a Geometry,
        assessment: &'a Assessment,
        residuals: &'a [PointResidual],
    ) -> Vec<Self> {
        let points = |lit: bool| {
            let finite = |r: &&PointResidual| {
                r.pixel.iter().chain(&r.residual_px).all(|v| v.is_finite())
                    && (r.sight != Sight::Printed) == lit
            };
            residuals.iter().filter(finite).collect()
        };
        let mut shown = vec![Self {
            name: "camera",
            device: &geometry.camera,
            assessed: &assessment.camera,
            points: points(false),
        }];
        if let (Some(projector), Some(assessed)) = (&geometry.projector, &assessment.projector) {
            let (name, device) = ("projector", &projector.device);
            shown.push(Self { name, device, assessed, points: points(true) });
        }
        shown
    }

    fn size(&self) -> [f64; 2] {
        [self.device.model.width as f64, self.device.model.height as f64]
    }

    /// Two things side by side, where there are a camera and a projector.
    fn each(
        all: &[Self],
        figure: impl Fn(&Self) -> Result<String, Failure>,
    ) -> Result<String, Failure> {
        let figures = all.iter().map(figure).collect::<Result<String, _>>()?;
        Ok(format!("<div class=\"pair\">{figures}</div>"))
    }
}

/// The page about a calibration and its assessment.
///
/// # Errors
/// A picture that cannot be encoded.
pub(crate) fn calibration_page(
    title: &str,
    geometry: &Geometry,
    assessment: &Assessment,
) -> Result<String, Failure> {
    let residuals = geometry.residuals();
    let shown = Shown::of(geometry, assessment, &residuals);
    let mut body = head(title, geometry, &shown);
    body += &judged(assessment);
    body += &section("What was found", &tables::parameters(geometry));
    body += &section("Where the boards were", &maps::coverage(&shown, assessment)?);
    body += &section("How well each pixel is known", &field::pictures(&shown)?);
    body += &section("What is left over", &residuals::residuals(geometry, &shown)?);
    body += &section("View by view", &tables::views(geometry, assessment));
    body += &section("Half against half", &tables::halves(assessment));
    body += &section("Which distortion", &tables::selection(&shown));
    if !(geometry.outliers.is_empty() && assessment.missed.is_empty()) {
        body += &section("What was left out", &tables::left_out(geometry, assessment));
    }
    Ok(html::page(title, STYLE, &body))
}

fn head(title: &str, geometry: &Geometry, shown: &[Shown<'_>]) -> String {
    let devices: Vec<String> = shown
        .iter()
        .map(|s| {
            let points = s.points.len();
            format!("{} {} × {}, {points} points", s.name, s.size()[0], s.size()[1])
        })
        .collect();
    format!(
        "<header><h1>{}</h1><p class=\"soft\">{}; {}.</p></header>\n",
        escape(title),
        counted(geometry.views.len(), "view"),
        devices.join("; ")
    )
}

fn judged(assessment: &Assessment) -> String {
    let verdict = &assessment.verdict;
    let advice: String =
        verdict.advice.iter().map(|a| format!("<li>{}</li>", escape(capital(a)))).collect();
    let advice = if advice.is_empty() {
        "<p>There is nothing to do.</p>".to_owned()
    } else {
        format!("<h3>What to do next</h3><ol class=\"advice\">{advice}</ol>")
    };
    let reasons: String = verdict
        .reasons
        .iter()
        .map(|r| {
            let text = escape(capital(&r.text));
            format!("<li class=\"{0}\"><b>{0}</b><span>{text}</span></li>", r.grade.word())
        })
        .collect();
    format!(
        "<div class=\"verdict {0}\"><strong>{0}</strong><p>{1}</p>{advice}<h3>Why</h3>\
         <ul class=\"reasons\">{reasons}</ul></div>\n",
        verdict.grade.word(),
        verdict.sentence(),
    )
}
