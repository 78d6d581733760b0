//! A session's frames as photographs, and the brackets of its shots as radiance.

use crate::Failure;
use crate::sensor::Sensor;
use crate::session::Session;
use calibration::{HdrImage, Photo, Response};
use rig::{frame_path, read_frame};

/// Relative difference of exposure times that are one.
const SAME_TIME: f64 = 1e-6;

/// The frame of a shot at one exposure, as a photo that carries the shot's name.
pub(super) fn frame_photo(
    session: &Session,
    shot: &str,
    exposure: usize,
) -> Result<Photo, Failure> {
    frame_photo_repeat(session, shot, exposure, 0)
}

/// As [`frame_photo`], of several frames at one exposure.
pub(super) fn frame_photo_repeat(
    session: &Session,
    shot: &str,
    exposure: usize,
    repeat: u32,
) -> Result<Photo, Failure> {
    Ok(frame_and_time(session, shot, exposure, repeat)?.0)
}

/// A frame, and the exposure time that was asked for, seconds.
pub(crate) fn frame_and_time(
    session: &Session,
    shot: &str,
    exposure: usize,
    repeat: u32,
) -> Result<(Photo, f64), Failure> {
    let command = "diaphane capture SESSION";
    let path = session.required(&frame_path(shot, exposure, repeat), command)?;
    let (frame, taken) = read_frame(&path)?;
    let photo = Photo {
        width: frame.width as usize,
        height: frame.height as usize,
        channels: usize::from(frame.channels),
        max_value: frame.max_value(),
        data: frame.data,
        name: shot.to_owned(),
    };
    Ok((photo, taken.requested_s))
}

/// As [`frame_photo`], if it was exposed for the time that the plan has now.
fn timed_frame(
    session: &Session,
    shot: &str,
    exposure: usize,
    planned_s: f64,
) -> Result<Photo, Failure> {
    let (photo, taken_s) = frame_and_time(session, shot, exposure, 0)?;
    if (taken_s / planned_s - 1.0).abs() > SAME_TIME {
        let file = frame_path(shot, exposure, 0);
        let error = format!("{file}: expected {planned_s:.5} s as planned, found {taken_s:.5} s");
        return Err(Failure::input(error).hint(format!(
            "the exposures in session.toml were changed after it was taken: change them back, or move {} aside and capture again",
            session.path("frames").join(shot).display()
        )));
    }
    Ok(photo)
}

/// The pictures that the camera's response is recovered from.
pub(super) fn response_bracket(session: &Session) -> Result<Vec<(Photo, f64)>, Failure> {
    let times = &session.config.plan.response_bracket_s;
    let frame = |(e, t): (usize, &f64)| Ok((frame_photo(session, "response", e)?, *t));
    times.iter().enumerate().map(frame).collect()
}

/// Merges the bracket of a shot, one frame at a time.
pub(crate) fn merge_shot(
    session: &Session,
    shot: &str,
    times: &[f64],
    response: &Response,
    sensor: &Sensor,
) -> Result<HdrImage, Failure> {
    let mut merger = sensor.merger(response, times)?;
    for (e, &t) in times.iter().enumerate() {
        merger.add(timed_frame(session, shot, e, t)?, t)?;
    }
    Ok(merger.finish()?.0)
}

/// light − dark, variances added.
pub(crate) fn subtract(mut light: HdrImage, dark: &HdrImage) -> HdrImage {
    for (l, d) in light.radiance.iter_mut().zip(&dark.radiance) {
        *l -= d;
    }
    for (l, d) in light.variance.iter_mut().zip(&dark.variance) {
        *l += d;
    }
    light
}
