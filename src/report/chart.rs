//! Line charts as inline SVG.

pub(crate) use crate::plot::round_step;
use crate::plot::{self, Axis, Legend, Plot};

/// One line of a chart.
pub(crate) struct Line<'a> {
    pub name: &'a str,
    /// CSS class: colour and dashes.
    pub class: &'static str,
    /// Positive values at 1, 2, 3, …
    pub values: &'a [f64],
}

const SIZE: [f64; 2] = [720.0, 300.0];
/// Left, right, above and below.
const MARGINS: [f64; 4] = [64.0, 16.0, 14.0, 44.0];

/// Lines over their index with a logarithmic axis upwards. Nothing where no value can be drawn.
pub(crate) fn logarithmic(lines: &[Line<'_>], x_label: &str, y_label: &str) -> Option<String> {
    let y = Axis::decades("", lines.iter().flat_map(|l| l.values).copied())?;
    let last = lines.iter().map(|l| l.values.len()).max().unwrap_or(1).max(2);
    let between = round_step(last as f64 / 6.0).max(1.0) as usize;
    let ticks = (between..=last).step_by(between).map(|n| (n as f64, n.to_string())).collect();
    let lines = lines.iter().map(|line| plot::Line {
        name: line.name,
        class: line.class,
        points: line.values.iter().enumerate().map(|(i, v)| ((i + 1) as f64, *v)).collect(),
        dots: false,
    });
    let plot = Plot {
        size: SIZE,
        margins: MARGINS,
        title: "",
        x: Axis::with_ticks(x_label, [1.0, last as f64], ticks),
        y,
        lines: lines.collect(),
        legend: Legend::Inside,
    };
    Some(plot.svg(&format!("{y_label} over {x_label}"), ""))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_draws_what_can_be_drawn() {
        let values = [1.0, f64::NAN, 0.1, 0.0];
        let line = Line { name: "a<b", class: "r", values: &values };
        let svg = logarithmic(&[line], "step", "fit").unwrap();
        assert!(svg.contains("a&lt;b") && !svg.contains("NaN") && !svg.contains("inf"));
        assert!(logarithmic(&[Line { name: "a", class: "r", values: &[] }], "x", "y").is_none());
    }
}
