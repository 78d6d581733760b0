//! Where values lie along an axis, and what is written beside it.

/// One axis of a [`Plot`](super::Plot): its ends, its ticks, and whether it is logarithmic.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    /// What it shows, with its unit; nothing is written where it is empty.
    pub label: String,
    /// Values at both ends.
    ends: [f64; 2],
    logarithmic: bool,
    /// Values with a tick, and their names.
    pub ticks: Vec<(f64, String)>,
}

impl Axis {
    /// Evenly from `low` to `high`, with ticks at round values, six or so.
    pub fn linear(label: &str, [low, high]: [f64; 2]) -> Self {
        let step = round_step((high - low) / 5.0);
        let first = (low / step - 1e-9).ceil();
        let ticks = (0..=6).map(|k| (first + f64::from(k)) * step);
        let ticks = ticks.take_while(|v| *v <= high + 1e-9 * step);
        Self::with_ticks(label, [low, high], ticks.map(|v| (v, short(v))).collect())
    }

    /// Evenly from `low` to `high`, with these ticks.
    pub fn with_ticks(label: &str, ends: [f64; 2], ticks: Vec<(f64, String)>) -> Self {
        Self { label: label.into(), ends, logarithmic: false, ticks }
    }

    /// From 0 to the round value above the largest; None where there is no value.
    pub fn from_zero(label: &str, values: impl Iterator<Item = f64>) -> Option<Self> {
        let high = values.filter(|v| v.is_finite()).reduce(f64::max)?.max(f64::MIN_POSITIVE);
        let step = round_step(high / 5.0);
        Some(Self::linear(label, [0.0, step * (high / step - 1e-9).ceil()]))
    }

    /// Between the round values next to all values; None where there is no value.
    pub fn around(label: &str, values: impl Iterator<Item = f64> + Clone) -> Option<Self> {
        let finite = values.filter(|v| v.is_finite());
        let (low, high) = (finite.clone().reduce(f64::min)?, finite.reduce(f64::max)?);
        // Values that are all alike lie in the middle of a tenth of themselves.
        let step = round_step(((high - low) / 4.0).max(0.02 * high.abs()));
        let ends = [(low / step + 1e-9).floor() * step, (high / step - 1e-9).ceil() * step];
        Some(Self::linear(label, [ends[0], ends[1].max(ends[0] + step)]))
    }

    /// Whole decades around the values that a logarithm has; None where it has none.
    pub fn decades(label: &str, values: impl Iterator<Item = f64>) -> Option<Self> {
        let [low, high] = range(values)?.map(f64::log10);
        let low = low.floor();
        let high = high.ceil().max(low + 1.0);
        let step = (((high - low) as i32) / 6).max(1);
        let powers = (low as i32..=high as i32).step_by(step as usize);
        let ticks = powers.map(|p| (10f64.powi(p), format!("1e{p}"))).collect();
        Some(Self { ends: [low, high].map(|e| 10f64.powf(e)), ..Self::log(label, ticks) })
    }

    /// Logarithmic between the steps 1, 2, 5 that are next to the values; whole decades where these
    /// would be many. None where no value has a logarithm.
    pub fn steps(label: &str, values: impl Iterator<Item = f64> + Clone) -> Option<Self> {
        let [low, high] = range(values.clone())?;
        if high / low > 200.0 {
            return Self::decades(label, values);
        }
        let first = low.log10().floor() as i32;
        let all: Vec<(f64, String)> = (first..first + 5)
            .flat_map(|p| [1, 2, 5].map(|n| (f64::from(n) * 10f64.powi(p), step_name(n, p))))
            .collect();
        let from = all.iter().rposition(|(v, _)| *v <= low * (1.0 + 1e-9)).unwrap_or(0);
        let to = all.iter().position(|(v, _)| *v >= high * (1.0 - 1e-9)).unwrap_or(all.len() - 1);
        Some(Self::log(label, all[from..=to.max(from + 1)].to_vec()))
    }

    /// Powers of two around the values; None where no value has a logarithm.
    pub fn octaves(label: &str, values: impl Iterator<Item = f64>) -> Option<Self> {
        let [low, high] = range(values)?.map(f64::log2);
        let low = low.floor();
        let high = high.ceil().max(low + 1.0);
        let powers = low as i32..=high as i32;
        let ticks = powers.map(|p| (2f64.powi(p), 2f64.powi(p).to_string())).collect();
        Some(Self::log(label, ticks))
    }

    /// Logarithmic from the first tick to the last.
    pub fn log(label: &str, ticks: Vec<(f64, String)>) -> Self {
        let ends = [ticks.first(), ticks.last()].map(|t| t.map_or(1.0, |(v, _)| *v));
        Self { logarithmic: true, ..Self::with_ticks(label, ends, ticks) }
    }

    /// Where a value lies: 0 at the lower end, 1 at the upper one, beyond them outside. None where
    /// it cannot be drawn.
    pub fn share(&self, value: f64) -> Option<f64> {
        let at = |v: f64| if self.logarithmic { v.log10() } else { v };
        let [low, high] = self.ends.map(at);
        let share = (at(value) - low) / (high - low);
        share.is_finite().then_some(share)
    }
}

/// Least and largest of the values that have a logarithm.
fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    let positive = values.filter(|v| v.is_finite() && *v > 0.0);
    positive.fold(None, |range, v| match range {
        None => Some([v, v]),
        Some([low, high]) => Some([v.min(low), v.max(high)]),
    })
}

fn step_name(n: i32, power: i32) -> String {
    if (-2..4).contains(&power) {
        short(f64::from(n) * 10f64.powi(power))
    } else {
        format!("{n}e{power}")
    }
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

/// Without the dust of rounding.
fn short(value: f64) -> String {
    if value != 0.0 && value.abs() < 1e-3 {
        return format!("{value:.1e}").replace(".0e", "e");
    }
    format!("{value:.4}").trim_end_matches('0').trim_end_matches('.').to_owned()
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

    fn names(axis: &Axis) -> Vec<&str> {
        axis.ticks.iter().map(|(_, name)| &name[..]).collect()
    }

    #[test]
    fn axes_end_around_their_values() {
        let axis = Axis::steps("", [3e-4, f64::NAN, 1.2e-3, 0.0].into_iter()).unwrap();
        assert_eq!(names(&axis), ["2e-4", "5e-4", "1e-3", "2e-3"]);
        // Half of the logarithm between the ends.
        assert!((axis.share(2e-3 / 10f64.sqrt()).unwrap() - 0.5).abs() < 1e-12);
        assert_eq!(axis.share(0.0), None);
        assert_eq!(names(&Axis::steps("", [0.5].into_iter()).unwrap()), ["0.5", "1"]);
        assert_eq!(names(&Axis::steps("", [1e-4, 9.0].into_iter()).unwrap()).len(), 6);
        assert_eq!(
            names(&Axis::octaves("", [0.3, 1.5].into_iter()).unwrap()),
            ["0.25", "0.5", "1", "2"]
        );
        let axis = Axis::from_zero("", [0.1, 2.3].into_iter()).unwrap();
        assert_eq!(names(&axis), ["0", "0.5", "1", "1.5", "2", "2.5"]);
        let axis = Axis::around("", [0.131, 0.142].into_iter()).unwrap();
        assert_eq!(names(&axis), ["0.13", "0.135", "0.14", "0.145"]);
        assert_eq!(names(&Axis::linear("", [-2.0, 1.0])), ["-2", "-1", "0", "1"]);
        assert!(Axis::decades("", [0.0].into_iter()).is_none());
        assert!(Axis::from_zero("", [f64::NAN].into_iter()).is_none());
    }
}
