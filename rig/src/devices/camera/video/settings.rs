//! What a camera is told before its first frame, and its exposure before each (V4L2: "User
//! Controls", "Camera Control Reference").

use std::io;

use ::v4l::v4l_sys as sys;

use super::node::{Limits, Node};

/// Controls by their names in the interface, so that readbacks read like `v4l2-ctl`'s.
const EXPOSURE: u32 = sys::V4L2_CID_EXPOSURE_ABSOLUTE;
/// Units of [`EXPOSURE`] a second.
const TICKS: f64 = 1e4;
/// The first that a camera has is its gain.
const GAIN: [u32; 2] = [sys::V4L2_CID_GAIN, sys::V4L2_CID_ANALOGUE_GAIN];
/// What would make the same light give another number, and the value that switches it off.
const AUTOMATIC: [(u32, &str, i32); 8] = [
    (sys::V4L2_CID_EXPOSURE_AUTO, "auto_exposure", 1),
    (sys::V4L2_CID_AUTOGAIN, "gain_automatic", 0),
    (sys::V4L2_CID_AUTO_WHITE_BALANCE, "white_balance_automatic", 0),
    (sys::V4L2_CID_AUTOBRIGHTNESS, "brightness_automatic", 0),
    (sys::V4L2_CID_BACKLIGHT_COMPENSATION, "backlight_compensation", 0),
    (sys::V4L2_CID_POWER_LINE_FREQUENCY, "power_line_frequency", 0),
    (sys::V4L2_CID_WIDE_DYNAMIC_RANGE, "wide_dynamic_range", 0),
    (sys::V4L2_CID_FOCUS_AUTO, "focus_automatic_continuous", 0),
];

/// A control's own refusals (V4L2: "ioctl VIDIOC_G_CTRL, VIDIOC_S_CTRL", return values).
const REFUSED: [i32; 3] = [libc::EACCES, libc::EINVAL, libc::ERANGE];

/// What keeps a camera from doing as it is told.
#[derive(Debug)]
pub enum Refusal {
    /// It, or the way to it, fails.
    System(io::Error),
    /// It cannot.
    Cannot(String),
}

impl From<io::Error> for Refusal {
    fn from(error: io::Error) -> Self {
        Self::System(error)
    }
}

/// Switches everything automatic off that is there, and sets the gain: the lowest if none is
/// given.
pub fn apply(node: &Node, gain: Option<i32>) -> Result<(), Refusal> {
    for (control, name, off) in AUTOMATIC {
        let Some(limits) = node.limits(control)? else { continue };
        // Backlight compensation, for one, may begin below nothing or above it.
        let off = off.clamp(limits.least, limits.most.max(limits.least));
        if node.get(control)? == off {
            continue;
        }
        // What is only for reading, or has no such choice, is refused in words that mean other
        // things elsewhere.
        let now = match node.set(control, off) {
            Err(error) if error.raw_os_error().is_some_and(|e| REFUSED.contains(&e)) => None,
            now => Some(now?),
        };
        if now != Some(off) {
            return Err(Refusal::Cannot(format!("its {name} cannot be switched off")));
        }
    }
    if node.limits(EXPOSURE)?.is_none() {
        let reason = "it has no exposure time that can be set (exposure_time_absolute)";
        return Err(Refusal::Cannot(reason.into()));
    }
    for control in GAIN {
        let Some(limits) = node.limits(control)? else { continue };
        let wanted = gain.unwrap_or(limits.least);
        let now = node.set(
            control,
            rounded(i64::from(wanted), limits).map_err(|(least, most)| {
                Refusal::Cannot(format!("a gain of {wanted}: it has {least} to {most}"))
            })?,
        )?;
        if gain.is_some_and(|gain| (i64::from(gain) - i64::from(now)).abs() >= step(limits)) {
            return Err(Refusal::Cannot(format!("a gain of {wanted}: it says {now}")));
        }
        return Ok(());
    }
    match gain {
        Some(gain) => Err(Refusal::Cannot(format!("a gain of {gain}: it has none to set"))),
        None => Ok(()),
    }
}

/// Sets an exposure; what the camera says that it made of it, seconds.
pub fn set_exposure(node: &Node, exposure_s: f64) -> Result<f64, Refusal> {
    let reason = || Refusal::Cannot("its exposure time is no longer there".into());
    let limits = node.limits(EXPOSURE)?.ok_or_else(reason)?;
    let told = node.set(EXPOSURE, ticks(exposure_s, limits).map_err(Refusal::Cannot)?)?;
    let told_s = f64::from(told) / TICKS;
    // An hour is the longest that anybody waits; beyond is nonsense.
    if !(told > 0 && told_s <= 3600.0) {
        let reason = format!("asked for an exposure of {exposure_s} s, it says {told_s} s");
        return Err(Refusal::Cannot(reason));
    }
    Ok(told_s)
}

