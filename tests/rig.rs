//! `diaphane rig`: devices that are there, that are not, and that misbehave.
#![cfg(unix)]

mod common;
#[cfg(all(feature = "gphoto2", target_os = "linux"))]
#[path = "../raw/tests/common/dng.rs"]
mod dng;

use common::diaphane;
use rig::devices::{
    Coordinate, Millimetres, PowerState, ProjectorControl, Range, StageAxis, power_on,
};
use simulator::devices::{
    EpsonEmulator, GrblEmulator, PjlinkEmulator, ProjectorSpec, Prompt, SimulatedProjector,
    SimulatedStage, StageFailure, Wire, ZaberEmulator,
};
use std::path::{Path, PathBuf};
use tempfile::{TempDir, tempdir};

fn rig_file(text: &str) -> (TempDir, PathBuf) {
    let folder = tempdir().unwrap();
    let path = folder.path().join("rig.toml");
    std::fs::write(&path, format!("version = 1\n{text}")).unwrap();
    (folder, path)
}

fn rig(command: &str, path: &Path, flags: &[&str]) -> common::Run {
    let arguments = ["rig", command].into_iter().map(Into::into);
    let arguments = arguments.chain([path.as_os_str().to_owned()]);
    diaphane(arguments.chain(flags.iter().map(Into::into)))
}

const SIMULATED: &str = r#"
[camera]
driver = "simulated"
[projector.display]
driver = "simulated"
[projector.control]
driver = "simulated"
[stage]
driver = "simulated"
axes = [{ name = "x", unit = "mm", range = [0.0, 50.0] }]
"#;

