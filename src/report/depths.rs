//! The finest detail over depth as inline SVG.

use crate::report::chart::round_step;
use crate::report::html::escape;
use crate::resolution::ByDepth;
use std::fmt::Write as _;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 96.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 44.0;
/// Of the strip above the plot where lines lie that are not determined.
const STRIP: f64 = 34.0;

/// One line a channel over the depth of its slices, finer detail further down; `layers` are values
/// of the channels of `by_depth`. None lies in the strip on top.
pub(crate) fn depths(by_depth: &ByDepth, layers: &[&[Option<f64>]]) -> String {
    let (right, bottom, floor) = (WIDTH - RIGHT, HEIGHT - BOTTOM, TOP + STRIP);
    let deepest = by_depth.thickness_mm;
    let x = |mm: f64| LEFT + (right - LEFT) * mm / deepest;
    let y = |mm: f64| bottom - (bottom - floor) * mm / by_depth.largest_mm;
    let mut out = format!(
        "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"Finest detail over depth\">\
         <rect class=\"beyond\" x=\"{LEFT}\" y=\"{TOP}\" width=\"{}\" height=\"{STRIP}\"/>\
         <text x=\"{}\" y=\"{}\">not determined</text>",
        right - LEFT,
        LEFT + 8.0,
        TOP + 22.0
    );
    for mm in ticks(by_depth.largest_mm) {
        let at = y(mm);
        let _ = write!(
            out,
            "<line class=\"rule\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
             <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            at + 4.5,
            short(mm)
        );
    }
    for mm in ticks(deepest) {
        let (at, low) = (x(mm), bottom + 18.0);
        let _ = write!(
            out,
            "<text x=\"{at:.1}\" y=\"{low}\" text-anchor=\"middle\">{}</text>",
            short(mm)
        );
    }
    let middle = (floor + bottom) / 2.0;
    let _ = write!(
        out,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">depth below the front face, mm</text>\
         <text transform=\"translate(14 {middle}) rotate(-90)\" text-anchor=\"middle\">finest detail, mm</text>",
        (LEFT + right) / 2.0,
        HEIGHT - 6.0
    );
    let count = layers.len() as f64;
    for (n, (channel, values)) in by_depth.channels.iter().zip(layers).enumerate() {
        let class = ["r", "g", "b"][n % 3];
        // Beside each other in the strip, so that each can be seen.
        let lane = TOP + STRIP * (n as f64 + 1.0) / (count + 1.0);
        let points = by_depth.depth_mm.iter().zip(*values);
        let points: Vec<String> = points
            .map(|(depth, mm)| format!("{:.1},{:.1}", x(*depth), mm.map_or(lane, y)))
            .collect();
        let (from, at) = (right + 12.0, floor + 14.0 + 20.0 * n as f64);
        let _ = write!(
            out,
            "<polyline class=\"{class}\" points=\"{}\"/>\
             <line class=\"{class}\" x1=\"{from}\" x2=\"{}\" y1=\"{at}\" y2=\"{at}\"/>\
             <text x=\"{}\" y=\"{}\">{}</text>",
            points.join(" "),
            from + 36.0,
            from + 44.0,
            at + 4.5,
            escape(&channel.channel)
        );
    }
    out + "</svg>"
}

/// Round values from 0 on, six at most.
fn ticks(last: f64) -> impl Iterator<Item = f64> {
    let step = round_step(last / 5.0);
    (0..=5).map(move |k| f64::from(k) * step).take_while(move |v| *v <= last * (1.0 + 1e-9))
}

/// Without the dust of rounding.
fn short(value: f64) -> String {
    format!("{value:.4}").trim_end_matches('0').trim_end_matches('.').to_owned()
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
