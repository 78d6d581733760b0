//! The colour bars of maps.

use crate::report::colour::sequential_stops;

/// The colours of [`sequential`](crate::report::colour::sequential) over a range, by the logarithm.
pub(crate) fn bar([low, high]: [f64; 2], unit: &str) -> String {
    // Ends and the geometric middle: logarithmic ranges are rarely whole decades.
    ticked([(0.0, low), (50.0, (low * high).sqrt()), (100.0, high)], unit)
}

/// The same over a range from 0, evenly.
pub(crate) fn even_bar(high: f64, unit: &str) -> String {
    ticked([(0.0, 0.0), (50.0, high / 2.0), (100.0, high)], unit)
}

fn ticked(ticks: [(f64, f64); 3], unit: &str) -> String {
    let ticks: String = ticks
        .iter()
        .map(|(at, v)| format!("<span style=\"left:{at}%\">{} {unit}</span>", three_digits(*v)))
        .collect();
    format!(
        "<div class=\"bar\" style=\"background:linear-gradient(90deg,{})\"></div><div class=\"ticks\">{ticks}</div>",
        sequential_stops()
    )
}

/// Three digits that count, without an exponent where that reads well.
fn three_digits(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    if !(1e-4..1e4).contains(&value) {
        return format!("{value:.2e}");
    }
    let decimals = (2.0 - value.log10().floor()).clamp(0.0, 7.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::three_digits;

    #[test]
    fn three_digits_count() {
        let shown = [0.001234, 0.5, 1.0, 123.4, 1234.0, 2e-6].map(three_digits);
        assert_eq!(shown, ["0.00123", "0.500", "1.00", "123", "1234", "2.00e-6"]);
    }
}
