//! A short test of a camera, the same for every driver.

use crate::devices::Check;
use crate::{Camera, DeviceError, Frame};

/// What is tried: the shortest exposure that a projector with a colour wheel allows, and two longer
/// ones, seconds.
const EXPOSURES_S: [f64; 3] = [1.0 / 30.0, 0.25, 1.0];
/// A camera that makes more than this of an exposure, relative, is told; so are plans.
const ROUNDING: f64 = 0.01;
/// Above this share a picture shows where the light is and nothing else.
const WHITE: f64 = 0.5;
/// In the dark means differ by noise and dark current; light adds more than this share of full
/// scale in a second, or there is hardly any.
const DARK: f64 = 0.002;

/// Takes pictures at three exposures: whether the camera keeps to them, whether more light gives
/// more, whether it arrives. The picture is the one of them that shows most.
pub fn test_camera(camera: &mut dyn Camera) -> (Vec<Check>, Option<Frame>) {
    let info = camera.info();
    let found = format!(
        "{}, {} x {} pixels, {} of {} bits",
        info.name,
        info.width,
        info.height,
        if info.channels == 1 { "grey" } else { "colour" },
        info.bit_depth
    );
    let mut checks = vec![Check::of("camera", Ok(found))];
    let mut frames = Vec::new();
    let mut retaken = 0_u64;
    let mut temperature = None;
    for asked_s in EXPOSURES_S {
        let (frame, told) = match expose(camera, asked_s) {
            Ok(taken) => taken,
            // What fails once would only be waited for twice more.
            Err(error) => {
                checks.push(Check::of(format!("{} s", short(asked_s)), Err(error)));
                return (checks, best(frames));
            }
        };
        checks.push(exposure(asked_s, frame.exposure_s));
        temperature = told.temperature_c.or(temperature);
        retaken += told.settings.get(RETAKEN).and_then(|n| n.parse::<u64>().ok()).unwrap_or(0);
        frames.push(frame);
    }
    checks.push(brightness(&frames));
    if let Some(first) = frames.first() {
        let share = first.stats().clipped_share;
        let found = format!("{:.1} % at {} s", 100.0 * share, short(EXPOSURES_S[0]));
        checks.push(if share > WHITE {
            Check::fail("clipped", format!("{found}: close the aperture, or dim the light"))
        } else {
            Check::of("clipped", Ok(found))
        });
    }
    checks.push(match retaken {
        0 => Check::of("transfer", Ok("no frame had to be taken again".into())),
        n => {
            let frames = if n == 1 { "a frame".into() } else { format!("{n} frames") };
            Check::fail("transfer", format!("{frames} had to be taken again: see to the cable"))
        }
    });
    checks.push(match temperature {
        Some(celsius) => Check::of("temperature", Ok(format!("{celsius:.1} °C"))),
        None => Check::skipped("temperature", "the camera does not tell"),
    });
    (checks, best(frames))
}

/// What a driver that takes frames again tells how often it did by.
pub(super) const RETAKEN: &str = "frames retaken";

fn expose(
    camera: &mut dyn Camera,
    exposure_s: f64,
) -> Result<(Frame, crate::Readback), DeviceError> {
    let frame = camera.expose(exposure_s)?;
    Ok((frame, camera.readback()?))
}

fn exposure(asked_s: f64, is_s: f64) -> Check {
    let name = format!("{} s", short(asked_s));
    let off = is_s / asked_s - 1.0;
    let found = format!("{is_s:.6} s, {:+.2} %", 100.0 * off);
    if off.abs() > ROUNDING { Check::fail(name, found) } else { Check::of(name, Ok(found)) }
}

fn short(seconds: f64) -> String {
    if seconds < 0.1 { format!("1/{:.0}", 1.0 / seconds) } else { seconds.to_string() }
}

