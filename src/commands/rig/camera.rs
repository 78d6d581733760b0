//! Cameras in `diaphane rig list` and `diaphane rig test`, and the way out where one cannot be used.

use super::rules::{usb_rule, video_rule};
use crate::Failure;
use crate::output::{check_output, check_png_name};
use ::rig::devices::camera::{CameraDriver, FoundCamera, scan_cameras, usb_device};
use ::rig::{CameraConfig, CameraInfo, DeviceError, DeviceErrorKind, Frame, SimulatedDevices};
use image::{ImageFormat, RgbImage};
use material::{Overwrite, atomic_write};
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// What a camera answered, or why it did not.
pub(super) struct Answer {
    pub driver: CameraDriver,
    pub address: Option<String>,
    /// What it is; and whether it is in software.
    pub outcome: Result<(String, bool), DeviceError>,
    pub advice: Option<String>,
}

impl Answer {
    fn new(
        driver: CameraDriver,
        address: Option<String>,
        outcome: Result<(String, bool), DeviceError>,
    ) -> Self {
        let advice = outcome.as_ref().err().and_then(|error| advice(driver, error));
        Self { driver, address, outcome, advice }
    }

    fn found(camera: FoundCamera) -> Self {
        let words = camera.to_string();
        let outcome = match camera.problem {
            Some(problem) => Err(problem),
            None => Ok((words, camera.fake)),
        };
        Self::new(camera.driver, camera.address, outcome)
    }
}

/// The cameras that are there, and the drivers that are not.
pub(super) fn list() -> Vec<Answer> {
    let missing = CameraDriver::ALL.into_iter().filter(|driver| !driver.is_built());
    let missing = missing.map(|driver| {
        let device = driver.what_for().to_owned();
        let error = DeviceError::MissingDriver { device, driver: driver.name() };
        Answer::new(driver, None, Err(error))
    });
    scan_cameras().into_iter().map(Answer::found).chain(missing).collect()
}

/// The camera of a rig file, opened and asked what it is; `None` for a simulated one.
pub(super) fn ask(config: &CameraConfig, simulated: &dyn SimulatedDevices) -> Option<Answer> {
    let driver = config.camera_driver()?;
    let found = match config.find() {
        Ok(found) => found?,
        Err(error) => return Some(Answer::new(driver, None, Err(error))),
    };
    let outcome = config.open(simulated).map(|camera| (words(&camera.info()), found.fake));
    Some(Answer::new(driver, found.address, outcome))
}

fn words(info: &CameraInfo) -> String {
    let kind = if info.channels == 1 { "grey" } else { "colour" };
    let CameraInfo { name, width, height, bit_depth, .. } = info;
    format!("{name}, {width} x {height} pixels, {kind}, {bit_depth} bits")
}

/// How to get a driver that is not there.
pub(crate) fn how_to_get(driver: CameraDriver) -> String {
    format!(
        "sudo apt-get install {}; then build with --features {} (a default one, on Linux only)",
        driver.packages().join(" "),
        driver.name()
    )
}

/// What to do about a camera that could not be used.
pub(super) fn advice(driver: CameraDriver, error: &DeviceError) -> Option<String> {
    use CameraDriver as D;
    match error {
        DeviceError::MissingDriver { .. } => Some(how_to_get(driver)),
        DeviceError::NoPermission { path, .. } if driver == D::V4l => Some(video_rule(path)),
        DeviceError::NoPermission { path, .. } => Some(format!(
            "add a rule that lets you:\n{}",
            usb_rule(path, usb_device(path).as_ref())
        )),
        error => advice_on(driver, error.kind()).map(str::to_owned),
    }
}

