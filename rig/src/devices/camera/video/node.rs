//! A device such as `/dev/video0`, asked call by call (Linux Media Infrastructure userspace API,
//! part I, "Video for Linux API").
//!
//! The calls are made here rather than by the crate's own layer over them: that one panics at
//! values that it does not know, and at errors while a stream is closed.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;

use ::v4l::v4l_sys as sys;
use ::v4l::v4l2::vidioc;

/// Pictures in one piece of memory.
pub const CAPTURE: u32 = sys::v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE;
/// Of devices that Linux knows as video (its list of allocated devices).
const MAJOR: u32 = 81;
/// No device has more formats, sizes or intervals; one that goes on and on is broken.
const MOST: u32 = 256;

/// An open device.
pub struct Node(File);

/// What a device is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Capability {
    pub driver: String,
    pub card: String,
    pub bus: String,
    pub captures: bool,
}

/// A control's limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    pub least: i32,
    pub most: i32,
    pub step: i32,
}

/// The pictures that a device was told to send.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    pub code: u32,
    pub width: u32,
    pub height: u32,
    /// Bytes from one row to the next; 0 where the driver does not tell.
    pub stride: u32,
    /// Whether rows come all at once, not the odd ones first.
    pub progressive: bool,
    /// Whether grey values are said to use all 256, not 16 to 235.
    pub full_range: bool,
}

impl Node {
    /// # Errors
    /// It is not there or may not be opened; `ENOTTY` where it is no video device.
    pub fn open(path: &Path) -> io::Result<Self> {
        let about = std::fs::metadata(path)?;
        // Other devices may do something when they are opened, so they are not.
        if !about.file_type().is_char_device() || libc::major(about.rdev()) != MAJOR {
            return Err(io::Error::from_raw_os_error(libc::ENOTTY));
        }
        let options =
            OpenOptions::new().read(true).write(true).custom_flags(libc::O_NONBLOCK).open(path)?;
        Ok(Self(options))
    }

    pub fn file(&self) -> &File {
        &self.0
    }

    /// # Safety
    /// `request` has to be one whose argument is a `T`.
    pub unsafe fn call<T>(&self, request: vidioc::_IOC_TYPE, argument: &mut T) -> io::Result<()> {
        loop {
            // SAFETY: the argument is of the request's type, and lives as long as the call.
            let done = unsafe {
                ::v4l::v4l2::ioctl(self.0.as_raw_fd(), request, std::ptr::from_mut(argument).cast())
            };
            match done {
                Err(error) if error.raw_os_error() == Some(libc::EINTR) => {}
                done => return done,
            }
        }
    }

    pub fn capability(&self) -> io::Result<Capability> {
        // SAFETY: a plain structure of numbers, and the request's own.
        let mut told: sys::v4l2_capability = unsafe { std::mem::zeroed() };
        unsafe { self.call(vidioc::VIDIOC_QUERYCAP, &mut told)? };
        let caps = match told.capabilities & sys::V4L2_CAP_DEVICE_CAPS {
            0 => told.capabilities,
            _ => told.device_caps,
        };
        let both = sys::V4L2_CAP_VIDEO_CAPTURE | sys::V4L2_CAP_STREAMING;
        let captures = caps & both == both;
        let (driver, card) = (text(&told.driver), text(&told.card));
        Ok(Capability { driver, card, bus: text(&told.bus_info), captures })
    }

    /// The formats that it can send, by their four characters.
    pub fn formats(&self) -> io::Result<Vec<u32>> {
        listed(|index| {
            // SAFETY: a plain structure of numbers, and the request's own.
            let mut told: sys::v4l2_fmtdesc = unsafe { std::mem::zeroed() };
            (told.index, told.type_) = (index, CAPTURE);
            unsafe { self.call(vidioc::VIDIOC_ENUM_FMT, &mut told)? };
            Ok(told.pixelformat)
        })
    }

