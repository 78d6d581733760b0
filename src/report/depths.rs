//! The finest detail over depth as inline SVG.

use crate::plot::{Axis, Legend, Line, Plot};
use crate::resolution::ByDepth;

const SIZE: [f64; 2] = [720.0, 300.0];
const LEFT: f64 = 64.0;
const RIGHT: f64 = 96.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 44.0;
/// Of the strip above the plot where lines lie that are not determined.
const STRIP: f64 = 34.0;

/// One line a channel over the depth of its slices, finer detail further down; `layers` are values
/// of the channels of `by_depth`. None lies in the strip on top.
pub(crate) fn depths(by_depth: &ByDepth, layers: &[&[Option<f64>]]) -> String {
    let largest = by_depth.largest_mm;
    // Of the strip's height, upwards, as a value of the axis that ends below it.
    let above = |share: f64| largest * (1.0 + share * STRIP / (SIZE[1] - TOP - STRIP - BOTTOM));
    let count = layers.len() as f64;
    let lines = by_depth.channels.iter().zip(layers).enumerate().map(|(n, (channel, values))| {
        // Beside each other in the strip, so that each can be seen.
        let lane = above(1.0 - (n as f64 + 1.0) / (count + 1.0));
        let points = by_depth.depth_mm.iter().zip(*values);
        Line {
            name: &channel.channel,
            class: ["r", "g", "b"][n % 3],
            points: points.map(|(depth, mm)| (*depth, mm.unwrap_or(lane))).collect(),
            dots: false,
        }
    });
    let plot = Plot {
        size: SIZE,
        margins: [LEFT, RIGHT, TOP + STRIP, BOTTOM],
        title: "",
        x: Axis::linear("depth below the front face, mm", [0.0, by_depth.thickness_mm]),
        y: Axis::linear("finest detail, mm", [0.0, largest]),
        lines: lines.collect(),
        legend: Legend::Beside,
    };
    let strip = format!(
        "<rect class=\"beyond\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{STRIP}\"/>\
         <text x=\"{}\" y=\"{}\">not determined</text>",
        SIZE[0] - RIGHT - LEFT,
        LEFT + 8.0,
        TOP + 22.0
    );
    plot.svg("Finest detail over depth", &strip)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resolution::ChannelByDepth;

    /// A plot of 8 mm over 2 mm: a slice in the middle that is not determined lies in the strip, its
    /// neighbours at half of the height and on the floor.
    #[test]
    fn lines_lie_where_the_axes_say() {
        let values = [Some(4.0), None, Some(0.0)];
        let channel = ChannelByDepth {
            channel: "a<b".into(),
            kappa_mm: values.to_vec(),
            mu_mm: vec![None; 3],
        };
        let by_depth = ByDepth {
            depth_mm: vec![0.0, 1.0, 2.0],
            thickness_mm: 2.0,
            largest_mm: 8.0,
            channels: vec![channel],
        };
        let svg = depths(&by_depth, &[&values]);
        assert!(svg.contains("points=\"64.0,152.0 344.0,31.0 624.0,256.0\""), "{svg}");
        assert!(svg.contains("a&lt;b") && svg.contains(">0.5</text>"), "{svg}");
    }
}
