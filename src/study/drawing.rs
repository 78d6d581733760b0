//! A study of plans as a drawing: noise at equal time, and time, over the light there is.

use super::plans::{PlanKind, Row};
use std::fmt::Write as _;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 340.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 190.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 52.0;

/// For bounds.
const DASHED: &str = "stroke-dasharray=\"4 4\"";

/// A line: its name, colour, dashes as an attribute, and its points: electrons, and a figure over the plain plan's.
struct Line {
    name: &'static str,
    colour: &'static str,
    dashes: &'static str,
    points: Vec<(f64, f64)>,
}

/// Two panels over the electrons of the brightest place, one group of rows for each light, the
/// plain plan first in each.
pub(crate) fn draw(groups: &[&[Row]]) -> String {
    let line = |name, colour, dashes, plan: PlanKind, figure: &dyn Fn(&Row, &Row) -> f64| {
        let point = |group: &&[Row]| {
            let (plain, row) = (group.first()?, group.iter().find(|r| r.plan == plan)?);
            Some((row.peak_electrons, figure(row, plain)))
        };
        Line { name, colour, dashes, points: groups.iter().filter_map(point).collect() }
    };
    let noise = |class: usize| {
        move |row: &Row, plain: &Row| {
            row.noise.pixel[class] / plain.noise.pixel[class] * (row.seconds / plain.seconds).sqrt()
        }
    };
    let time = |row: &Row, plain: &Row| row.seconds / plain.seconds;
    let upper = [
        line("bright places", "#c0392b", "", PlanKind::Multiplexed, &noise(0)),
        line("middling places", "#1e8449", "", PlanKind::Multiplexed, &noise(1)),
        line("dark places", "#2471a3", "", PlanKind::Multiplexed, &noise(2)),
        line("half", "#888888", DASHED, PlanKind::Plain, &|_, _| 0.5),
        line("plain", "#888888", "", PlanKind::Plain, &|_, _| 1.0),
    ];
    let lower = [
        line("adaptive", "#c0392b", "", PlanKind::Adaptive, &time),
        line("adaptive, noise alone", "#2471a3", "", PlanKind::AdaptiveStrict, &time),
        line("multiplexed, adaptive", "#1e8449", "", PlanKind::MultiplexedAdaptive, &time),
        line("a third", "#888888", DASHED, PlanKind::Plain, &|_, _| 1.0 / 3.0),
        line("plain", "#888888", "", PlanKind::Plain, &|_, _| 1.0),
    ];
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {}\" font-family=\"sans-serif\" font-size=\"12\">\
         <rect width=\"{WIDTH}\" height=\"{}\" fill=\"#fff\"/>",
        2.0 * HEIGHT,
        2.0 * HEIGHT
    );
    panel(&mut svg, 0.0, "Multiplexed: noise over the plain plan's, at equal time", &upper);
    panel(&mut svg, HEIGHT, "Capture time over the plain plan's", &lower);
    svg + "</svg>\n"
}

fn panel(svg: &mut String, top: f64, title: &str, lines: &[Line]) {
    let drawn = |p: &&(f64, f64)| [p.0, p.1].iter().all(|v| v.is_finite() && *v > 0.0);
    let all = || lines.iter().flat_map(|l| l.points.iter().filter(drawn));
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let values = || all().map(pick);
        Some((values().reduce(f64::min)?, values().reduce(f64::max)?))
    };
    let (Some((x_low, x_high)), Some((y_low, y_high))) = (range(|p| p.0), range(|p| p.1)) else {
        return;
    };
    let (x_low, x_high) = (x_low.log10().floor(), x_high.log10().ceil());
    // Axes in octaves upwards, in decades to the right.
    let (y_low, y_high) = (y_low.log2().floor(), y_high.log2().ceil());
    let (x_span, y_span) = ((x_high - x_low).max(1.0), (y_high - y_low).max(1.0));
    let x = |v: f64| LEFT + (WIDTH - LEFT - RIGHT) * (v.log10() - x_low) / x_span;
    let y = |v: f64| top + TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - (v.log2() - y_low) / y_span);
    let _ = write!(svg, "<text x=\"{LEFT}\" y=\"{}\" font-size=\"14\">{title}</text>", top + 20.0);
    for octave in 0..=y_span as i32 {
        let value = (y_low + f64::from(octave)).exp2();
        let at = y(value);
        let _ = write!(
            svg,
            "<path d=\"M{LEFT} {at:.1}H{}\" stroke=\"#eee\"/><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{value}</text>",
            WIDTH - RIGHT,
            LEFT - 8.0,
            at + 4.0
        );
    }
    let bottom = top + HEIGHT - BOTTOM;
    for decade in 0..=x_span as i32 {
        let power = x_low as i32 + decade;
        let _ = write!(
            svg,
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">1e{power}</text>",
            x(10f64.powi(power)),
            bottom + 18.0
        );
    }
    let _ = write!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">electrons of the brightest place in the longest exposure, were there room for them</text>",
        (LEFT + WIDTH - RIGHT) / 2.0,
        bottom + 38.0
    );
    for (n, line) in lines.iter().enumerate() {
        let points: Vec<String> = line
            .points
            .iter()
            .filter(drawn)
            .map(|(e, v)| format!("{:.1},{:.1}", x(*e), y(*v)))
            .collect();
        let (at, right) = (top + TOP + 16.0 + 20.0 * n as f64, WIDTH - RIGHT + 14.0);
        let _ = write!(
            svg,
            "<g stroke=\"{0}\" {1} fill=\"none\" stroke-width=\"1.5\"><polyline points=\"{2}\"/>\
             <path d=\"M{right} {3}h24\"/></g><text x=\"{4}\" y=\"{at}\">{5}</text>",
            line.colour,
            line.dashes,
            points.join(" "),
            at - 4.0,
            right + 30.0,
            line.name
        );
    }
}
