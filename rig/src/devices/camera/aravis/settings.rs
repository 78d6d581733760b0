//! What a camera is told before its first frame, and what it says of itself after each.

use std::collections::BTreeMap;

use aravis::glib;
use aravis::prelude::*;

use super::library::feature_text;
use crate::Readback;
use crate::devices::camera::{CameraChoice, PixelFormat};

/// Which GenICam camera, and what it is set to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GenicamSettings {
    /// Which camera.
    pub choice: CameraChoice,
    /// A pixel format by its GenICam name, such as `BayerRG12`; `None` for the deepest that is
    /// understood.
    pub pixel_format: Option<String>,
    /// Gain, dB, or in the camera's own numbers where it counts otherwise; `None` for the lowest.
    pub gain: Option<f64>,
    /// What part of the sensor is read: left, top, width, height in pixels; `None` for all of it.
    pub roi: Option<[u32; 4]>,
}

/// What keeps a camera from doing as it is told.
pub enum Refusal {
    /// It, or the way to it, fails.
    Library(glib::Error),
    /// It cannot.
    Cannot(String),
}

impl From<glib::Error> for Refusal {
    fn from(error: glib::Error) -> Self {
        Self::Library(error)
    }
}

/// How a frame is started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Start {
    /// The camera waits for a command.
    SoftwareTrigger,
    /// The camera takes one frame as soon as it is switched to taking frames.
    SingleFrame,
}

/// A camera as it was set.
pub struct Set {
    pub format: PixelFormat,
    pub width: u32,
    pub height: u32,
    pub start: Start,
}

/// What would make the same light give another number, and the value that switches it off.
const AUTOMATIC: [(&str, &str); 4] = [
    ("ExposureAuto", "Off"),
    ("GainAuto", "Off"),
    ("BlackLevelAuto", "Off"),
    ("BalanceWhiteAuto", "Off"),
];
/// The same, of features that are on or off. The last would keep long exposures out.
const SWITCHES: [&str; 3] = ["GammaEnable", "LUTEnable", "AcquisitionFrameRateEnable"];

/// Makes the camera say what it sees, and no more: nothing automatic, no curve, one frame when
/// asked.
pub fn apply(camera: &aravis::Camera, settings: &GenicamSettings) -> Result<Set, Refusal> {
    // Whoever had it last may have left it running; then it takes no settings.
    let _ = camera.stop_acquisition();
    if camera.is_binning_available().unwrap_or(false) {
        camera.set_binning(1, 1)?;
    }
    let format = set_pixel_format(camera, settings.pixel_format.as_deref())?;
    let [width, height] = set_region(camera, settings.roi)?;
    for (feature, off) in AUTOMATIC {
        if camera.is_feature_available(feature)? {
            camera.set_string(feature, off)?;
            let now = feature_text(camera, feature)?;
            if now.as_deref() != Some(off) {
                let now = now.unwrap_or_default();
                return Err(Refusal::Cannot(format!("{feature} stays \"{now}\", not \"{off}\"")));
            }
        }
    }
    for feature in SWITCHES {
        if camera.is_feature_available(feature)? {
            camera.set_boolean(feature, false)?;
        }
    }
    if camera.is_feature_available("ExposureMode")? {
        camera.set_string("ExposureMode", "Timed")?;
    }
    set_gain(camera, settings.gain)?;
    let start = set_start(camera)?;
    Ok(Set { format, width, height, start })
}

fn set_pixel_format(camera: &aravis::Camera, wanted: Option<&str>) -> Result<PixelFormat, Refusal> {
    let codes = camera.dup_available_pixel_formats()?;
    let known: Vec<(u32, PixelFormat)> = codes
        .iter()
        .filter_map(|&code| {
            let code = u32::try_from(code).ok()?;
            Some((code, PixelFormat::of_code(code)?))
        })
        .collect();
    if let Some(name) = wanted {
        let names = camera.dup_available_pixel_formats_as_strings()?;
        if !names.iter().any(|there| there == name) {
            let names: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
            return Err(Refusal::Cannot(format!("no {name:?}; it has {}", names.join(", "))));
        }
        camera.set_pixel_format_from_string(name)?;
    } else if let Some((code, _)) = known.iter().max_by_key(|(_, format)| format.merit()) {
        camera.set_pixel_format(aravis::PixelFormat::from_raw(*code))?;
    }
    let code = camera.pixel_format()?.raw();
    PixelFormat::of_code(code).ok_or_else(|| {
        let name = feature_text(camera, "PixelFormat").ok().flatten().unwrap_or_default();
        Refusal::Cannot(format!("pictures in the format \"{name}\" ({code:#010x}) are not read"))
    })
}

