//! How the values of a volume are spread.

use serde::Serialize;

/// Bars of a histogram.
const BARS: usize = 32;

/// Range, quartiles and histogram of positive values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Spread {
    pub min: f64,
    pub lower_quartile: f64,
    pub median: f64,
    pub upper_quartile: f64,
    pub max: f64,
    pub mean: f64,
    pub histogram: Histogram,
}

/// Numbers of values between edges that lie evenly on a logarithmic scale; the last bar holds its
/// upper edge.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Histogram {
    pub edges: Vec<f64>,
    pub counts: Vec<usize>,
}

impl Spread {
    /// Of positive, finite values; `None` of none.
    pub fn of(values: &[f32]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_unstable_by(f32::total_cmp);
        let (min, max) = (f64::from(*sorted.first()?), f64::from(*sorted.last()?));
        let at =
            |share: f64| f64::from(sorted[((sorted.len() - 1) as f64 * share).round() as usize]);
        let mean = sorted.iter().map(|v| f64::from(*v)).sum::<f64>() / sorted.len() as f64;
        Some(Self {
            min,
            lower_quartile: at(0.25),
            median: at(0.5),
            upper_quartile: at(0.75),
            max,
            mean,
            histogram: Histogram::of(&sorted, min, max),
        })
    }
}

impl Histogram {
    fn of(values: &[f32], min: f64, max: f64) -> Self {
        // All values alike: one bar.
        let bars = if max > min { BARS } else { 1 };
        let step = (max / min).ln() / bars as f64;
        let edges = (0..=bars).map(|i| min * (step * i as f64).exp()).collect();
        let mut counts = vec![0; bars];
        for value in values {
            let bar = ((f64::from(*value) / min).ln() / step) as usize;
            counts[bar.min(bars - 1)] += 1;
        }
        Self { edges, counts }
    }

    /// One character a bar, as high as its number of values.
    pub fn bars(&self) -> String {
        const HEIGHTS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
        let most = self.counts.iter().copied().max().unwrap_or(0).max(1);
        let height = |&count: &usize| match count {
            0 => ' ',
            count => HEIGHTS[(count * HEIGHTS.len()).div_ceil(most) - 1],
        };
        self.counts.iter().map(height).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_and_bars_are_those_of_the_values() {
        let values: Vec<f32> = (0..=100).map(|i| 10_f32.powf(0.02 * i as f32)).collect();
        let spread = Spread::of(&values).unwrap();
        // Powers of ten in single precision.
        let close = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
        close(spread.min, 1.0);
        close(spread.median, 10.0);
        close(spread.upper_quartile, 10_f64.powf(1.5));
        close(spread.max, 100.0);
        let Histogram { edges, counts } = &spread.histogram;
        assert_eq!((edges.len(), counts.len()), (BARS + 1, BARS));
        assert_eq!(counts.iter().sum::<usize>(), 101);
        // Even on the logarithmic scale: 101 values over 32 bars.
        assert!(counts.iter().all(|n| (2..=5).contains(n)), "{counts:?}");
        close(edges[16], 10.0);
        assert_eq!(Spread::of(&[]), None);
    }

    #[test]
    fn values_that_are_all_alike_are_one_bar() {
        let spread = Spread::of(&[0.5; 7]).unwrap();
        assert_eq!(spread.histogram, Histogram { edges: vec![0.5, 0.5], counts: vec![7] });
        assert_eq!(spread.histogram.bars(), "█");
        let two = Histogram { edges: vec![], counts: vec![8, 0, 1] };
        assert_eq!(two.bars(), "█ ▁");
    }
}
