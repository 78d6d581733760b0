use std::io;

use super::*;
use crate::DeviceErrorKind;
use crate::devices::camera::CameraDriver;

fn camera() -> FoundCamera {
    FoundCamera {
        driver: CameraDriver::V4l,
        name: "Webcam".into(),
        id: "/dev/video7".into(),
        serial: None,
        address: None,
        bus: None,
        fake: false,
        problem: None,
    }
}

fn open(name: Option<&str>, device: Option<&str>) -> DeviceError {
    let choice = CameraChoice {
        name: name.map(Into::into),
        device: device.map(Into::into),
        ..CameraChoice::default()
    };
    match V4l::open(VideoSettings { choice, ..VideoSettings::default() }) {
        Ok(_) => panic!("opened {name:?} {device:?}"),
        Err(error) => error,
    }
}

#[test]
fn what_a_driver_says_is_told_apart() {
    use DeviceErrorKind::{
        Busy, Disconnected, NoPermission, NotFound, Protocol, Timeout, Unsupported,
    };
    for (code, kind) in [
        (libc::ENODEV, Disconnected),
        (libc::ENXIO, Disconnected),
        (libc::ENOENT, NotFound),
        (libc::EBUSY, Busy),
        (libc::EACCES, NoPermission),
        (libc::EPERM, NoPermission),
        (libc::ENOTTY, Unsupported),
        (libc::ENOSPC, Unsupported),
        (libc::EINVAL, Unsupported),
        (libc::EIO, Protocol),
    ] {
        let error = device_error(&camera(), &io::Error::from_raw_os_error(code));
        assert_eq!(error.kind(), kind, "{code}");
        assert_ne!(error.kind(), Timeout);
        assert!(error.to_string().contains("Webcam"), "{error}");
    }
    let error = device_error(&camera(), &io::Error::from_raw_os_error(libc::EACCES));
    assert!(error.to_string().contains("/dev/video7"), "{error}");
}

#[test]
fn what_is_no_camera_is_named() {
    let error = open(Some("no camera is called this"), None);
    assert_eq!(error.kind(), DeviceErrorKind::NotFound);
    assert!(error.to_string().contains("no camera is called this"), "{error}");
    let error = open(None, Some("/dev/video-there-is-none"));
    assert!(matches!(error, DeviceError::NoneSuch { .. }), "{error}");
    assert!(error.to_string().contains("/dev/video-there-is-none"), "{error}");
    let error = open(None, Some("usb-there-is-no-such-bus"));
    assert_eq!(error.kind(), DeviceErrorKind::NotFound);
    let file = tempfile::NamedTempFile::new().unwrap();
    for path in ["/dev/null", file.path().to_str().unwrap(), "/dev"] {
        let error = open(None, Some(path));
        assert_eq!(error.kind(), DeviceErrorKind::Unsupported, "{error}");
        assert!(error.to_string().contains("no video device"), "{error}");
        assert!(error.to_string().contains(path.rsplit('/').next().unwrap()), "{error}");
    }
}

#[test]
fn a_device_that_does_not_do_as_told_is_refused() {
    let offers = [(u32::from_le_bytes(*b"GREY"), Vec::new())];
    let (grey, _) = format::choose(&offers, None, None).unwrap();
    let good = Layout {
        code: grey.number(),
        width: 640,
        height: 480,
        stride: 640,
        progressive: true,
        full_range: true,
    };
    assert_eq!(check(grey, &good, Some([640, 480])), Ok(()));
    assert!(check(grey, &good, Some([320, 240])).unwrap_err().contains("nearest is 640 x 480"));
    for bad in [
        Layout { code: u32::from_le_bytes(*b"MJPG"), ..good },
        Layout { width: 0, ..good },
        Layout { height: u32::MAX, ..good },
        Layout { progressive: false, ..good },
    ] {
        assert!(check(grey, &bad, None).is_err(), "{bad:?}");
    }
}

#[test]
fn times_between_frames_count_those_that_were_lost() {
    let raw = |sequence, ms: Option<u64>| Raw {
        bytes: Vec::new(),
        broken: false,
        sequence,
        at: ms.map(Duration::from_millis),
    };
    assert_eq!(apart(&raw(1, Some(1000)), &raw(3, Some(1200))), Some(0.1));
    assert_eq!(apart(&raw(1, Some(1000)), &raw(1, Some(1200))), None);
    assert_eq!(apart(&raw(1, Some(1000)), &raw(2, None)), None);
    assert_eq!(apart(&raw(1, Some(1000)), &raw(2, Some(900))), None);
}

/// The kernel's own test device. It has no exposure time, so that it is taken as far as a driver of
/// it can be: set up, and three whole frames.
#[test]
fn the_kernel_s_test_device_sends_whole_frames() {
    let Some(vivid) = scan().into_iter().find(|camera| camera.fake) else {
        println!("SKIPPED: no /dev/video* of the driver vivid (modprobe vivid)");
        return;
    };
    let node = Node::open(Path::new(&vivid.id)).unwrap();
    let offers: Vec<_> =
        node.formats().unwrap().into_iter().map(|c| (c, node.sizes(c).unwrap())).collect();
    let (format, size) = format::choose(&offers, Some("GREY"), None).unwrap();
    let layout = node.set_format(format.number(), size).unwrap();
    let stream = Stream::start(&node).unwrap();
    for _ in 0..3 {
        let raw = stream.next(Duration::from_secs(5)).unwrap();
        let values = format.decode(&layout, &raw.bytes).unwrap();
        assert_eq!(values.len(), (layout.width * layout.height) as usize);
        // A test picture is not even.
        assert!(values.iter().any(|v| *v != values[0]));
    }
    drop(stream);
    let error = open(None, Some(&vivid.id));
    assert!(error.to_string().contains("exposure"), "{error}");
}