fn set_region(camera: &aravis::Camera, wanted: Option<[u32; 4]>) -> Result<[u32; 2], Refusal> {
    let movable = camera.is_feature_available("OffsetX")?;
    // From the corner first: how large a part may be depends on where it begins.
    if movable {
        camera.set_integer("OffsetX", 0)?;
        camera.set_integer("OffsetY", 0)?;
    }
    let ((_, widest), (_, highest)) = (camera.width_bounds()?, camera.height_bounds()?);
    let whole = [0, 0, widest, highest];
    let asked = match wanted {
        None => whole,
        Some(roi) => roi.map(|value| i32::try_from(value).unwrap_or(i32::MAX)),
    };
    let [x, y, width, height] = asked;
    let inside = x.checked_add(width).is_some_and(|right| right <= widest)
        && y.checked_add(height).is_some_and(|bottom| bottom <= highest);
    if !inside || (!movable && (x, y) != (0, 0)) {
        return Err(Refusal::Cannot(format!(
            "no part of {width} x {height} pixels at {x}, {y}: it has {widest} x {highest}{}",
            if movable { "" } else { ", from the corner only" }
        )));
    }
    if movable {
        camera.set_region(x, y, width, height)?;
    } else {
        camera.set_integer("Width", i64::from(width))?;
        camera.set_integer("Height", i64::from(height))?;
    }
    let size = [camera.integer("Width")?, camera.integer("Height")?];
    let offset = match movable {
        true => [camera.integer("OffsetX")?, camera.integer("OffsetY")?],
        false => [0, 0],
    };
    if wanted.is_some() && (offset, size) != ([x, y].map(i64::from), [width, height].map(i64::from))
    {
        return Err(Refusal::Cannot(format!(
            "asked for {width} x {height} pixels at {x}, {y}, it made {} x {} at {}, {} of it",
            size[0], size[1], offset[0], offset[1]
        )));
    }
    match size.map(u32::try_from) {
        [Ok(width), Ok(height)] if width > 0 && height > 0 => Ok([width, height]),
        _ => Err(Refusal::Cannot(format!("pictures of {} x {} pixels", size[0], size[1]))),
    }
}

fn set_gain(camera: &aravis::Camera, wanted: Option<f64>) -> Result<(), Refusal> {
    if !camera.is_gain_available()? {
        return match wanted {
            None => Ok(()),
            Some(_) => Err(Refusal::Cannot("it has no gain to be set".into())),
        };
    }
    let (least, most) = camera.gain_bounds()?;
    let gain = wanted.unwrap_or(least);
    if wanted.is_some() && !(least..=most).contains(&gain) {
        return Err(Refusal::Cannot(format!("a gain of {gain}: it has {least} to {most}")));
    }
    Ok(camera.set_gain(gain)?)
}

fn set_start(camera: &aravis::Camera) -> Result<Start, Refusal> {
    let triggered = camera.is_feature_available("TriggerSoftware")?
        && camera.set_trigger("Software").is_ok()
        && feature_text(camera, "TriggerSource")?.as_deref() == Some("Software");
    if triggered {
        camera.set_acquisition_mode(aravis::AcquisitionMode::Continuous)?;
        return Ok(Start::SoftwareTrigger);
    }
    camera.clear_triggers()?;
    camera.set_acquisition_mode(aravis::AcquisitionMode::SingleFrame)?;
    Ok(Start::SingleFrame)
}

/// What the camera says of itself; what it does not know is left out.
pub fn readback(camera: &aravis::Camera, start: Start) -> Result<Readback, glib::Error> {
    let mut settings = BTreeMap::new();
    for feature in ["PixelFormat", "ExposureAuto", "GainAuto"] {
        if camera.is_feature_available(feature)?
            && let Some(text) = feature_text(camera, feature)?
        {
            settings.insert(feature.to_owned(), text);
        }
    }
    let exposure = camera.exposure_time()?;
    settings.insert("ExposureTime".into(), format!("{exposure} us"));
    if camera.is_gain_available()? {
        settings.insert("Gain".into(), format!("{}", camera.gain()?));
    }
    let started = match start {
        Start::SoftwareTrigger => "software",
        Start::SingleFrame => "single frame",
    };
    settings.insert("Trigger".into(), started.into());
    let mut temperature_c = None;
    // The name of the standard, and that of older cameras.
    for feature in ["DeviceTemperature", "TemperatureAbs"] {
        if temperature_c.is_none() && camera.is_feature_available(feature)? {
            temperature_c = camera.float(feature).ok().filter(|celsius| celsius.is_finite());
        }
    }
    Ok(Readback { temperature_c, settings })
}
