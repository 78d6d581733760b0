//! Line plots as SVG: axes, lines, a legend. How things look is said by CSS classes, so that a page
//! with a style of its own and a drawing in a file (`sheet.rs`) share them.

mod axis;
mod sheet;

pub(crate) use axis::{Axis, round_step};
pub(crate) use sheet::{INKS, Sheet};

use crate::report::html::escape;
use std::fmt::Write as _;

/// Lines over one pair of axes.
pub(crate) struct Plot<'a> {
    /// Width and height.
    pub size: [f64; 2],
    /// Left, right, above and below of where lines are drawn.
    pub margins: [f64; 4],
    /// Written above; empty for none.
    pub title: &'a str,
    pub x: Axis,
    pub y: Axis,
    pub lines: Vec<Line<'a>>,
    pub legend: Legend,
}

/// One line of a plot.
pub(crate) struct Line<'a> {
    /// For the legend; empty where it shall not be in there.
    pub name: &'a str,
    /// CSS class: colour and dashes.
    pub class: &'a str,
    /// x and y; what an axis cannot show is left out.
    pub points: Vec<(f64, f64)>,
    /// A dot at each point.
    pub dots: bool,
}

/// Where lines are named.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Legend {
    /// In the upper right corner, one below the other.
    Inside,
    /// To the right of the plot.
    Beside,
}

/// Of a line's sample in the legend.
const SAMPLE: f64 = 36.0;

impl Plot<'_> {
    /// Where a pair of values lies, from the upper left corner.
    pub fn at(&self, x: f64, y: f64) -> Option<[f64; 2]> {
        let ([left, right], [top, bottom]) = self.frame();
        let (across, up) = (self.x.share(x)?, self.y.share(y)?);
        Some([left + (right - left) * across, bottom - (bottom - top) * up])
    }

    /// Left and right, top and bottom of where lines are drawn.
    fn frame(&self) -> ([f64; 2], [f64; 2]) {
        let ([width, height], [left, right, above, below]) = (self.size, self.margins);
        ([left, width - right], [above, height - below])
    }

    /// An `<svg>` of class `chart` for a page; `more` is drawn below the lines.
    pub fn svg(&self, label: &str, more: &str) -> String {
        let [width, height] = self.size;
        format!(
            "<svg class=\"chart\" viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{}\">{more}{}</svg>",
            escape(label),
            self.markup()
        )
    }

    /// What is drawn.
    pub fn markup(&self) -> String {
        let mut out = String::new();
        let ([left, right], [top, bottom]) = self.frame();
        if !self.title.is_empty() {
            let title = escape(self.title);
            let _ = write!(out, "<text class=\"title\" x=\"{left}\" y=\"20\">{title}</text>");
        }
        for (value, name) in &self.y.ticks {
            let Some(share) = self.y.share(*value) else { continue };
            let at = bottom - (bottom - top) * share;
            let _ = write!(
                out,
                "<line class=\"rule\" x1=\"{left}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                left - 6.0,
                at + 4.5,
                escape(name)
            );
        }
        for (value, name) in &self.x.ticks {
            let Some(share) = self.x.share(*value) else { continue };
            let (at, low) = (left + (right - left) * share, bottom + 18.0);
            let name = escape(name);
            let _ =
                write!(out, "<text x=\"{at:.1}\" y=\"{low}\" text-anchor=\"middle\">{name}</text>");
        }
        let (middle, low) = ((left + right) / 2.0, self.size[1] - 6.0);
        let _ = write!(
            out,
            "<text x=\"{middle}\" y=\"{low}\" text-anchor=\"middle\">{}</text>",
            escape(&self.x.label)
        );
        if !self.y.label.is_empty() {
            let _ = write!(
                out,
                "<text transform=\"translate(14 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
                (top + bottom) / 2.0,
                escape(&self.y.label)
            );
        }
        self.lines.iter().for_each(|line| self.line(&mut out, line));
        for (n, line) in self.lines.iter().filter(|l| !l.name.is_empty()).enumerate() {
            self.named(&mut out, n, line);
        }
        out
    }

    fn line(&self, out: &mut String, line: &Line<'_>) {
        let places: Vec<[f64; 2]> =
            line.points.iter().filter_map(|(x, y)| self.at(*x, *y)).collect();
        let points: Vec<String> = places.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = write!(out, "<polyline class=\"{}\" points=\"{}\"/>", line.class, points.join(" "));
        for [x, y] in places.iter().filter(|_| line.dots) {
            let _ = write!(
                out,
                "<circle class=\"{} dot\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\"/>",
                line.class
            );
        }
    }

    fn named(&self, out: &mut String, n: usize, line: &Line<'_>) {
        let ([_, right], [top, _]) = self.frame();
        let at = top + 14.0 + 20.0 * n as f64;
        let (from, to, words) = match self.legend {
            Legend::Inside => (right - 72.0, right - 72.0 + SAMPLE, right - 8.0),
            Legend::Beside => (right + 12.0, right + 12.0 + SAMPLE, right + 20.0 + SAMPLE),
        };
        let anchor = if self.legend == Legend::Inside { " text-anchor=\"end\"" } else { "" };
        let _ = write!(
            out,
            "<line class=\"{}\" x1=\"{from}\" x2=\"{to}\" y1=\"{at}\" y2=\"{at}\"/>\
             <text x=\"{words}\" y=\"{}\"{anchor}>{}</text>",
            line.class,
            at + 4.5,
            escape(line.name)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 200 × 100 with margins 20, 30, 10, 40: x from 20 to 170, y from 60 up to 10.
    #[test]
    fn lines_lie_where_the_axes_say() {
        let plot = Plot {
            size: [200.0, 100.0],
            margins: [20.0, 30.0, 10.0, 40.0],
            title: "",
            x: Axis::linear("x<y", [0.0, 3.0]),
            y: Axis::decades("", [0.1, 10.0].into_iter()).unwrap(),
            lines: vec![Line {
                name: "a<b",
                class: "r",
                points: vec![(0.0, 0.1), (1.0, f64::NAN), (2.0, 1.0), (3.0, 0.0), (3.0, 10.0)],
                dots: true,
            }],
            legend: Legend::Beside,
        };
        let svg = plot.svg("what", "");
        assert!(svg.contains("points=\"20.0,60.0 120.0,35.0 170.0,10.0\""), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 3, "{svg}");
        assert!(svg.contains("x&lt;y") && svg.contains("a&lt;b") && !svg.contains("NaN"), "{svg}");
    }
}
