//! Cameras behind their makers' protocols.
//!
//! A driver that needs a library of the system is behind a Cargo feature of its own name. What is
//! there whether it is built or not: how a camera is chosen, how its bytes become digital numbers,
//! and whether this user may open what is plugged in.

#[cfg(all(feature = "aravis", target_os = "linux"))]
mod aravis;
#[cfg(all(feature = "gphoto2", target_os = "linux"))]
mod gphoto2;
mod mosaic;
mod pixels;
mod select;
mod self_test;
mod usb;
#[cfg(all(feature = "v4l", target_os = "linux"))]
mod video;

#[cfg(all(feature = "aravis", target_os = "linux"))]
pub use aravis::{Aravis, GenicamSettings};
#[cfg(all(feature = "gphoto2", target_os = "linux"))]
pub use gphoto2::{Gphoto2, StillSettings};
pub use mosaic::superpixels;
pub use pixels::{Colour, Packing, PixelError, PixelFormat, Pixels};
pub use select::CameraChoice;
pub use self_test::test_camera;
pub use usb::usb_device;
#[cfg(all(feature = "v4l", target_os = "linux"))]
pub use video::{V4l, VideoSettings};

use crate::DeviceError;

/// What speaks to cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraDriver {
    /// GenICam cameras, over GigE Vision and USB3 Vision, by Aravis.
    Aravis,
    /// Tethered still cameras, by gphoto2.
    Gphoto2,
    /// What Linux knows as video devices, by V4L2.
    V4l,
}

impl CameraDriver {
    /// All of them, built or not.
    pub const ALL: [Self; 3] = [Self::Aravis, Self::Gphoto2, Self::V4l];

    /// Its name in rig files, and that of its Cargo feature.
    pub fn name(self) -> &'static str {
        match self {
            Self::Aravis => "aravis",
            Self::Gphoto2 => "gphoto2",
            Self::V4l => "v4l",
        }
    }

    /// What it is for.
    pub fn what_for(self) -> &'static str {
        match self {
            Self::Aravis => "GigE Vision and USB3 Vision cameras",
            Self::Gphoto2 => "tethered still cameras",
            Self::V4l => "video devices of Linux (/dev/video0): webcams, modules, frame grabbers",
        }
    }

    /// The packages that it needs to be built, by Debian's names.
    pub fn packages(self) -> &'static [&'static str] {
        match self {
            Self::Aravis => &["libaravis-dev", "libusb-1.0-0-dev"],
            Self::Gphoto2 => &["libgphoto2-dev", "clang"],
            Self::V4l => &["linux-libc-dev", "clang"],
        }
    }

    /// Whether this program has it.
    pub fn is_built(self) -> bool {
        match self {
            Self::Aravis => cfg!(all(feature = "aravis", target_os = "linux")),
            Self::Gphoto2 => cfg!(all(feature = "gphoto2", target_os = "linux")),
            Self::V4l => cfg!(all(feature = "v4l", target_os = "linux")),
        }
    }

    /// Of those whose drivers open them as USB devices, not as devices of their own.
    fn usb_class(self) -> Option<usb::UsbClass> {
        match self {
            Self::Aravis => Some(usb::USB3_VISION),
            Self::Gphoto2 => Some(usb::STILL_IMAGE),
            Self::V4l => None,
        }
    }

    /// The cameras that it finds, and those that it would find if it were allowed to.
    pub fn scan(self) -> Vec<FoundCamera> {
        let mut found = match self {
            #[cfg(all(feature = "aravis", target_os = "linux"))]
            Self::Aravis => aravis::scan(),
            #[cfg(all(feature = "gphoto2", target_os = "linux"))]
            Self::Gphoto2 => gphoto2::scan(),
            #[cfg(all(feature = "v4l", target_os = "linux"))]
            Self::V4l => video::scan(),
            #[cfg(not(all(
                feature = "aravis",
                feature = "gphoto2",
                feature = "v4l",
                target_os = "linux"
            )))]
            _ => Vec::new(),
        };
        for camera in self.usb_class().into_iter().flat_map(|class| usb::closed(class, self)) {
            // Some are seen by their drivers though they may not be opened.
            match found.iter_mut().find(|seen| usb::is_at(seen, &camera.id)) {
                Some(seen) => seen.problem = camera.problem,
                None => found.push(camera),
            }
        }
        found
    }

    /// The camera that is meant, not opened yet.
    ///
    /// # Errors
    /// None is there, or more than one may be meant; see [`CameraChoice::pick`].
    pub fn find(self, choice: &CameraChoice) -> Result<FoundCamera, DeviceError> {
        match self {
            #[cfg(all(feature = "v4l", target_os = "linux"))]
            Self::V4l => video::find(choice),
            _ => choice.pick(self.scan()),
        }
    }
}

/// All cameras that the drivers of this program find, each opened for a moment to see whether it is
/// free.
pub fn scan_cameras() -> Vec<FoundCamera> {
    let found = CameraDriver::ALL.into_iter().filter(|driver| driver.is_built());
    let mut found: Vec<_> = found.flat_map(CameraDriver::scan).collect();
    for camera in found.iter_mut().filter(|camera| camera.problem.is_none()) {
        camera.problem = is_free(camera).err();
    }
    found
}

/// Whether nobody else has a camera. To open a still camera is to unfold its lens: it is not asked.
#[cfg_attr(
    not(all(any(feature = "aravis", feature = "v4l"), target_os = "linux")),
    expect(unused_variables, reason = "there is nothing to ask")
)]
fn is_free(camera: &FoundCamera) -> Result<(), DeviceError> {
    #[cfg(all(feature = "aravis", target_os = "linux"))]
    if camera.driver == CameraDriver::Aravis {
        return aravis::is_free(camera);
    }
    #[cfg(all(feature = "v4l", target_os = "linux"))]
    if camera.driver == CameraDriver::V4l {
        return video::is_free(camera);
    }
    Ok(())
}

/// A camera that is there.
#[derive(Debug)]
pub struct FoundCamera {
    /// What speaks to it.
    pub driver: CameraDriver,
    /// Maker and model.
    pub name: String,
    /// What its driver calls it; no other camera is called the same.
    pub id: String,
    /// Its serial number, where it has one.
    pub serial: Option<String>,
    /// Where it is: an address of the network, a device of the system.
    pub address: Option<String>,
    /// Where it is plugged in, in the system's words, where its driver tells.
    pub bus: Option<String>,
    /// In software.
    pub fake: bool,
    /// What keeps it from being used, if anything does.
    pub problem: Option<DeviceError>,
}

impl std::fmt::Display for FoundCamera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.name)?;
        match &self.serial {
            Some(serial) => write!(f, " (serial number {serial})"),
            None => Ok(()),
        }
    }
}
