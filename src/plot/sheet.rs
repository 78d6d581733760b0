//! A drawing in a file of its own: plots, pictures and words on one sheet.

use super::Plot;
use crate::report::html::escape;
use std::fmt::Write as _;

/// Classes of lines that are told apart by colour and by dashes.
pub(crate) const INKS: [&str; 5] = ["one", "two", "three", "four", "five"];

/// As the report's page has it, on white; `bound` is for lines to compare with.
const STYLE: &str = "text{fill:#444;font:13px sans-serif}.title{fill:#000;font-size:15px}\
.rule{stroke:#e6e6e6}polyline,line{fill:none;stroke-width:2;stroke-linejoin:round}\
.bound{stroke:#888;stroke-width:1.2;stroke-dasharray:4 4}\
.one{stroke:#c0392b}.two{stroke:#2471a3;stroke-dasharray:7 4}.three{stroke:#1e8449;stroke-dasharray:2 4}\
.four{stroke:#b9770e;stroke-dasharray:9 3 2 3}.five{stroke:#7d3c98}\
.plain{stroke:#888;stroke-width:1.2}.short{stroke-dasharray:2 3}.long{stroke-dasharray:7 4}.solid{stroke-dasharray:none}\
.dot{stroke:none}.plain.dot,.bound.dot{fill:#888}.one.dot{fill:#c0392b}.two.dot{fill:#2471a3}.three.dot{fill:#1e8449}.four.dot{fill:#b9770e}\
.five.dot{fill:#7d3c98}image{image-rendering:pixelated}";

/// Above a plot that is not the first thing.
const GAP: f64 = 12.0;

/// Things are put below each other or side by side; what is put down last may make it larger.
#[derive(Default)]
pub(crate) struct Sheet {
    size: [f64; 2],
    body: String,
}

impl Sheet {
    /// How high everything is so far.
    pub fn height(&self) -> f64 {
        self.size[1]
    }

    fn grow(&mut self, to: [f64; 2]) {
        self.size = [self.size[0].max(to[0]), self.size[1].max(to[1])];
    }

    /// A plot below everything.
    pub fn plot(&mut self, plot: &Plot<'_>) {
        let top = if self.body.is_empty() { 0.0 } else { self.height() + GAP };
        let _ = write!(self.body, "<g transform=\"translate(0 {top})\">{}</g>", plot.markup());
        self.grow([plot.size[0], top + plot.size[1]]);
    }

    /// Words whose first letter stands at `at`.
    pub fn words(&mut self, at: [f64; 2], class: &str, words: &str) {
        let [x, y] = at;
        let words = escape(words);
        let _ = write!(self.body, "<text class=\"{class}\" x=\"{x}\" y=\"{y}\">{words}</text>");
        self.grow([x, y + 6.0]);
    }

    /// A picture, given as a `data:` address, with its upper left corner at `at`.
    pub fn picture(&mut self, at: [f64; 2], size: [f64; 2], uri: &str) {
        let ([x, y], [w, h]) = (at, size);
        let _ = write!(
            self.body,
            "<image x=\"{x}\" y=\"{y}\" width=\"{w:.1}\" height=\"{h:.1}\" preserveAspectRatio=\"none\" href=\"{uri}\"/>"
        );
        self.grow([x + w, y + h]);
    }

    /// The file.
    pub fn finish(self) -> String {
        let [width, height] = self.size.map(f64::ceil);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\"><style>{STYLE}</style>\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>{}</svg>\n",
            self.body
        )
    }
}