/// The settings after an exposure.
pub fn readback(node: &Node) -> io::Result<Vec<(&'static str, i32)>> {
    let named =
        [(EXPOSURE, "exposure_time_absolute"), (GAIN[0], "gain"), (GAIN[1], "analogue_gain")];
    let mut told = Vec::new();
    for (control, name) in named {
        if node.limits(control)?.is_some() {
            told.push((name, node.get(control)?));
        }
    }
    Ok(told)
}

/// An exposure in the control's units, on its steps.
fn ticks(exposure_s: f64, limits: Limits) -> Result<i32, String> {
    let asked = exposure_s * TICKS;
    let told = |least: i64, most: i64| {
        let (least, most) = (least as f64 / TICKS, most as f64 / TICKS);
        format!("an exposure of {exposure_s} s: it has {least} s to {most} s")
    };
    if !asked.is_finite() || asked.abs() > f64::from(i32::MAX) {
        return Err(told(i64::from(limits.least), i64::from(limits.most)));
    }
    // Zero is no exposure, whatever a control says.
    let limits = Limits { least: limits.least.max(1), ..limits };
    // Between two steps the nearer is taken, before anything else is rounded.
    let (least, step) = (f64::from(limits.least), step(limits) as f64);
    let nearest = least + ((asked - least) / step).round() * step;
    rounded(nearest as i64, limits).map_err(|(least, most)| told(least, most))
}

/// The nearest step of a control; its ends where it is beyond.
fn rounded(wanted: i64, limits: Limits) -> Result<i32, (i64, i64)> {
    let (least, most) = (i64::from(limits.least), i64::from(limits.most));
    if !(least..=most).contains(&wanted) {
        return Err((least, most));
    }
    let step = step(limits);
    let steps = ((wanted - least) + step / 2) / step;
    let last = (most - least) / step;
    i32::try_from(least + steps.min(last) * step).map_err(|_| (least, most))
}

fn step(limits: Limits) -> i64 {
    i64::from(limits.step).max(1)
}

/// The time from frame to frame for an exposure: the shortest that it fits into, or else the
/// longest; seconds as a fraction. Many cameras cut an exposure short that does not fit.
pub fn interval(offers: &[[u32; 2]], exposure_s: f64) -> [u32; 2] {
    let seconds = |[above, below]: &[u32; 2]| f64::from(*above) / f64::from(*below);
    let good = |offer: &&[u32; 2]| seconds(offer).is_finite() && seconds(offer) > 0.0;
    let by_time = |a: &&[u32; 2], b: &&[u32; 2]| seconds(a).total_cmp(&seconds(b));
    let fits = offers.iter().filter(good).filter(|offer| seconds(offer) >= exposure_s);
    let longest = || offers.iter().filter(good).max_by(by_time);
    // A tenth more, for reading the sensor out; where nothing is offered it is the driver's to
    // choose something near.
    let milliseconds = (exposure_s * 1.1e3).ceil().clamp(1.0, 4e6) as u32;
    fits.min_by(by_time).or_else(longest).copied().unwrap_or([milliseconds, 1000])
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn limits(least: i32, most: i32, step: i32) -> Limits {
        Limits { least, most, step }
    }

    #[test]
    fn exposures_are_rounded_to_steps_within_the_limits() {
        assert_eq!(ticks(1.0 / 30.0, limits(3, 2047, 1)), Ok(333));
        assert_eq!(ticks(0.01006, limits(3, 2047, 1)), Ok(101));
        // 50, 150, 250, …: the last step below 1000 is 950.
        assert_eq!(ticks(0.0199, limits(50, 1000, 100)), Ok(150));
        assert_eq!(ticks(0.0201, limits(50, 1000, 100)), Ok(250));
        assert_eq!(ticks(0.097, limits(50, 1000, 100)), Ok(950));
        // Half a step beyond is a matter of rounding, more is not.
        assert_eq!(ticks(0.00027, limits(3, 2047, 1)), Ok(3));
        let refused = ticks(1.0, limits(3, 2047, 1)).unwrap_err();
        assert_eq!(refused, "an exposure of 1 s: it has 0.0003 s to 0.2047 s");
        for nonsense in [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e300] {
            assert!(ticks(nonsense, limits(0, i32::MAX, 0)).is_err(), "{nonsense}");
        }
        assert!(ticks(0.1, limits(9, 1, -5)).is_err(), "limits that are none");
        assert_eq!(rounded(0, limits(i32::MIN, i32::MAX, i32::MAX)).map(|_| ()), Ok(()));
    }

    #[test]
    fn a_frame_lasts_as_long_as_its_exposure() {
        let offers = [[1, 30], [1, 15], [1, 5], [0, 1], [1, 0]];
        assert_eq!(interval(&offers, 0.01), [1, 30]);
        assert_eq!(interval(&offers, 0.05), [1, 15]);
        assert_eq!(interval(&offers, 1.0), [1, 5]);
        assert_eq!(interval(&[[0, 0]], 0.1), [110, 1000]);
        assert_eq!(interval(&[], 1e300), [4_000_000, 1000]);
    }
}
