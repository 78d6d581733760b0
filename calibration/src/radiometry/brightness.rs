//! Whether pictures of a bracket can have the exposure times that they are said to have.

use crate::error::{CalibrationError, Result};
use crate::photo::Photo;

/// A longer exposure may be darker by this much: lamps drift, and black frames are all noise.
const DRIFT: f64 = 0.02;
/// Pictures of one exposure time may differ by this factor before one of the times is wrong.
const SAME_LIGHT: f64 = 1.25;

/// One picture of a bracket.
#[derive(Clone, Debug, PartialEq)]
pub struct Brightness {
    picture: String,
    exposure_s: f64,
    /// Mean code over full scale.
    mean: f64,
}

impl Brightness {
    /// How bright a picture of `exposure_s` seconds is.
    pub fn of(photo: &Photo, exposure_s: f64) -> Self {
        let sum: u64 = photo.data.iter().map(|v| u64::from(*v)).sum();
        let mean = sum as f64 / (photo.data.len().max(1) as f64 * f64::from(photo.max_value));
        Self { picture: photo.name.clone(), exposure_s, mean }
    }
}

/// Refuses times that the pictures contradict: one that was exposed longer is darker or the same
/// picture, or two of one time are far apart.
///
/// # Errors
/// [`CalibrationError::BadBracket`] names both pictures.
pub fn check_brightness(bracket: &[Brightness]) -> Result<()> {
    let mut sorted: Vec<&Brightness> = bracket.iter().collect();
    sorted.sort_by(|a, b| a.exposure_s.total_cmp(&b.exposure_s));
    for pair in sorted.windows(2) {
        let [short, long] = [pair[0], pair[1]];
        let refuse = |found: String| {
            let expected = "pictures that are the brighter the longer they were exposed";
            Err(CalibrationError::BadBracket { expected, found })
        };
        let Brightness { picture: one, exposure_s: t, mean } = short;
        let Brightness { picture: other, exposure_s: u, .. } = long;
        let (least, most) = (mean.min(long.mean), mean.max(long.mean));
        if *u <= 1.02 * t {
            if most > SAME_LIGHT * least {
                let times = most / least;
                return refuse(format!(
                    "{one} and {other} of {t:.4} and {u:.4} s, one {times:.1} times as bright as the other"
                ));
            }
        } else if long.mean < (1.0 - DRIFT) * mean {
            return refuse(format!("{other} ({u:.4} s) darker than {one} ({t:.4} s)"));
        } else if long.mean == *mean && (0.01..0.99).contains(mean) {
            return refuse(format!("{other} ({u:.4} s) no brighter than {one} ({t:.4} s)"));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_that_pictures_contradict_are_refused() {
        let check = |pictures: &[(&str, f64, f64)]| {
            let all = pictures.iter().map(|&(picture, exposure_s, mean)| Brightness {
                picture: picture.into(),
                exposure_s,
                mean,
            });
            check_brightness(&all.collect::<Vec<_>>()).map_err(|e| e.to_string())
        };
        assert!(check(&[("b", 1.0, 0.4), ("a", 0.1, 0.05), ("c", 8.0, 0.9)]).is_ok());
        // Black frames wander; clipped ones are all alike; repeats differ by the lamp.
        assert!(check(&[("a", 0.1, 0.0020), ("b", 1.0, 0.00199)]).is_ok());
        assert!(check(&[("a", 1.0, 1.0), ("b", 2.0, 1.0)]).is_ok());
        assert!(check(&[("a", 1.0, 0.40), ("b", 1.0, 0.41)]).is_ok());
        let told = |error: std::result::Result<(), String>| {
            let error = error.unwrap_err();
            assert!(error.contains("first.png") && error.contains("last.png"), "{error}");
        };
        told(check(&[("first.png", 8.0, 0.05), ("middle.png", 9.0, 0.3), ("last.png", 1.0, 0.4)]));
        told(check(&[("first.png", 1.0, 0.05), ("last.png", 1.0, 0.4)]));
        told(check(&[("first.png", 1.0, 0.2), ("last.png", 2.0, 0.2)]));
    }
}