/// Whether more time gives larger numbers, as far as there is light and room for them.
fn brightness(frames: &[Frame]) -> Check {
    let name = "brightness";
    let stats: Vec<_> = frames.iter().map(Frame::stats).collect();
    let means: Vec<String> = stats.iter().map(|s| format!("{:.0}", s.mean)).collect();
    let (Some(first), Some(last)) = (stats.first(), stats.last()) else {
        return Check::skipped(name, "no pictures");
    };
    let full = frames.first().map_or(1.0, |frame| f64::from(frame.max_value()));
    let found = format!("means of {}", means.join(", "));
    let white = first.clipped_share > WHITE;
    let rises = stats.windows(2).all(|pair| pair[1].mean >= pair[0].mean - DARK * full);
    match last.mean - first.mean > DARK * full {
        _ if !rises => Check::fail(name, format!("{found}: longer exposures are darker")),
        true => Check::of(name, Ok(found)),
        false if white => Check::skipped(name, format!("{found}: white from the first on")),
        false => Check::skipped(name, format!("{found}: too dark to tell; is the lens capped?")),
    }
}

/// The longest that is not mostly white.
fn best(frames: Vec<Frame>) -> Option<Frame> {
    let mut best: Option<Frame> = None;
    for frame in frames {
        if best.is_none() || frame.stats().clipped_share < 0.02 {
            best = Some(frame);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::devices::CheckResult;
    use crate::{CameraInfo, Readback};

    /// A sensor of one pixel that counts light, and can be told to lie.
    struct Counter {
        per_s: f64,
        rounds_to: f64,
        retakes: u32,
        gone: bool,
    }

    const HONEST: Counter = Counter { per_s: 20_000.0, rounds_to: 1e-6, retakes: 0, gone: false };

    impl Camera for Counter {
        fn info(&self) -> CameraInfo {
            CameraInfo { name: "counter".into(), width: 1, height: 1, channels: 1, bit_depth: 16 }
        }

        fn expose(&mut self, asked_s: f64) -> Result<Frame, DeviceError> {
            if self.gone {
                return Err(DeviceError::Disconnected { device: "counter".into() });
            }
            let exposure_s = (asked_s / self.rounds_to).round().max(1.0) * self.rounds_to;
            let value = (40_000.0 * f64::from(u8::from(self.per_s < 0.0))
                + self.per_s * exposure_s)
                .clamp(0.0, 65535.0);
            let data = vec![value as u16];
            Ok(Frame { width: 1, height: 1, channels: 1, bit_depth: 16, data, exposure_s })
        }

        fn readback(&mut self) -> Result<Readback, DeviceError> {
            let settings = [(RETAKEN.to_owned(), self.retakes.to_string())];
            Ok(Readback { temperature_c: Some(40.0), settings: settings.into() })
        }
    }

    fn result_of(mut camera: Counter, name: &str) -> CheckResult {
        let (checks, _) = test_camera(&mut camera);
        checks.iter().find(|check| check.name == name).map(|check| check.result).unwrap()
    }

    #[test]
    fn an_honest_camera_passes_and_its_best_picture_is_kept() {
        let (checks, picture) = test_camera(&mut { HONEST });
        let failed = |check: &Check| check.result == CheckResult::Fail;
        assert!(!checks.iter().any(failed), "{checks:?}");
        assert_eq!(picture.unwrap().exposure_s, 1.0);
        let (_, picture) = test_camera(&mut Counter { per_s: 1e6, ..HONEST });
        assert!(picture.unwrap().exposure_s < 0.04, "the others are white");
    }

    #[test]
    fn what_is_wrong_is_told() {
        use CheckResult::{Fail, Pass, Skipped};
        assert_eq!(result_of(Counter { rounds_to: 0.02, ..HONEST }, "1/30 s"), Fail);
        assert_eq!(result_of(Counter { rounds_to: 0.02, ..HONEST }, "1 s"), Pass);
        assert_eq!(result_of(Counter { per_s: -20_000.0, ..HONEST }, "brightness"), Fail);
        assert_eq!(result_of(Counter { per_s: 10.0, ..HONEST }, "brightness"), Skipped);
        assert_eq!(result_of(Counter { per_s: 1e8, ..HONEST }, "brightness"), Skipped);
        assert_eq!(result_of(Counter { per_s: 1e8, ..HONEST }, "clipped"), Fail);
        assert_eq!(result_of(Counter { retakes: 2, ..HONEST }, "transfer"), Fail);
        let (checks, picture) = test_camera(&mut Counter { gone: true, ..HONEST });
        assert_eq!(checks.len(), 2, "the first that fails ends it");
        assert!(picture.is_none());
    }
}
