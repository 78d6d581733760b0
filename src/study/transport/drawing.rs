//! The slabs of the study as a drawing: error in scale and root mean square over thickness.

use super::cases::{ALBEDOS, INDICES, THICKNESSES};
use super::{GOAL, Row, Series};
use crate::plot::{Axis, INKS, Legend, Line, Plot, Sheet};

type Points = Vec<(f64, f64)>;

/// Dashes, one a refractive index.
const DASHES: [&str; 3] = ["solid", "long", "short"];

/// Two panels over thickness, a line for each albedo and refractive index.
pub(crate) fn draw(rows: &[Row]) -> String {
    let slabs: Vec<&Row> = rows.iter().filter(|r| r.case.series == Series::Slab).collect();
    let (scale, rms) = GOAL;
    let mut sheet = Sheet::default();
    panel(&mut sheet, "Error in scale, %", &slabs, &[-scale, scale], |r| r.scale_error);
    panel(&mut sheet, "Relative RMS, nothing fitted, %", &slabs, &[rms], |r| r.relative_rms);
    sheet.finish()
}

fn panel(sheet: &mut Sheet, title: &str, rows: &[&Row], goals: &[f64], figure: fn(&Row) -> f64) {
    let values = || rows.iter().map(|r| figure(r)).chain(goals.iter().copied()).chain([0.0]);
    let ends = [
        (100.0 * values().fold(0.0, f64::min)).floor(),
        (100.0 * values().fold(0.0, f64::max)).ceil(),
    ];
    // Name and class, points.
    let mut lines: Vec<([String; 2], Points)> = Vec::new();
    for (albedo, ink) in ALBEDOS.into_iter().zip(INKS) {
        for (eta, dashes) in INDICES.into_iter().zip(DASHES) {
            let own = rows.iter().filter(|r| r.case.albedo == albedo && r.case.eta == eta);
            let points = own.map(|r| (r.case.thickness, 100.0 * figure(r))).collect();
            lines
                .push(([format!("albedo {albedo}, η = {eta}"), format!("{ink} {dashes}")], points));
        }
    }
    for (goal, name) in goals.iter().zip(["figure to reach", ""]) {
        let points = THICKNESSES.map(|t| (t, 100.0 * goal)).to_vec();
        lines.push(([name.into(), "plain".into()], points));
    }
    let lines = lines.iter().map(|([name, class], points)| Line {
        name,
        class,
        points: points.clone(),
        dots: false,
    });
    sheet.plot(&Plot {
        size: [760.0, 360.0],
        margins: [70.0, 210.0, 36.0, 52.0],
        title,
        x: Axis::log(
            "thickness, mean free paths",
            THICKNESSES.map(|t| (t, t.to_string())).to_vec(),
        ),
        y: Axis::linear("", ends),
        lines: lines.collect(),
        legend: Legend::Beside,
    });
}
