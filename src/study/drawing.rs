//! A study of plans as a drawing: noise at equal time, and time, over the light there is.

use super::plans::{PlanKind, Row};
use crate::plot::{Axis, Legend, Line, Plot, Sheet};

const SIZE: [f64; 2] = [760.0, 350.0];
const MARGINS: [f64; 4] = [70.0, 210.0, 36.0, 52.0];
const LIGHT: &str =
    "electrons of the brightest place in the longest exposure, were there room for them";

/// Two panels over the electrons of the brightest place, one group of rows for each light, the
/// plain plan first in each.
pub(crate) fn draw(groups: &[&[Row]]) -> String {
    let line = |name, class, plan: PlanKind, figure: &dyn Fn(&Row, &Row) -> f64| {
        let point = |group: &&[Row]| {
            let (plain, row) = (group.first()?, group.iter().find(|r| r.plan == plan)?);
            Some((row.peak_electrons, figure(row, plain)))
        };
        let points = groups.iter().filter_map(point).collect();
        Line { name, class, points, dots: false }
    };
    let noise = |class: usize| {
        move |row: &Row, plain: &Row| {
            row.noise.pixel[class] / plain.noise.pixel[class] * (row.seconds / plain.seconds).sqrt()
        }
    };
    let time = |row: &Row, plain: &Row| row.seconds / plain.seconds;
    let upper = vec![
        line("bright places", "one", PlanKind::Multiplexed, &noise(0)),
        line("middling places", "three", PlanKind::Multiplexed, &noise(1)),
        line("dark places", "two", PlanKind::Multiplexed, &noise(2)),
        line("half", "bound", PlanKind::Plain, &|_, _| 0.5),
        line("plain", "plain", PlanKind::Plain, &|_, _| 1.0),
    ];
    let lower = vec![
        line("adaptive", "one", PlanKind::Adaptive, &time),
        line("adaptive, noise alone", "two", PlanKind::AdaptiveStrict, &time),
        line("multiplexed, adaptive", "three", PlanKind::MultiplexedAdaptive, &time),
        line("a third", "bound", PlanKind::Plain, &|_, _| 1.0 / 3.0),
        line("plain", "plain", PlanKind::Plain, &|_, _| 1.0),
    ];
    let mut sheet = Sheet::default();
    for (title, lines) in [
        ("Multiplexed: noise over the plain plan's, at equal time", upper),
        ("Capture time over the plain plan's", lower),
    ] {
        let points = || lines.iter().flat_map(|line| line.points.iter());
        let axes =
            (Axis::decades(LIGHT, points().map(|p| p.0)), Axis::octaves("", points().map(|p| p.1)));
        if let (Some(x), Some(y)) = axes {
            let (size, margins, legend) = (SIZE, MARGINS, Legend::Beside);
            sheet.plot(&Plot { size, margins, title, x, y, lines, legend });
        }
    }
    sheet.finish()
}