    /// Width and height of a format's pictures; the largest where any up to it will do. None
    /// where the driver does not tell.
    pub fn sizes(&self, code: u32) -> io::Result<Vec<[u32; 2]>> {
        let told = listed(|index| {
            // SAFETY: a plain structure of numbers, and the request's own.
            let mut told: sys::v4l2_frmsizeenum = unsafe { std::mem::zeroed() };
            (told.index, told.pixel_format) = (index, code);
            unsafe { self.call(vidioc::VIDIOC_ENUM_FRAMESIZES, &mut told)? };
            // SAFETY: all of the union's members are numbers; which one it is stands in the type.
            Ok(unsafe {
                if told.type_ == sys::v4l2_frmsizetypes_V4L2_FRMSIZE_TYPE_DISCRETE {
                    let size = told.__bindgen_anon_1.discrete;
                    [size.width, size.height]
                } else {
                    let size = told.__bindgen_anon_1.stepwise;
                    [size.max_width, size.max_height]
                }
            })
        });
        match told {
            Err(error) if error.raw_os_error() == Some(libc::ENOTTY) => Ok(Vec::new()),
            told => told,
        }
    }

    /// Seconds from frame to frame that it can keep, as fractions; none where the driver does not
    /// tell.
    pub fn intervals(&self, layout: &Layout) -> Vec<[u32; 2]> {
        let told = listed(|index| {
            // SAFETY: a plain structure of numbers, and the request's own.
            let mut told: sys::v4l2_frmivalenum = unsafe { std::mem::zeroed() };
            (told.index, told.pixel_format) = (index, layout.code);
            (told.width, told.height) = (layout.width, layout.height);
            unsafe { self.call(vidioc::VIDIOC_ENUM_FRAMEINTERVALS, &mut told)? };
            if told.type_ != sys::v4l2_frmivaltypes_V4L2_FRMIVAL_TYPE_DISCRETE {
                return Err(io::Error::from_raw_os_error(libc::EINVAL));
            }
            // SAFETY: of that type the union holds this member.
            let time = unsafe { told.__bindgen_anon_1.discrete };
            Ok([time.numerator, time.denominator])
        });
        told.unwrap_or_default()
    }

    /// Asks for a time from frame to frame, seconds as a fraction.
    pub fn set_interval(&self, [numerator, denominator]: [u32; 2]) -> io::Result<()> {
        // SAFETY: a plain structure of numbers, and the request's own.
        let mut told: sys::v4l2_streamparm = unsafe { std::mem::zeroed() };
        told.type_ = CAPTURE;
        told.parm.capture.timeperframe = sys::v4l2_fract { numerator, denominator };
        unsafe { self.call(vidioc::VIDIOC_S_PARM, &mut told) }
    }

    /// Asks for pictures, of the size that is set if none is given; what the driver made of it.
    pub fn set_format(&self, code: u32, size: Option<[u32; 2]>) -> io::Result<Layout> {
        // SAFETY: a plain structure of numbers, and the request's own; of this type its union
        // holds `pix`, all of whose members are numbers.
        let mut told: sys::v4l2_format = unsafe { std::mem::zeroed() };
        told.type_ = CAPTURE;
        let pix = unsafe {
            if size.is_none() {
                self.call(vidioc::VIDIOC_G_FMT, &mut told)?;
            }
            let pix = &mut told.fmt.pix;
            if let Some([width, height]) = size {
                (pix.width, pix.height) = (width, height);
            }
            pix.pixelformat = code;
            pix.field = sys::v4l2_field_V4L2_FIELD_NONE;
            // The driver's to say, not what the format before had.
            (pix.bytesperline, pix.sizeimage) = (0, 0);
            self.call(vidioc::VIDIOC_S_FMT, &mut told)?;
            told.fmt.pix
        };
        let full_range = match pix.quantization {
            sys::v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE => true,
            sys::v4l2_quantization_V4L2_QUANTIZATION_LIM_RANGE => false,
            // The default of YUV, by V4L2_MAP_QUANTIZATION_DEFAULT in the interface's header.
            _ => pix.colorspace == sys::v4l2_colorspace_V4L2_COLORSPACE_JPEG,
        };
        Ok(Layout {
            code: pix.pixelformat,
            width: pix.width,
            height: pix.height,
            stride: pix.bytesperline,
            progressive: pix.field == sys::v4l2_field_V4L2_FIELD_NONE,
            full_range,
        })
    }

