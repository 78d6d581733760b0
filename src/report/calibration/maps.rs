//! The corners of all views in the pictures that they were seen in.

use super::Shown;
use crate::Failure;
use crate::report::colour::distinct;
use ::calibration::Assessment;
use std::fmt::Write;

/// An SVG over a picture of `size` pixels, in its own pixels with a rim of half a pixel.
pub(super) fn map(size: [f64; 2], label: &str, body: &str) -> String {
    let [w, h] = size;
    let rim = w / 250.0;
    format!(
        "<svg class=\"map\" viewBox=\"{:.2} {:.2} {:.2} {:.2}\" role=\"img\" aria-label=\"{label}\">{body}\
         <rect class=\"frame\" x=\"-0.5\" y=\"-0.5\" width=\"{w}\" height=\"{h}\" stroke-width=\"{:.2}\"/></svg>",
        -0.5 - rim,
        -0.5 - rim,
        w + 2.0 * rim,
        h + 2.0 * rim,
        w / 400.0
    )
}

/// Camera and projector.
pub(super) fn coverage(shown: &[Shown<'_>], assessment: &Assessment) -> Result<String, Failure> {
    let figures = Shown::each(shown, |s| Ok(one(s)))?;
    let stance = assessment.stance;
    let [flat, steep] = stance.tilt_rad.map(f64::to_degrees);
    let [near, far] = stance.distance_mm;
    Ok(format!(
        "<p>Every corner that was used, a colour and a number a view; rings are points that were \
         left out. Tinted cells hold none: what the lens does there is a guess.</p>{figures}\
         <p>Boards stood {near:.0} to {far:.0} mm away, tilted by {flat:.0}° to {steep:.0}° to the \
         optical axis and by up to {:.0}° against each other. Good sets fill the picture and tilt \
         by 20–40° in all directions.</p>",
        stance.between_rad.to_degrees()
    ))
}

fn one(shown: &Shown<'_>) -> String {
    let size @ [w, h] = shown.size();
    let coverage = &shown.assessed.coverage;
    let [columns, rows] = coverage.cells;
    let cell = [w / columns as f64, h / rows as f64];
    let mut body = String::new();
    for (i, count) in coverage.points.iter().enumerate() {
        let class = if *count == 0 { "gap" } else { "cells" };
        let _ = write!(
            body,
            "<rect class=\"{class}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" \
             stroke-width=\"{:.2}\"/>",
            cell[0] * (i % columns) as f64 - 0.5,
            cell[1] * (i / columns) as f64 - 0.5,
            cell[0],
            cell[1],
            w / 800.0
        );
    }
    let views = shown.points.iter().map(|r| r.view + 1).max().unwrap_or(0);
    let middle = middle(shown.points.iter().filter(|r| r.used).map(|r| r.pixel));
    let (mut rings, mut numbers) = (String::new(), String::new());
    for view in 0..views {
        let mut dots = String::new();
        // Numbers stand at the outermost point: in the middle, where boards lie on each other,
        // none could be read.
        let mut outermost: Option<(f64, [f64; 2])> = None;
        for r in shown.points.iter().filter(|r| r.view == view) {
            let [x, y] = r.pixel;
            if !r.used {
                let radius = w / 110.0;
                let _ = write!(rings, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\"/>");
                continue;
            }
            let _ = write!(dots, "M{x:.1} {y:.1}h0");
            let far = (x - middle[0]).hypot(y - middle[1]);
            if outermost.is_none_or(|(best, _)| far > best) {
                outermost = Some((far, r.pixel));
            }
        }
        let Some((_, [x, y])) = outermost else { continue };
        let _ = write!(
            body,
            "<path class=\"dots\" stroke=\"{}\" stroke-width=\"{:.2}\" d=\"{dots}\"/>",
            distinct(view),
            w / 130.0
        );
        let _ = write!(
            numbers,
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"{}\">{}</text>",
            x.clamp(0.02 * w, 0.98 * w),
            (y + w / 90.0).clamp(0.04 * h, 0.99 * h),
            distinct(view),
            view + 1
        );
    }
    let _ = write!(
        body,
        "<g class=\"out\" stroke-width=\"{:.2}\">{rings}</g><g class=\"numbers\" font-size=\"{:.1}\" stroke-width=\"{:.1}\">{numbers}</g>",
        w / 300.0,
        w / 30.0,
        w / 130.0
    );
    let label = format!("corners in the {}'s picture", shown.name);
    format!(
        "<figure><figcaption><b>{}</b>: {:.0} % of the cells hold points</figcaption>{}</figure>",
        shown.name,
        100.0 * coverage.share,
        map(size, &label, &body)
    )
}

fn middle(points: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    let mut sum = [0.0; 2];
    let mut count = 0.0_f64;
    for [x, y] in points {
        sum = [sum[0] + x, sum[1] + y];
        count += 1.0;
    }
    sum.map(|s| s / count.max(1.0))
}
