//! Line charts as inline SVG.

use crate::report::html::escape;

/// One line of a chart.
pub(crate) struct Line<'a> {
    pub name: &'a str,
    /// CSS class: colour and dashes.
    pub class: &'static str,
    /// Positive values at 1, 2, 3, …
    pub values: &'a [f64],
}

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 44.0;

/// Lines over their index with a logarithmic axis upwards. Nothing where no value can be drawn.
pub(crate) fn logarithmic(lines: &[Line<'_>], x_label: &str, y_label: &str) -> Option<String> {
    let drawn = |v: &&f64| v.is_finite() && **v > 0.0;
    let all = || lines.iter().flat_map(|l| l.values.iter().filter(drawn));
    let low = all().copied().reduce(f64::min)?.log10().floor();
    let high = all().copied().reduce(f64::max)?.log10().ceil().max(low + 1.0);
    let last = lines.iter().map(|l| l.values.len()).max().unwrap_or(1).max(2);
    let x = |i: usize| LEFT + (WIDTH - LEFT - RIGHT) * i as f64 / (last - 1) as f64;
    let y = |v: f64| TOP + (HEIGHT - TOP - BOTTOM) * (high - v.log10()) / (high - low);
    let mut out = format!(
        "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{} over {}\">",
        escape(y_label),
        escape(x_label)
    );
    let decades = (high - low) as i32;
    let step = (decades / 6).max(1);
    for k in (0..=decades).step_by(step as usize) {
        let (power, at) = (low as i32 + k, y(10f64.powi(low as i32 + k)));
        out += &format!(
            "<line class=\"rule\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
             <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">1e{power}</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            at + 4.5
        );
    }
    let between = round_step(last as f64 / 6.0).max(1.0) as usize;
    for count in (between..=last).step_by(between) {
        out += &format!(
            "<text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{count}</text>",
            x(count - 1),
            HEIGHT - BOTTOM + 18.0
        );
    }
    out += &format!(
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        (LEFT + WIDTH - RIGHT) / 2.0,
        HEIGHT - 6.0,
        escape(x_label)
    );
    for line in lines {
        let points: Vec<String> = line
            .values
            .iter()
            .enumerate()
            .filter(|(_, v)| drawn(v))
            .map(|(i, v)| format!("{:.1},{:.1}", x(i), y(*v)))
            .collect();
        out += &format!("<polyline class=\"{}\" points=\"{}\"/>", line.class, points.join(" "));
    }
    for (n, line) in lines.iter().enumerate() {
        let (right, at) = (WIDTH - RIGHT - 8.0, TOP + 20.0 + 20.0 * n as f64);
        out += &format!(
            "<line class=\"{}\" x1=\"{}\" x2=\"{}\" y1=\"{}\" y2=\"{}\"/>\
             <text x=\"{right}\" y=\"{at}\" text-anchor=\"end\">{}</text>",
            line.class,
            right - 64.0,
            right - 28.0,
            at - 4.5,
            at - 4.5,
            escape(line.name)
        );
    }
    Some(out + "</svg>")
}

/// The next of 1, 2, 5, 10, … from `value` on.
pub(crate) fn round_step(value: f64) -> f64 {
    if !(value.is_finite() && value > 0.0) {
        return 1.0;
    }
    let decade = 10f64.powf(value.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|s| s * decade);
    steps.into_iter().find(|s| *s >= value * (1.0 - 1e-9)).unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round() {
        for (value, step) in [(0.7, 1.0), (1.1, 2.0), (0.03, 0.05), (51.0, 100.0), (20.0, 20.0)] {
            assert!((round_step(value) - step).abs() < 1e-12 * step, "{value}");
        }
    }

    #[test]
    fn a_chart_draws_what_can_be_drawn() {
        let values = [1.0, f64::NAN, 0.1, 0.0];
        let line = Line { name: "a<b", class: "r", values: &values };
        let svg = logarithmic(&[line], "step", "fit").unwrap();
        assert!(svg.contains("a&lt;b") && !svg.contains("NaN") && !svg.contains("inf"));
        assert!(logarithmic(&[Line { name: "a", class: "r", values: &[] }], "x", "y").is_none());
    }
}
