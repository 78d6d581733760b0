//! The camera driver for GenICam against a camera of our own on the loopback interface, and
//! against Aravis' fakes: discovery, control and pictures over real packets.
#![cfg(all(feature = "aravis", target_os = "linux"))]

mod common;

use std::fs::File;
use std::time::{Duration, Instant};

use common::TestCamera;
use rig::devices::camera::{Aravis, CameraChoice, CameraDriver, GenicamSettings};
use rig::{Camera, DeviceError, DeviceErrorKind, Frame};
use simulator::devices::{GigeCamera, GigeFault};

/// One camera only can be served at an address: these tests, and other runs of them, wait for each
/// other.
fn alone() -> File {
    let path = std::env::temp_dir().join("diaphane-gige-tests.lock");
    let file = File::options().create(true).truncate(false).write(true).open(path).unwrap();
    file.lock().unwrap();
    file
}

fn serve(camera: TestCamera, serial: &str) -> GigeCamera {
    GigeCamera::serve(Box::new(camera), "lo", serial).unwrap()
}

fn settings(serial: &str) -> GenicamSettings {
    let choice = CameraChoice { serial: Some(serial.into()), ..CameraChoice::default() };
    GenicamSettings { choice, ..GenicamSettings::default() }
}

fn open(serial: &str) -> Aravis {
    Aravis::open(settings(serial)).unwrap()
}

/// What the camera itself would have given.
fn direct(camera: &TestCamera, exposure_s: f64) -> Frame {
    camera.clone().expose(exposure_s).unwrap()
}

#[test]
fn exact_values_come_through_and_exposures_are_those_that_were() {
    let _alone = alone();
    for (channels, bit_depth) in [(3, 16), (3, 12), (1, 16), (1, 10), (1, 8)] {
        let camera = TestCamera::new(100, 70, channels, bit_depth);
        let _served = serve(camera.clone(), "EXACT1");
        let mut driver = open("EXACT1");
        let info = driver.info();
        assert_eq!([info.width, info.height], [100, 70]);
        assert_eq!((info.channels, info.bit_depth), (channels, bit_depth));
        assert!(info.name.starts_with("Diaphane test camera"), "{}", info.name);
        // The camera counts whole microseconds.
        for (asked_s, is_s) in [(1.0 / 30.0, 0.033333), (0.25, 0.25), (8.0, 8.0), (1e-4, 1e-4)] {
            let frame = driver.expose(asked_s).unwrap();
            assert_eq!(frame.exposure_s, is_s);
            assert!(frame == direct(&camera, is_s), "{channels} channels, {bit_depth} bits");
        }
        let told = driver.readback().unwrap();
        assert_eq!(told.settings["ExposureTime"], "100 us");
        assert_eq!(told.settings["Trigger"], "software");
        assert_eq!(told.temperature_c, None);
        assert!(!told.settings.contains_key("frames retaken"));
    }
}

#[test]
fn a_part_of_the_sensor_its_temperature_and_what_it_cannot() {
    let _alone = alone();
    let camera = TestCamera { temperature_c: Some(41.25), ..TestCamera::new(100, 70, 3, 16) };
    let served = serve(camera.clone(), "PART1");
    let part = |roi| GenicamSettings { roi: Some(roi), ..settings("PART1") };
    let mut driver = Aravis::open(part([20, 10, 60, 40])).unwrap();
    let frame = driver.expose(0.01).unwrap();
    let all = direct(&camera, 0.01);
    assert_eq!([frame.width, frame.height], [30, 20]);
    for (y, row) in frame.data.chunks(90).enumerate() {
        let from = ((y + 5) * 100 + 10) * 3;
        assert_eq!(row, &all.data[from..from + 90], "row {y}");
    }
    let celsius = driver.readback().unwrap().temperature_c.unwrap();
    // Told in thousandths.
    assert!((celsius - 41.25).abs() < 1e-3, "{celsius}");
    let kind = |outcome: Result<Frame, DeviceError>| outcome.err().unwrap().kind();
    for exposure_s in [0.0, -1.0, 1e-7, 3600.0, f64::NAN, f64::INFINITY] {
        assert_eq!(kind(driver.expose(exposure_s)), DeviceErrorKind::Unsupported, "{exposure_s}");
    }
    // What it cannot do does not cost the connection.
    driver.expose(0.01).unwrap();
    drop(driver);
    let refused = |settings: GenicamSettings, word: &str| {
        let error = Aravis::open(settings).err().unwrap();
        assert_eq!(error.kind(), DeviceErrorKind::Unsupported, "{error}");
        assert!(error.to_string().contains(word), "{error}");
    };
    refused(part([0, 0, 300, 40]), "200 x 140");
    refused(part([u32::MAX, 0, 20, 20]), "200 x 140");
    refused(GenicamSettings { gain: Some(3.0), ..settings("PART1") }, "no gain");
    let format = Some("Mono8".to_owned());
    refused(GenicamSettings { pixel_format: format, ..settings("PART1") }, "BayerRG16");
    assert!(served.failure().is_none());
}

