//! The uncertainty of each pixel's direction, as a picture.

use super::Shown;
use super::contour::{contour, levels};
use super::maps::map;
use crate::Failure;
use crate::report::bar::bar;
use crate::report::picture;
use std::fmt::Write;

/// Pixels of the picture between two points of the field.
const FINE: usize = 6;

pub(super) fn pictures(shown: &[Shown<'_>]) -> Result<String, Failure> {
    Ok(format!(
        "<p>1-sigma of where the device sees a ray, in its own pixels, along the worst direction. \
         What a small turn of the whole device explains is no error and is taken off, since its \
         pose is found anew for each sample.</p>{}",
        Shown::each(shown, one)?
    ))
}

fn one(shown: &Shown<'_>) -> Result<String, Failure> {
    let size @ [w, h] = shown.size();
    let sigma = &shown.assessed.uncertainty;
    let points @ [columns, rows] = sigma.points;
    let values = &sigma.sigma_px;
    let [low, high] = range(values);
    let shade = |v: f64| (v.max(low) / low).ln() / (high / low).ln();
    // The places of the field's points: the first and the last pixel of rows and columns.
    let step = [(w - 1.0) / (columns.max(2) - 1) as f64, (h - 1.0) / (rows.max(2) - 1) as f64];
    let fine = [FINE * (columns - 1), FINE * (rows - 1)];
    let shares: Vec<f64> = (0..fine[0] * fine[1])
        .map(|i| {
            let place = |n: usize| (n as f64 + 0.5) / FINE as f64;
            shade(bilinear(points, values, [place(i % fine[0]), place(i / fine[0])]))
        })
        .collect();
    let uri = picture::shares(fine, &shares)?;
    let mut body = format!(
        "<image href=\"{uri}\" x=\"-0.5\" y=\"-0.5\" width=\"{w}\" height=\"{h}\" \
         preserveAspectRatio=\"none\"/>"
    );
    let (mut lines, mut numbers) = (String::new(), String::new());
    // Numbers stand where the lines cross the way from the middle to the worst place.
    let middle = [w / 2.0, h / 2.0];
    let way = [0, 1].map(|a| sigma.worst_at[a] - middle[a]);
    for level in levels(low, high) {
        let mut nearest: Option<(f64, [f64; 2])> = None;
        for piece in contour(points, values, level) {
            let [[ax, ay], [bx, by]] = piece.map(|p| [p[0] * step[0], p[1] * step[1]]);
            let _ = write!(lines, "M{ax:.1} {ay:.1}L{bx:.1} {by:.1}");
            let at = [(ax + bx) / 2.0, (ay + by) / 2.0];
            let off = [at[0] - middle[0], at[1] - middle[1]];
            let along = off[0] * way[0] + off[1] * way[1];
            let aside = (off[0] * way[1] - off[1] * way[0]).abs();
            // Between the rim and the middle, clear of the frame.
            let inside =
                at[0] > 0.04 * w && at[0] < 0.96 * w && at[1] > 0.04 * h && at[1] < 0.97 * h;
            if inside && along >= 0.0 && nearest.is_none_or(|(best, _)| aside < best) {
                nearest = Some((aside, at));
            }
        }
        if let Some((_, [x, y])) = nearest {
            let y = y + w / 90.0;
            let _ =
                write!(numbers, "<text class=\"on-map\" x=\"{x:.1}\" y=\"{y:.1}\">{level}</text>");
        }
    }
    for (class, width) in [("level under", w / 150.0), ("level", w / 350.0)] {
        let _ = write!(body, "<path class=\"{class}\" stroke-width=\"{width:.2}\" d=\"{lines}\"/>");
    }
    let _ = write!(
        body,
        "<g font-size=\"{:.1}\" stroke-width=\"{:.1}\">{numbers}</g>",
        w / 28.0,
        w / 160.0
    );
    let label = format!("uncertainty over the {}'s picture", shown.name);
    Ok(format!(
        "<figure><figcaption><b>{}</b>: {:.2} px on average, {:.2} px at worst, in the {}</figcaption>\
         {}{}</figure>",
        shown.name,
        sigma.rms_px,
        sigma.worst_px,
        sigma.worst_zone.name(),
        map(size, &label, &body),
        bar([low, high], "px")
    ))
}

/// Smallest and largest, of a positive width, since a logarithm wants one.
fn range(values: &[f64]) -> [f64; 2] {
    let high = values.iter().copied().fold(0.0, f64::max);
    let high = if high > 0.0 { high } else { 1.0 };
    let low = values.iter().copied().fold(high, f64::min).max(1e-3 * high);
    [low, high.max(1.01 * low)]
}

/// The function through values on a grid, at a place in grid coordinates.
fn bilinear([columns, rows]: [usize; 2], values: &[f64], [x, y]: [f64; 2]) -> f64 {
    let cell = |v: f64, n: usize| (v.max(0.0) as usize).min(n.saturating_sub(2));
    let (column, row) = (cell(x, columns), cell(y, rows));
    let (s, t) = (x - column as f64, y - row as f64);
    let at = |dx: usize, dy: usize| {
        values.get((row + dy) * columns + column + dx).copied().unwrap_or(0.0)
    };
    let upper = at(0, 0) + s * (at(1, 0) - at(0, 0));
    let lower = at(0, 1) + s * (at(1, 1) - at(0, 1));
    upper + t * (lower - upper)
}
