//! Which of the cameras that are there a rig file means.

use super::FoundCamera;
use crate::DeviceError;

/// What a rig file says about which camera it means. Nothing at all means the only one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CameraChoice {
    /// A part of what the camera is called, large and small letters alike.
    pub name: Option<String>,
    /// Its serial number, exactly.
    pub serial: Option<String>,
    /// The device of the system that it is, or where it is plugged in, exactly.
    pub device: Option<String>,
}

impl std::fmt::Display for CameraChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("camera")?;
        if let Some(name) = &self.name {
            write!(f, " \"{name}\"")?;
        }
        if let Some(serial) = &self.serial {
            write!(f, " with serial number {serial}")?;
        }
        if let Some(device) = &self.device {
            write!(f, " at {device}")?;
        }
        Ok(())
    }
}

impl CameraChoice {
    /// The one of `cameras` that is meant.
    ///
    /// # Errors
    /// None is, or more than one; the error lists those that are there, or that it may be. Where
    /// none is, and one that might be could not be asked what it is, its error.
    pub fn pick(&self, cameras: Vec<FoundCamera>) -> Result<FoundCamera, DeviceError> {
        let name = self.name.as_deref().map(str::to_lowercase);
        let fits = |camera: &FoundCamera| {
            name.as_ref().is_none_or(|name| {
                camera.name.to_lowercase().contains(name) || camera.id.to_lowercase() == *name
            }) && self.serial.as_ref().is_none_or(|serial| camera.serial.as_ref() == Some(serial))
                && self.device.as_ref().is_none_or(|device| {
                    camera.id == *device || camera.bus.as_ref() == Some(device)
                })
        };
        let (matching, others): (Vec<_>, Vec<_>) = cameras.into_iter().partition(fits);
        let device = self.to_string();
        let titles = |cameras: &[FoundCamera]| cameras.iter().map(|c| c.to_string()).collect();
        if matching.len() > 1 {
            return Err(DeviceError::Ambiguous { device, matching: titles(&matching) });
        }
        if let Some(camera) = matching.into_iter().next() {
            return match camera.problem {
                Some(problem) => Err(problem),
                None => Ok(camera),
            };
        }
        // A camera that may not be opened does not tell its name either.
        let there = titles(&others);
        match others.into_iter().find_map(|camera| camera.problem) {
            Some(problem) => Err(problem),
            None => Err(DeviceError::NoneSuch { device, there }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::CameraDriver;
    use super::*;
    use crate::DeviceErrorKind;

    fn camera(name: &str, serial: &str) -> FoundCamera {
        let id = format!("{name}-{serial}");
        let (name, serial) = (name.to_owned(), Some(serial.to_owned()));
        let driver = CameraDriver::Aravis;
        FoundCamera {
            driver,
            name,
            id,
            serial,
            address: None,
            bus: None,
            fake: false,
            problem: None,
        }
    }

    fn pick(name: &str, serial: &str) -> Result<String, DeviceError> {
        let some = |text: &str| (!text.is_empty()).then(|| text.to_owned());
        let choice = CameraChoice { name: some(name), serial: some(serial), device: None };
        let there = vec![camera("Basler acA1920", "1"), camera("Basler acA1920", "2")];
        choice.pick(there).map(|camera| camera.id)
    }

    #[test]
    fn a_name_two_cameras_have_is_no_name() {
        for name in ["", "basler", "ACA1920"] {
            let error = pick(name, "").unwrap_err();
            assert_eq!(error.kind(), DeviceErrorKind::Ambiguous);
            let words = error.to_string();
            assert!(words.contains("serial number 1") && words.contains("serial number 2"));
        }
        assert_eq!(pick("basler", "2").unwrap(), "Basler acA1920-2");
        assert_eq!(pick("", "1").unwrap(), "Basler acA1920-1");
        assert_eq!(pick("basler aca1920-2", "").unwrap(), "Basler acA1920-2");
    }

    #[test]
    fn none_of_that_name_lists_those_that_are_there() {
        let error = pick("FLIR", "").unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::NotFound);
        let words = error.to_string();
        assert!(words.contains("FLIR") && words.contains("acA1920 (serial number 2)"), "{words}");
        let error = CameraChoice::default().pick(Vec::new()).unwrap_err().to_string();
        assert_eq!(error, "camera: not found; there is none");
    }

    #[test]
    fn one_that_may_not_be_opened_says_why() {
        let mut closed = camera("USB camera", "");
        let problem = |device: &str| DeviceError::NoPermission {
            device: device.into(),
            path: "/dev/bus/usb/001/002".into(),
        };
        closed.problem = Some(problem("USB camera"));
        let choice = CameraChoice { name: Some("Basler".into()), ..CameraChoice::default() };
        let error = choice.pick(vec![closed]).unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::NoPermission);
    }
}
