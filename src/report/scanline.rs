//! Captured and relit radiance along one row of the front face, as inline SVG.

use crate::measurement::MeasuredPattern;
use std::fmt::Write as _;

const WIDTH: f64 = 360.0;
const HEIGHT: f64 = 120.0;
const LEFT: f64 = 40.0;
const RIGHT: f64 = 6.0;
const TOP: f64 = 6.0;
const BOTTOM: f64 = 22.0;

/// Colours of channels; a single one is drawn in the colour of the text.
const CLASSES: [&str; 3] = ["r", "g", "b"];

/// The row that a pattern's scanline runs along: the one through the middle of its light.
pub(crate) fn row(pattern: &MeasuredPattern, [nx, ny]: [usize; 2]) -> usize {
    let (mut light, mut moment) = (0.0, 0.0);
    for (y, cells) in pattern.irradiance.chunks_exact(nx.max(1)).enumerate() {
        let sum: f64 = cells.iter().sum();
        light += sum;
        moment += (y as f64 + 0.5) * sum;
    }
    let middle = if light > 0.0 { moment / light } else { ny as f64 / 2.0 };
    (middle as usize).min(ny.saturating_sub(1))
}

/// The plot of one row over a face that is `width_mm` wide, in shares of the radiance `white`.
///
/// Captured is a wide pale band, with a gap where nothing was measured; relit a thin line: where
/// both agree, the line runs in the middle of the band.
pub(crate) fn scanline(
    pattern: &MeasuredPattern,
    relit: &[Vec<f64>],
    nx: usize,
    row: usize,
    width_mm: f64,
    white: f64,
) -> String {
    let part = |map: &[f64]| map.get(row * nx..(row + 1) * nx).unwrap_or_default().to_vec();
    let shares = |map: &Vec<f64>| part(map).iter().map(|v| v / white).collect::<Vec<f64>>();
    let variance = pattern.whole_variance();
    let captured = pattern.radiance.iter().zip(&variance).map(|(l, v)| {
        let measured = part(v).into_iter().map(f64::is_finite);
        shares(l).into_iter().zip(measured).map(|(l, m)| m.then_some(l)).collect()
    });
    let captured: Vec<Vec<Option<f64>>> = captured.collect();
    let relit: Vec<Vec<Option<f64>>> =
        relit.iter().map(|map| shares(map).into_iter().map(Some).collect()).collect();
    let all = captured.iter().chain(&relit).flatten().flatten();
    let top = all.copied().filter(|v| v.is_finite()).fold(1e-12, f64::max);
    let x = |i: usize| LEFT + (WIDTH - LEFT - RIGHT) * (i as f64 + 0.5) / nx as f64;
    let y = |v: f64| TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - (v / top).clamp(0.0, 1.0));
    let mut out = format!(
        "<svg class=\"chart scanline\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
         aria-label=\"radiance along one row: captured and relit\">"
    );
    let (right, floor) = (WIDTH - RIGHT, y(0.0));
    for (share, told) in [(0.0, "0".to_owned()), (top, format!("{:.0} %", 100.0 * top))] {
        let at = y(share);
        let _ = write!(
            out,
            "<line class=\"rule\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
             <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{told}</text>",
            LEFT - 4.0,
            at + 4.0
        );
    }
    let ends = [(LEFT, "start", "0".to_owned()), (right, "end", format!("{width_mm:.1} mm"))];
    for (at, anchor, told) in ends {
        let _ = write!(
            out,
            "<text x=\"{at}\" y=\"{}\" text-anchor=\"{anchor}\">{told}</text>",
            floor + 16.0
        );
    }
    for (lines, kind) in [(&captured, "seen"), (&relit, "again")] {
        for (n, line) in lines.iter().enumerate() {
            let class = if lines.len() == 1 { "y" } else { CLASSES[n % 3] };
            let path = path(line, &x, &y);
            let _ = write!(out, "<path class=\"{kind} {class}\" d=\"{path}\"/>");
        }
    }
    out + "</svg>"
}

/// Lines through the values that are there; a value alone is a dot.
fn path(values: &[Option<f64>], x: &impl Fn(usize) -> f64, y: &impl Fn(f64) -> f64) -> String {
    let mut out = String::new();
    let mut pen_down = false;
    for (i, value) in values.iter().enumerate() {
        match value.filter(|v| v.is_finite()) {
            Some(v) => {
                let letter = if pen_down { 'L' } else { 'M' };
                let _ = write!(out, "{letter}{:.1} {:.1}", x(i), y(v));
                if !pen_down {
                    out += "h0";
                }
                pen_down = true;
            }
            None => pen_down = false,
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use material::Face;
    use rig::Purpose;

    fn pattern(irradiance: Vec<f64>, variance: Vec<f64>) -> MeasuredPattern {
        let radiance = vec![vec![0.0, 1.0, 2.0, 4.0]; 1];
        let (named, place) = (("p".into(), Purpose::Fit), (Face::Back, [2, irradiance.len() / 2]));
        MeasuredPattern::new(named, place, irradiance, radiance, vec![variance])
    }

    #[test]
    fn the_row_runs_through_the_light() {
        let lit = |cell: usize| {
            let mut e = vec![0.0; 6];
            e[cell] = 1.0;
            row(&pattern(e, Vec::new()), [2, 3])
        };
        assert_eq!([lit(0), lit(3), lit(5)], [0, 1, 2]);
        assert_eq!(row(&pattern(vec![1.0; 6], Vec::new()), [2, 3]), 1);
        assert_eq!(row(&pattern(vec![0.0; 6], Vec::new()), [2, 3]), 1);
    }

    /// Two rows of two cells; white is 2, so the second row reaches from 1 to 2. The plot's floor is at
    /// 98, its top at 6; cells lie at a quarter and three quarters of 314 from 40 on.
    #[test]
    fn lines_lie_where_the_axes_say_and_have_gaps() {
        let measured = pattern(vec![0.0, 0.0, 1.0, 1.0], vec![1.0; 4]);
        let relit = [vec![0.0, 0.0, 2.0, 2.0]];
        let svg = scanline(&measured, &relit, 2, 1, 5.0, 2.0);
        assert!(svg.contains("class=\"seen y\" d=\"M118.5 52.0h0L275.5 6.0\""), "{svg}");
        assert!(svg.contains("class=\"again y\" d=\"M118.5 52.0h0L275.5 52.0\""), "{svg}");
        assert!(svg.contains(">200 %</text>") && svg.contains(">5.0 mm</text>"), "{svg}");
        let gap = [Some(1.0), None, Some(3.0)];
        let gap = path(&gap, &|i| i as f64, &|v| v);
        assert_eq!(gap, "M0.0 1.0h0M2.0 3.0h0");
        let masked = pattern(vec![0.0, 0.0, 1.0, 1.0], vec![1.0, 1.0, f64::INFINITY, 1.0]);
        let svg = scanline(&masked, &relit, 2, 1, 5.0, 2.0);
        assert!(svg.contains("class=\"seen y\" d=\"M275.5 6.0h0\""), "{svg}");
    }
}