/// What to do about a camera that was there, or might be.
pub(super) fn advice_on(driver: CameraDriver, kind: DeviceErrorKind) -> Option<&'static str> {
    use CameraDriver as D;
    use DeviceErrorKind as K;
    Some(match (kind, driver) {
        (K::NotFound | K::Disconnected, D::Aravis) => {
            "is it plugged in, and powered? On a network: in the same subnet as this machine, with no firewall between? On USB: at a port of USB 3? What is there: diaphane rig list"
        }
        (K::NotFound | K::Disconnected, D::Gphoto2) => {
            "is its USB cable plugged in, is it switched on and awake (its automatic power-off disabled), and one of the cameras that gphoto.org lists? What is there: diaphane rig list"
        }
        (K::NotFound | K::Disconnected, D::V4l) => {
            "is it plugged in? Linux has such cameras as /dev/video0, /dev/video1 and so on. What is there: diaphane rig list"
        }
        (K::Ambiguous, D::Aravis) => "say which in the rig file: serial = \"...\" under [camera]",
        (K::Ambiguous, D::Gphoto2) => {
            "say which in the rig file: name = \"...\" under [camera], or its port, such as \"usb:001,005\""
        }
        (K::Ambiguous, D::V4l) => {
            "say which in the rig file: device = \"/dev/v4l/by-id/...\" under [camera]"
        }
        (K::Busy, D::Gphoto2) => {
            "another program has it, often the desktop's file manager: close it there, or stop gvfs-gphoto2-volume-monitor"
        }
        (K::Busy, _) => "another program has it: close it",
        (K::Timeout | K::Protocol, D::Aravis) => {
            "on a network: the cable, the switch, and a firewall that lets UDP through; on USB: another cable, a port of its own without a hub"
        }
        (K::Timeout | K::Protocol, D::Gphoto2) => {
            "switch the camera off and on again; another cable, a full battery, manual focus"
        }
        (K::Timeout | K::Protocol, D::V4l) => {
            "another cable, a port of its own without a hub, a smaller size"
        }
        _ => return None,
    })
}

/// Where the picture of a test goes: where it was told to, else beside the rig file under the next
/// free number, so that nothing is replaced.
///
/// # Errors
/// It cannot be written there, or would replace what is there.
pub(super) fn picture_path(
    asked: Option<&Path>,
    rig_file: &Path,
    overwrite: Overwrite,
) -> Result<PathBuf, Failure> {
    let path = match asked {
        Some(path) => {
            check_png_name(path, "--picture")?;
            path.to_owned()
        }
        None => {
            let stem = rig_file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let numbered = |n: u32| rig_file.with_file_name(format!("{stem}-test-{n}.png"));
            (1..).map(numbered).find(|path| path.symlink_metadata().is_err()).unwrap_or_default()
        }
    };
    check_output(&path, overwrite)?;
    Ok(path)
}

/// Of the brightest pixels, a share that may become white: a few glints say nothing.
const GLINTS: f64 = 0.001;

/// A picture to look at: black is black, the brightest is white, what lies between as a screen
/// shows it.
///
/// # Errors
/// It cannot be written.
pub(super) fn write_picture(
    frame: &Frame,
    path: &Path,
    overwrite: Overwrite,
) -> Result<(), Failure> {
    let mut sorted = frame.data.clone();
    let place = ((sorted.len() as f64 * (1.0 - GLINTS)) as usize).min(sorted.len().max(1) - 1);
    let white = match sorted.is_empty() {
        true => 1.0,
        false => f64::from((*sorted.select_nth_unstable(place).1).max(1)),
    };
    let tone = |value: u16| {
        let share = (f64::from(value) / white).min(1.0);
        // The curve of screens, near enough for looking at.
        (255.0 * share.powf(1.0 / 2.2)).round() as u8
    };
    let rgb = match frame.channels {
        1 => frame.data.iter().flat_map(|&value| [tone(value); 3]).collect(),
        _ => frame.data.iter().map(|&value| tone(value)).collect(),
    };
    let failed = |what: &str| Failure::other(format!("{}: {what}", path.display()));
    let picture = RgbImage::from_raw(frame.width, frame.height, rgb)
        .ok_or_else(|| failed("the frame's size is not that of its pixels"))?;
    let mut png = Cursor::new(Vec::new());
    picture.write_to(&mut png, ImageFormat::Png).map_err(|e| failed(&e.to_string()))?;
    atomic_write(path, overwrite, |file| {
        use std::io::Write;
        file.write_all(png.get_ref())
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_cameras_that_may_be_on_a_network_are_looked_for_there() {
        for kind in [DeviceErrorKind::NotFound, DeviceErrorKind::Timeout] {
            for driver in CameraDriver::ALL {
                let said = advice_on(driver, kind).unwrap_or_default();
                let network = said.contains("network") || said.contains("subnet");
                assert_eq!(network, driver == CameraDriver::Aravis, "{driver:?}: {said}");
                assert!(!said.is_empty(), "{driver:?}");
            }
        }
    }
}
