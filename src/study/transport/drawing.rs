//! The slabs of the study as a drawing: error in scale and root mean square over thickness.

use super::cases::{ALBEDOS, INDICES, THICKNESSES};
use super::{GOAL, Row, Series};
use std::fmt::Write as _;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 190.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 52.0;
/// One an albedo, one a refractive index.
const COLOURS: [&str; 4] = ["#c0392b", "#d68910", "#1e8449", "#2471a3"];
const DASHES: [&str; 3] = ["none", "7 4", "2 3"];

/// Two panels over thickness, a line for each albedo and refractive index.
pub(crate) fn draw(rows: &[Row]) -> String {
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {}\" font-family=\"sans-serif\" font-size=\"12\">\
         <rect width=\"{WIDTH}\" height=\"{}\" fill=\"#fff\"/>",
        2.0 * HEIGHT,
        2.0 * HEIGHT
    );
    let slabs: Vec<&Row> = rows.iter().filter(|r| r.case.series == Series::Slab).collect();
    let (scale, rms) = GOAL;
    panel(&mut svg, 0.0, "Error in scale, %", &slabs, &[-scale, scale], |r| r.scale_error);
    panel(&mut svg, HEIGHT, "Relative RMS, nothing fitted, %", &slabs, &[rms], |r| r.relative_rms);
    svg + "</svg>\n"
}

fn panel(
    svg: &mut String,
    top: f64,
    title: &str,
    rows: &[&Row],
    goals: &[f64],
    figure: fn(&Row) -> f64,
) {
    let values = || rows.iter().map(|r| figure(r)).chain(goals.iter().copied()).chain([0.0]);
    let low = (100.0 * values().fold(0.0, f64::min)).floor();
    let high = (100.0 * values().fold(0.0, f64::max)).ceil();
    let step = ((high - low) / 8.0).ceil().max(1.0);
    let (first, last) = (THICKNESSES[0].ln(), THICKNESSES[THICKNESSES.len() - 1].ln());
    let x = |t: f64| LEFT + (WIDTH - LEFT - RIGHT) * (t.ln() - first) / (last - first);
    let y = |v: f64| top + TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - (100.0 * v - low) / (high - low));
    let right = WIDTH - RIGHT;
    let _ = write!(svg, "<text x=\"{LEFT}\" y=\"{}\" font-size=\"14\">{title}</text>", top + 20.0);
    for line in 0..=((high - low) / step) as i32 {
        let value = low + step * f64::from(line);
        let at = y(value / 100.0);
        let _ = write!(
            svg,
            "<path d=\"M{LEFT} {at:.1}H{right}\" stroke=\"#eee\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{value}</text>",
            LEFT - 8.0,
            at + 4.0
        );
    }
    for goal in goals {
        let _ = write!(svg, "<path d=\"M{LEFT} {:.1}H{right}\" stroke=\"#888\"/>", y(*goal));
    }
    let bottom = top + HEIGHT - BOTTOM;
    for t in THICKNESSES {
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{t}</text>",
            x(t),
            bottom + 18.0
        );
    }
    let _ = write!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">thickness, mean free paths</text>",
        (LEFT + right) / 2.0,
        bottom + 38.0
    );
    for (albedo, colour) in ALBEDOS.into_iter().zip(COLOURS) {
        for (eta, dashes) in INDICES.into_iter().zip(DASHES) {
            let line = rows.iter().filter(|r| r.case.albedo == albedo && r.case.eta == eta);
            let points: Vec<String> =
                line.map(|r| format!("{:.1},{:.1}", x(r.case.thickness), y(figure(r)))).collect();
            let _ = write!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\" stroke-dasharray=\"{dashes}\"/>",
                points.join(" ")
            );
        }
    }
    let mut key = |n: usize, colour: &str, dashes: &str, name: String| {
        let (from, at) = (right + 14.0, top + TOP + 12.0 + 19.0 * n as f64);
        let _ = write!(
            svg,
            "<path d=\"M{from} {at}h24\" stroke=\"{colour}\" stroke-dasharray=\"{dashes}\" stroke-width=\"1.5\"/><text x=\"{}\" y=\"{}\">{name}</text>",
            from + 30.0,
            at + 4.0
        );
    };
    for (n, (albedo, colour)) in ALBEDOS.into_iter().zip(COLOURS).enumerate() {
        key(n, colour, "none", format!("albedo {albedo}"));
    }
    for (n, (eta, dashes)) in INDICES.into_iter().zip(DASHES).enumerate() {
        key(ALBEDOS.len() + n, "#000", dashes, format!("η = {eta}"));
    }
    key(ALBEDOS.len() + INDICES.len(), "#888", "none", "figure to reach".into());
}