#[test]
fn a_name_that_fits_two_and_one_that_fits_none() {
    let _alone = alone();
    let on_the_wire = aravis::GvFakeCamera::new(Some("lo"), Some("TWO1"));
    assert!(on_the_wire.is_running());
    // SAFETY: a text that ends, and a switch that any thread may use.
    unsafe { aravis_sys::arv_enable_interface(c"Fake".as_ptr()) };
    let by_name = |name: &str| {
        let choice = CameraChoice { name: Some(name.into()), ..CameraChoice::default() };
        Aravis::open(GenicamSettings { choice, ..GenicamSettings::default() }).err().unwrap()
    };
    let error = by_name("aravis fake");
    assert_eq!(error.kind(), DeviceErrorKind::Ambiguous, "{error}");
    assert!(error.to_string().contains("TWO1"), "{error}");
    let error = by_name("Basler");
    assert_eq!(error.kind(), DeviceErrorKind::NotFound);
    assert!(error.to_string().contains("TWO1"), "{error}");
    let found = CameraDriver::Aravis.scan();
    let listed = found.iter().filter(|camera| camera.fake).count();
    assert!(listed >= 2, "{found:?}");
    // SAFETY: as above.
    unsafe { aravis_sys::arv_disable_interface(c"Fake".as_ptr()) };
}

#[test]
fn a_camera_that_another_program_has_is_busy() {
    let _alone = alone();
    let _served = serve(TestCamera::new(16, 16, 1, 8), "BUSY1");
    let mut first = open("BUSY1");
    let error = Aravis::open(settings("BUSY1")).err().unwrap();
    assert_eq!(error.kind(), DeviceErrorKind::Busy, "{error}");
    first.expose(0.01).unwrap();
    drop(first);
    open("BUSY1").expose(0.01).unwrap();
    // Nor can two be served at one address.
    let second = GigeCamera::serve(Box::new(TestCamera::new(16, 16, 1, 8)), "lo", "BUSY2");
    assert_eq!(second.err().unwrap().kind(), DeviceErrorKind::Busy);
}

/// Longer than any call may take: an exposure of 10 ms, 3 s for the transfer, six questions that
/// nobody answers (2.5 s each), a look around (1 s), and as much again for a slow machine.
const BOUND: Duration = Duration::from_secs(40);

#[test]
fn a_camera_that_goes_away_is_disconnected_and_found_again() {
    let _alone = alone();
    let camera = TestCamera::new(40, 30, 3, 16);
    let served = serve(camera.clone(), "GONE1");
    let mut driver = open("GONE1");
    driver.expose(0.01).unwrap();
    drop(served);
    for _ in 0..2 {
        let started = Instant::now();
        let error = driver.expose(0.01).err().unwrap();
        assert_eq!(error.kind(), DeviceErrorKind::Disconnected, "{error}");
        assert!(started.elapsed() < BOUND);
    }
    assert_eq!(driver.readback().unwrap_err().kind(), DeviceErrorKind::Disconnected);
    // Another camera is not that camera.
    let other = serve(camera.clone(), "OTHER1");
    assert_eq!(driver.expose(0.01).err().unwrap().kind(), DeviceErrorKind::Disconnected);
    drop(other);
    let back = serve(camera.clone(), "GONE1");
    assert!(driver.expose(0.01).unwrap() == direct(&camera, 0.01));
    drop(back);
    // The same one, but with another sensor: its frames would not fit those before.
    let _changed = serve(TestCamera::new(40, 32, 3, 16), "GONE1");
    let error = driver.expose(0.01).err().unwrap();
    // Whether the old connection is noticed to be dead first depends on who looks first.
    let error = match error.kind() {
        DeviceErrorKind::Fault => error,
        _ => driver.expose(0.01).err().unwrap(),
    };
    assert_eq!(error.kind(), DeviceErrorKind::Fault, "{error}");
}