    /// A control's limits; `None` where the device has no such control.
    pub fn limits(&self, control: u32) -> io::Result<Option<Limits>> {
        // SAFETY: a plain structure of numbers, and the request's own.
        let mut told: sys::v4l2_queryctrl = unsafe { std::mem::zeroed() };
        told.id = control;
        match unsafe { self.call(vidioc::VIDIOC_QUERYCTRL, &mut told) } {
            Ok(()) if told.flags & sys::V4L2_CTRL_FLAG_DISABLED != 0 => Ok(None),
            Ok(()) => {
                let (least, most, step) = (told.minimum, told.maximum, told.step);
                Ok(Some(Limits { least, most, step }))
            }
            Err(error) if matches!(error.raw_os_error(), Some(libc::EINVAL | libc::ENOTTY)) => {
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    pub fn get(&self, control: u32) -> io::Result<i32> {
        let mut told = sys::v4l2_control { id: control, value: 0 };
        // SAFETY: the request's own structure.
        unsafe { self.call(vidioc::VIDIOC_G_CTRL, &mut told)? };
        Ok(told.value)
    }

    /// Sets a control; what it says that it is then.
    pub fn set(&self, control: u32, value: i32) -> io::Result<i32> {
        let mut told = sys::v4l2_control { id: control, value };
        // SAFETY: the request's own structure.
        unsafe { self.call(vidioc::VIDIOC_S_CTRL, &mut told)? };
        self.get(control)
    }

    /// Whether nobody else has set it up to send pictures.
    pub fn claim(&self) -> io::Result<()> {
        self.request_buffers(0).map(|_| ())
    }

    /// Asks for `count` buffers to map; how many there are.
    pub fn request_buffers(&self, count: u32) -> io::Result<u32> {
        // SAFETY: a plain structure of numbers, and the request's own.
        let mut told: sys::v4l2_requestbuffers = unsafe { std::mem::zeroed() };
        (told.count, told.type_) = (count, CAPTURE);
        told.memory = sys::v4l2_memory_V4L2_MEMORY_MMAP;
        unsafe { self.call(vidioc::VIDIOC_REQBUFS, &mut told)? };
        Ok(told.count.min(MOST))
    }
}

/// What is counted from 0 until there is no more.
fn listed<T>(mut ask: impl FnMut(u32) -> io::Result<T>) -> io::Result<Vec<T>> {
    let mut all = Vec::new();
    for index in 0..MOST {
        match ask(index) {
            Ok(one) => all.push(one),
            Err(error) if error.raw_os_error() == Some(libc::EINVAL) => break,
            Err(error) => return Err(error),
        }
    }
    Ok(all)
}

/// Text that ends with a zero, or with its field.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_end_even_where_a_device_does_not_let_them() {
        assert_eq!(listed(Ok).unwrap().len(), MOST as usize);
        let error = |code| io::Error::from_raw_os_error(code);
        let three = |index| if index < 3 { Ok(index) } else { Err(error(libc::EINVAL)) };
        assert_eq!(listed(three).unwrap(), [0, 1, 2]);
        let gone = listed(|_| Err::<u32, _>(error(libc::ENODEV))).unwrap_err();
        assert_eq!(gone.raw_os_error(), Some(libc::ENODEV));
    }

    #[test]
    fn text_without_an_end_ends_with_its_field() {
        assert_eq!(text(b"UVC Camera\0\0garbage"), "UVC Camera");
        assert_eq!(text(&[b'x'; 4]), "xxxx");
        assert_eq!(text(&[0xFF, b'a', 0]), "\u{FFFD}a");
    }
}