#[test]
fn a_simulated_rig_is_fake_and_passes() {
    let (_folder, path) = rig_file(SIMULATED);
    let run = rig("list", &path, &[]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let devices = run.json["devices"].as_array().unwrap();
    assert_eq!(devices.len(), 4);
    assert!(devices.iter().all(|d| d["state"] == "fake"), "{}", run.json);

    let run = rig("test", &path, &["--power", "--home"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(run.json["pass"], true);
    assert_eq!(result(&run, "projector control", "mute"), "pass", "{}", run.json);
    // The camera of the same rig sees the projector's white.
    assert_eq!(result(&run, "projector", "white"), "pass", "{}", run.json);
    assert_eq!(result(&run, "camera", "brightness"), "pass", "{}", run.json);
    let picture = path.with_file_name("rig-test-1.png");
    assert_eq!(run.json["picture"], picture.to_str().unwrap());
    let seen = image::open(&picture).unwrap().to_rgb8();
    let bright = seen.pixels().filter(|pixel| pixel.0.iter().any(|&v| v > 200)).count();
    assert!(bright > 1000, "the lit sample is not in the picture: {bright}");
}

/// How a check of a part went.
fn result(run: &common::Run, part: &str, check: &str) -> String {
    let devices = run.json["devices"].as_array().unwrap();
    let device = devices.iter().find(|device| device["part"] == part).unwrap();
    let checks = device["checks"].as_array().unwrap();
    let check = checks.iter().find(|there| there["name"] == check).unwrap();
    check["result"].as_str().unwrap().to_owned()
}

#[test]
fn pictures_of_tests_are_numbered_and_none_is_replaced() {
    let (folder, path) = rig_file("[camera]\ndriver = \"simulated\"");
    for number in 1..=2 {
        assert_eq!(rig("test", &path, &[]).code, 0);
        assert!(folder.path().join(format!("rig-test-{number}.png")).is_file());
    }
    let named = folder.path().join("look.png");
    let named = named.to_str().unwrap();
    assert_eq!(rig("test", &path, &["--picture", named]).code, 0);
    let again = rig("test", &path, &["--picture", named]);
    assert_eq!(again.code, 2, "{}", again.stderr);
    assert_eq!(rig("test", &path, &["--picture", named, "--force"]).code, 0);
}

#[test]
fn parking_moves_the_stage_and_switches_the_projector_off() {
    let mut lamp = projector();
    power_on(&mut lamp, std::time::Duration::from_secs(30), &mut |_, _| true).unwrap();
    let network = Wire::tcp(0, PjlinkEmulator::new(lamp.clone(), None)).unwrap();
    let stage = slide();
    let serial = Wire::serial(ZaberEmulator::new(stage.clone(), 0.001)).unwrap();
    let (_folder, path) = rig_file(&format!(
        "[projector.control]\ndriver = \"pjlink\"\nhost = \"127.0.0.1\"\nport = {}\n\
         [stage]\ndriver = \"zaber\"\nport = {:?}\n\
         axes = [{{ name = \"x\", unit = \"mm\", range = [0.0, 50.0], park = 2.5, device = 1, step = 0.001 }}]\n",
        network.port().unwrap(),
        serial.address()
    ));
    // A stage that does not know where it is cannot be parked; the projector waits for it.
    let run = rig("park", &path, &[]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    let again = format!("diaphane rig park {} --home", path.display());
    assert!(run.json["hint"].as_str().unwrap().contains(&again), "{}", run.json);
    assert_eq!(lamp.power_state().unwrap(), PowerState::On);
    let run = rig("park", &path, &["--home"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(stage.at(0), 2.5);
    assert_eq!(lamp.power_state().unwrap(), PowerState::Off);
    assert_eq!(rig("halt", &path, &[]).code, 0);
    let (_folder, path) = rig_file("[camera]\ndriver = \"simulated\"\n");
    assert_eq!(rig("park", &path, &[]).code, 2);
    assert_eq!(rig("halt", &path, &[]).code, 2);
}

fn projector() -> SimulatedProjector {
    let warm_up = std::time::Duration::from_millis(200);
    SimulatedProjector::new(ProjectorSpec { warm_up, ..ProjectorSpec::default() })
}

fn slide() -> SimulatedStage {
    let range = Range::Linear(Millimetres(0.0), Millimetres(50.0));
    let park = Some(Coordinate::Linear(Millimetres(0.0)));
    SimulatedStage::new(vec![StageAxis { name: "x".into(), range, park }], 50.0)
}

fn grbl(wire: &Wire) -> String {
    format!(
        "[stage]\ndriver = \"grbl\"\nport = {:?}\n\
         axes = [{{ name = \"x\", unit = \"mm\", range = [0.0, 50.0], letter = \"X\" }}]\n",
        wire.address()
    )
}

#[test]
fn devices_behind_their_protocols_are_found_and_tested() {
    let mut lamp = projector();
    let network = Wire::tcp(0, PjlinkEmulator::new(lamp.clone(), Some("secret"))).unwrap();
    let stage = slide();
    let serial = Wire::serial(GrblEmulator::new(stage.clone())).unwrap();
    let (_folder, path) = rig_file(&format!(
        "[projector.control]\ndriver = \"pjlink\"\nhost = \"127.0.0.1\"\nport = {}\n\
         password = \"secret\"\ninput = \"31\"\n{}",
        network.port().unwrap(),
        grbl(&serial)
    ));
    // The board is locked until it has been homed, as real ones are, which is no trouble.
    let run = rig("list", &path, &[]);
    assert_eq!((run.code, &run.json["ready"]), (0, &true.into()), "{}", run.stderr);
    assert_eq!(run.json["devices"][0]["state"], "found", "{}", run.json);
    assert_eq!(run.json["devices"][1]["state"], "needs-homing", "{}", run.json);
    let command = format!("diaphane rig test {} --home", path.display());
    let advice = run.json["devices"][1]["advice"].as_str().unwrap();
    assert!(advice.contains(&command) && run.stderr.contains(&command), "{}", run.stderr);
    // But it cannot be moved before, and what to type is said with the path of this file.
    let run = rig("test", &path, &["--power"]);
    assert_eq!((run.code, &run.json["pass"]), (1, &false.into()), "{}", run.stderr);
    assert!(run.json["hint"].as_str().unwrap().contains(&command), "{}", run.json);

    let run = rig("test", &path, &["--power", "--home"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(lamp.power_state().unwrap(), PowerState::On);
    assert_eq!(lamp.input(), "31");
    assert_eq!(stage.at(0), 0.0);

    let run = rig("halt", &path, &[]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    stage.fail(StageFailure::HitLimit);
    let run = rig("test", &path, &["--home"]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(run.stderr.contains("limit switch"), "{}", run.stderr);
    assert_eq!(run.json["pass"], false);
}

/// One camera only can be served at an address, as in the simulator's own tests, which wait for the
/// same file.
#[cfg(all(feature = "aravis", target_os = "linux"))]
fn alone() -> std::fs::File {
    let path = std::env::temp_dir().join("diaphane-gige-tests.lock");
    let options = std::fs::File::options().create(true).truncate(false).write(true).open(path);
    let file = options.unwrap();
    file.lock().unwrap();
    file
}

#[cfg(all(feature = "aravis", target_os = "linux"))]
#[test]
fn a_camera_on_the_network_is_listed_and_tested() {
    use simulator::devices::GigeCamera;
    let _alone = alone();
    let sample = simulator::SampleSpec { kind: simulator::SampleKind::Wax, seed: 1 };
    let devices = simulator::SimulatedRig::new(&sample, material::Face::Back).unwrap().rig();
    let _served = GigeCamera::serve(devices.camera, "lo", "LIST1").unwrap();
    let text = |serial| format!("[camera]\ndriver = \"aravis\"\nserial = \"{serial}\"");
    let (_folder, path) = rig_file(&text("LIST1"));
    let run = rig("list", &path, &[]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert_eq!(run.json["devices"][0]["state"], "fake");
    // A machine that is busy elsewhere loses packets, and `rig test` is right to say so: then once more.
    let lossless = |run: &common::Run| result(run, "camera", "transfer") == "pass";
    let mut run = rig("test", &path, &[]);
    for _ in 0..3 {
        if !lossless(&run) {
            run = rig("test", &path, &[]);
        }
    }
    assert_eq!(run.code, 0, "{}", run.stderr);
    for check in ["1/30 s", "0.25 s", "transfer"] {
        assert_eq!(result(&run, "camera", check), "pass", "{}", run.json);
    }
    // The projector shows black, which is not dark.
    assert_eq!(result(&run, "camera", "brightness"), "pass", "{}", run.json);
    assert!(Path::new(run.json["picture"].as_str().unwrap()).is_file());

    let all = diaphane(["rig", "list"]);
    let found = all.json["devices"].as_array().unwrap();
    assert!(
        found.iter().any(|device| device["state"] == "fake"
            && device["found"].as_str().unwrap().contains("LIST1"))
    );

    let (_folder, path) = rig_file(&text("OTHER"));
    let run = rig("list", &path, &[]);
    assert_eq!((run.code, &run.json["devices"][0]["state"]), (1, &"not-found".into()));
    assert!(run.stderr.contains("LIST1"), "those that are there are named: {}", run.stderr);
}

/// A Nikon that PyPI's package gphoto2 plays on a USB bus of its own; it returns stored pictures.
#[cfg(all(feature = "gphoto2", target_os = "linux"))]
#[test]
fn a_virtual_still_camera_is_listed_and_tested() {
    let Some(python) = std::env::var_os("DIAPHANE_PYTHON") else {
        println!("SKIPPED: DIAPHANE_PYTHON names no Python with gphoto2 (cargo xtask peers)");
        return;
    };
    let told = std::process::Command::new(python)
        .args(["-c", "import gphoto2; print(gphoto2.__path__[0] + '/libgphoto2/vusb')"])
        .output()
        .unwrap();
    let bus = String::from_utf8(told.stdout).unwrap().trim().to_owned();
    assert!(Path::new(&bus).is_dir(), "{bus}: {}", String::from_utf8_lossy(&told.stderr));
    let text = |aperture| {
        format!("[camera]\ndriver = \"gphoto2\"\nname = \"d750\"\naperture = \"{aperture}\"")
    };
    let (folder, path) = rig_file(&text("f/8"));
    let pictures = folder.path().join("card/DCIM/100NIKON");
    std::fs::create_dir_all(&pictures).unwrap();
    let ramp = image::RgbImage::from_fn(96, 64, |x, y| image::Rgb([2 * x as u8, 3 * y as u8, 128]));
    ramp.save(pictures.join("DSC_0001.JPG")).unwrap();
    let run = |command: &str, path: &Path| {
        let out = std::process::Command::new(env!("CARGO_BIN_EXE_diaphane"))
            .args(["--json", "rig", command])
            .arg(path)
            .env("IOLIBS", &bus)
            .env("VCAMERADIR", folder.path().join("card"))
            .output()
            .unwrap();
        let stderr = String::from_utf8(out.stderr).unwrap();
        assert!(!stderr.contains("panicked"), "{stderr}");
        let json = serde_json::from_slice(&out.stdout).unwrap();
        common::Run { code: out.status.code().unwrap(), json, stderr }
    };
    let listed = run("list", &path);
    assert_eq!(listed.code, 0, "{}", listed.stderr);
    let found = listed.json["devices"][0]["found"].as_str().unwrap();
    assert!(found.contains("D750, 96 x 64 pixels, colour, 8 bits"), "{found}");
    // It offers 1/20 s where 1/30 s is asked for, which is told; and a whole second.
    let tested = run("test", &path);
    assert_eq!(tested.code, 1, "{}", tested.stderr);
    assert_eq!(result(&tested, "camera", "1/30 s"), "fail", "{}", tested.json);
    assert_eq!(result(&tested, "camera", "1 s"), "pass", "{}", tested.json);
    let seen = image::open(tested.json["picture"].as_str().unwrap()).unwrap().to_rgb8();
    assert_eq!(seen.dimensions(), (96, 64));
    let red = |x| i32::from(seen.get_pixel(x, 32).0[0]);
    assert!(red(90) > red(50) + 20 && red(50) > red(10) + 20, "the ramp is not in the picture");
    // It serves whatever its card has by the name of a JPEG: a raw file of 14 bits.
    let dng = dng::Dng {
        width: 96,
        height: 64,
        codes: (0..96 * 64).map(|i| 600 + 100 * (i % 96)).collect(),
        filter: (2, vec![0, 1, 1, 2]),
        black: [512; 4],
        white: 16_383,
        active: [0, 0, 64, 96],
        exposure: (1, 20),
    };
    std::fs::write(pictures.join("DSC_0001.JPG"), dng.bytes()).unwrap();
    let listed = run("list", &path);
    assert_eq!(listed.code, 0, "{}", listed.stderr);
    let found = listed.json["devices"][0]["found"].as_str().unwrap();
    assert!(found.contains("D750, 48 x 32 pixels, colour, 14 bits"), "{found}");
    // What it does not have is named with what it has.
    let (_other, path) = rig_file(&text("f/1"));
    let refused = run("list", &path);
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("f/22"), "{}", refused.stderr);
}

#[test]
fn what_is_in_the_way_is_told_apart() {
    let wire = Wire::serial(EpsonEmulator::new(projector(), Prompt::AtOnce)).unwrap();
    let epson = |port: &str| {
        rig_file(&format!("[projector.control]\ndriver = \"epson\"\nport = {port:?}\n"))
    };
    let state = |path: &Path| {
        let run = rig("list", path, &[]);
        (run.json["devices"][0]["state"].as_str().unwrap().to_owned(), run.code)
    };
    let (_folder, path) = epson(wire.address());
    assert_eq!(state(&path), ("found".to_owned(), 0));
    let mut held =
        rig::devices::Epson::new(wire.address(), 9600, rig::devices::Patience::default());
    held.power_state().unwrap();
    assert_eq!(state(&path), ("busy".to_owned(), 1));
    let (_folder, path) = epson("/dev/there-is-no-such-port");
    assert_eq!(state(&path), ("not-found".to_owned(), 1));
}

#[test]
fn rig_files_that_are_wrong_are_refused() {
    let (_folder, path) = rig_file("[camera]\ndriver = \"simulated\"\nshutter = 1\n");
    for command in ["list", "test"] {
        let run = rig(command, &path, &[]);
        assert_eq!(run.code, 2, "{}", run.stderr);
        assert!(run.json["error"].as_str().unwrap().contains("shutter"), "{}", run.json);
        assert!(run.json["hint"].as_str().unwrap().contains("docs/devices.md"), "{}", run.json);
    }
    assert_eq!(rig("list", &path.with_file_name("none.toml"), &[]).code, 2);
    // Whatever ports this machine has; nothing is asked for, so that nothing is ready or not.
    let run = diaphane(["rig", "list"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.json["devices"].is_array() && run.json.get("ready").is_none(), "{}", run.json);
}

#[test]
fn every_device_that_is_broken_has_its_hint_and_ready_is_the_exit_code() {
    // Nobody listens at the port: it was bound, and closed again.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let (_folder, path) = rig_file(&format!(
        "[projector.control]\ndriver = \"pjlink\"\nhost = \"127.0.0.1\"\nport = {port}\n\
         [hands]\ndriver = \"program\"\nprogram = \"/there/is/no/such/program\"\n\
         [stage]\ndriver = \"zaber\"\nport = \"/dev/there-is-no-such-port\"\n\
         axes = [{{ name = \"x\", unit = \"mm\", range = [0.0, 50.0], device = 1, step = 0.001 }}]\n"
    ));
    for (command, good) in [("list", "ready"), ("test", "pass")] {
        let run = rig(command, &path, &[]);
        assert_eq!((run.code, &run.json[good]), (1, &false.into()), "{}", run.stderr);
        let hint = run.json["hint"].as_str().unwrap();
        for (device, words) in [
            ("projector control", "network control"),
            ("stage", "is it plugged in"),
            ("hands", "full path"),
        ] {
            let line = hint.lines().find(|line| line.starts_with(&format!("{device}: ")));
            assert!(line.is_some_and(|line| line.contains(words)), "{command}, {device}: {hint}");
        }
        assert_eq!(hint.lines().count(), 3, "{hint}");
    }
}

/// What a session on devices was made with, and what the others do not have.
#[test]
fn the_folder_of_a_session_stands_for_its_rig_file() {
    let (folder, path) = rig_file(SIMULATED);
    let session = folder.path().join("on-devices");
    let made = diaphane([
        "init".as_ref(),
        session.as_os_str(),
        "--rig".as_ref(),
        path.as_os_str(),
        "--size".as_ref(),
        "18x18x4.5".as_ref(),
        "--cells".as_ref(),
        "40x40x10".as_ref(),
        "--board".as_ref(),
        "8x5".as_ref(),
        "--square".as_ref(),
        "2".as_ref(),
    ]);
    assert_eq!(made.code, 0, "{}", made.stderr);
    for command in ["list", "test", "park", "halt"] {
        let run = rig(command, &session, &[]);
        assert_eq!(run.code, 0, "{command}: {}", run.stderr);
    }
    assert!(session.join("rig-test-1.png").is_file());

    let simulated = folder.path().join("simulated");
    let made = diaphane(["init".as_ref(), simulated.as_os_str()]);
    assert_eq!(made.code, 0, "{}", made.stderr);
    for (folder, words) in [(simulated.as_path(), "is simulated"), (folder.path(), "rig.toml")] {
        std::fs::remove_file(&path).unwrap_or_default();
        for command in ["list", "test", "park", "halt"] {
            let run = rig(command, folder, &[]);
            let error = run.json["error"].as_str().unwrap();
            assert!(run.code == 2 && error.contains(words), "{command}: {error}");
        }
    }
}

/// A twin that cannot be leaves nothing behind.
#[cfg(all(feature = "aravis", feature = "display", target_os = "linux"))]
#[test]
fn a_twin_that_does_not_start_leaves_no_folder() {
    let folder = tempdir().unwrap();
    let twin = folder.path().join("twin");
    let run = rig("twin", &twin, &["--monitor", "there-is-no-such-monitor"]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    assert!(!twin.exists());
}