#[test]
fn frames_with_holes_are_taken_again_and_never_passed_on() {
    let _alone = alone();
    let camera = TestCamera::new(100, 70, 3, 16);
    let served = serve(camera.clone(), "HOLES1");
    let mut driver = open("HOLES1");
    driver.expose(0.01).unwrap();
    // 44 packets a frame: four of ten frames arrive as a whole.
    served.set_fault(Some(GigeFault::Lose(0.02)));
    let (mut whole, mut retaken) = (0, 0);
    for _ in 0..10 {
        match driver.expose(0.01) {
            Ok(frame) => {
                assert!(frame == direct(&camera, 0.01));
                whole += 1;
                let told = driver.readback().unwrap();
                retaken += told.settings.get("frames retaken").map_or(0, |n| n.parse().unwrap());
            }
            Err(error) => assert!(error.kind().is_transient(), "{error}"),
        }
    }
    println!("{whole} of 10 frames, {retaken} more were taken");
    // The same packets are lost each time; by chance that none were had odds of 1 to 7,000.
    assert!(whole > 0 && retaken > 0);
    served.set_fault(Some(GigeFault::Lose(1.0)));
    let error = driver.expose(0.01).err().unwrap();
    assert_eq!(error.kind(), DeviceErrorKind::Timeout, "{error}");
    // Whole packets that say something else than the camera was set to.
    for fault in [GigeFault::OtherSize, GigeFault::OtherFormat] {
        served.set_fault(Some(fault));
        let error = driver.expose(0.01).err().unwrap();
        assert_eq!(error.kind(), DeviceErrorKind::Protocol, "{fault:?}: {error}");
    }
    served.set_fault(None);
    assert!(driver.expose(0.01).unwrap() == direct(&camera, 0.01));
    // A camera that takes no picture is a camera that does not answer; why is known where it is.
    drop(driver);
    drop(served);
    let served = serve(TestCamera { fails: true, ..camera }, "HOLES1");
    let error = open("HOLES1").expose(0.01).err().unwrap();
    assert_eq!(error.kind(), DeviceErrorKind::Timeout, "{error}");
    assert_eq!(served.failure().unwrap().kind(), DeviceErrorKind::Fault);
}

#[test]
fn without_a_software_trigger_single_frames_are_taken() {
    let _alone = alone();
    // Aravis' own description of its fake, without that command.
    let like = aravis::GvFakeCamera::new(Some("lo"), Some("SINGLE0"));
    let (xml, size) = like.fake_camera().unwrap().genicam_xml();
    let xml = xml.as_str()[..size].replace("\"TriggerSoftware\"", "\"TriggerOtherwise\"");
    drop(like);
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), xml).unwrap();
    let fake = aravis::GvFakeCamera::new_full(Some("lo"), Some("SINGLE1"), file.path().to_str());
    assert!(fake.is_running());
    let with_gain = |gain| {
        let roi = Some([0, 0, 64, 48]);
        Aravis::open(GenicamSettings { roi, gain: Some(gain), ..settings("SINGLE1") }).unwrap()
    };
    let mut driver = with_gain(0.0);
    // The deepest of what that fake has.
    let info = driver.info();
    assert_eq!((info.channels, info.bit_depth), (1, 16));
    for _ in 0..3 {
        // Its ramp is as steep as 256 codes a pixel at this exposure, and begins anew at 65535.
        let frame = driver.expose(0.01).unwrap();
        assert_eq!([frame.width, frame.height], [64, 48]);
        let wrapped = |pair: &[u16]| (u32::from(pair[1]) + 65535 - u32::from(pair[0])) % 65535;
        assert!(frame.data[..64].windows(2).all(|pair| wrapped(pair) == 256));
        let told = driver.readback().unwrap();
        assert_eq!(told.settings["Trigger"], "single frame");
        assert_eq!(told.settings["GainAuto"], "Off");
        assert_eq!(told.settings["Gain"], "0");
        assert_eq!(told.settings["PixelFormat"], "Mono16");
    }
    drop(driver);
    assert_eq!(with_gain(2.0).readback().unwrap().settings["Gain"], "2");
}
