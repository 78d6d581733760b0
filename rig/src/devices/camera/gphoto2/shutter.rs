//! Exposures that a camera offers in words.

/// Nearest by ratio.
pub fn nearest<'a>(times: &[(f64, &'a String)], exposure_s: f64) -> Option<(f64, &'a String)> {
    let off = |time: f64| (time / exposure_s).ln().abs();
    times.iter().copied().min_by(|a, b| off(a.0).total_cmp(&off(b.0)))
}

/// Not more than a third of a stop beyond what the camera has.
pub fn within(exposure_s: f64, (least, most): (f64, f64)) -> bool {
    let third = 2.0_f64.powf(1.0 / 3.0);
    exposure_s >= least / third && exposure_s <= most * third
}

/// Seconds of an exposure in a camera's words: `1/30`, `0.0333s`, `1.3`, `30`; none of `Bulb`.
pub fn seconds(words: &str) -> Option<f64> {
    let words = words.trim().trim_end_matches(['s', '"']).trim();
    let time = match words.split_once('/') {
        Some((above, below)) => {
            above.trim().parse::<f64>().ok()? / below.trim().parse::<f64>().ok()?
        }
        None => words.parse().ok()?,
    };
    (time.is_finite() && time > 0.0).then_some(time)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposures_are_read_in_any_camera_s_words() {
        for (words, time) in [
            ("1/30", Some(1.0 / 30.0)),
            ("0.0333s", Some(0.0333)),
            ("30", Some(30.0)),
            ("1.3", Some(1.3)),
            ("10/13", Some(10.0 / 13.0)),
            ("2\"", Some(2.0)),
            ("Bulb", None),
            ("1/0", None),
            ("-1", None),
            ("", None),
        ] {
            assert_eq!(seconds(words), time, "{words}");
        }
    }

    #[test]
    fn the_nearest_by_ratio_is_taken_and_none_that_is_far() {
        let names: Vec<String> = ["1/60", "1/15", "1"].map(String::from).into();
        let times: Vec<(f64, &String)> =
            names.iter().filter_map(|n| Some((seconds(n)?, n))).collect();
        // As far from both by ratio, nearer to 1/60 by difference.
        assert_eq!(nearest(&times, 1.0 / 29.0).unwrap().1, "1/15");
        assert_eq!(nearest(&times, 1.0 / 31.0).unwrap().1, "1/60");
        assert!(nearest(&[], 1.0).is_none());
        assert!(within(1.2, (0.01, 1.0)) && !within(1.3, (0.01, 1.0)));
        assert!(!within(f64::NAN, (0.01, 1.0)) && !within(0.0, (0.01, 1.0)));
    }
}
