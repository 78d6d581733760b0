//! A session on the devices of a rig file, all of them in software.

mod common;

use common::{diaphane, tiny_session};
use serde_json::Value;
use std::path::Path;

const RIG: &str = r#"
version = 1

[camera]
driver = "simulated"

[projector.display]
driver = "simulated"

[projector.control]
driver = "simulated"

[hands]
driver = "simulated"

[stage]
driver = "simulated"
axes = [{ name = "slide", unit = "mm", range = [0.0, 100.0], park = 1.0 }]

[[places]]
target = "away"
at = { slide = 2.0 }
"#;

fn step(arguments: &[&str]) -> Value {
    let run = diaphane(arguments);
    assert_eq!(run.code, 0, "{arguments:?}: {}", run.stderr);
    run.json
}

fn init(folder: &Path, rig: &str) -> common::Run {
    std::fs::write(folder.join("rig.toml"), rig).unwrap();
    let (rig, session) = (folder.join("rig.toml"), folder.join("devices"));
    diaphane([
        "init",
        session.to_str().unwrap(),
        "--rig",
        rig.to_str().unwrap(),
        "--size",
        "18x18x4.5",
        "--cells",
        "40x40x10",
        "--board",
        "8x5",
        "--square",
        "2",
    ])
}

/// The rig file names the simulated rig around the demo's block: the frames are the same as those
/// of the session on the simulated rig itself.
#[test]
fn the_rig_file_s_devices_take_the_pictures_of_the_session() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let made = init(folder.path(), RIG);
    assert_eq!(made.code, 0, "{}", made.stderr);
    let (devices, direct) = (path("devices"), path("direct"));
    let (devices, direct) = (devices.to_str().unwrap(), direct.to_str().unwrap());
    step(&["init", direct, "--seed", "1"]);
    // The session has a copy: what happens to the original does not matter.
    std::fs::remove_file(path("rig.toml")).unwrap();

    let plan = step(&["plan", devices]);
    assert_eq!(plan["timing"]["frames"], 0);
    let warned = plan["warnings"].to_string();
    assert!(warned.contains("the lamp may be cold (no capture so far)"), "{warned}");
    step(&["capture", devices, "--noise"]);
    step(&["capture", direct, "--noise"]);
    for file in ["noise-dark/noise-dark-e3-r1.png", "noise-flat/noise-flat-e7-r0.png"] {
        let read = |session: &str| std::fs::read(Path::new(session).join("frames").join(file));
        assert!(read(devices).unwrap() == read(direct).unwrap(), "{file} differs");
    }

    // What it took is what the next plan expects.
    let plan = step(&["plan", devices]);
    assert!(plan["timing"]["frames"].as_u64().unwrap() > 30, "{plan}");
    assert!(plan["timing"]["per_frame_s"].as_f64().unwrap() < 5.0, "{plan}");
    assert_eq!(plan["warnings"].as_array().unwrap().len(), 0, "{plan}");
    let other = path("other");
    let other = other.to_str().unwrap();
    step(&["init", other, "--seed", "2"]);
    let learned = step(&["plan", other, "--past", devices]);
    assert_eq!(learned["timing"]["frames"], plan["timing"]["frames"]);
}

/// A rig that cannot take pictures, and nobody to put things on the bench.
#[test]
fn what_a_session_on_devices_lacks_is_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let no_camera = RIG.replace("[camera]\ndriver = \"simulated\"\n", "");
    let made = init(folder.path(), &no_camera);
    assert!(made.code == 2 && made.stderr.contains("[camera]"), "{}", made.stderr);
    assert!(!folder.path().join("devices").exists());

    let nobody = RIG.replace("[hands]\ndriver = \"simulated\"\n", "");
    let made = init(folder.path(), &nobody);
    assert_eq!(made.code, 0, "{}", made.stderr);
    let session = folder.path().join("devices");
    let run = diaphane(["capture", session.to_str().unwrap(), "--noise"]);
    assert_eq!(run.code, 1, "{}", run.stderr);
    let error = run.json["error"].as_str().unwrap();
    assert!(error.contains("the cap on the lens") && error.contains("[hands]"), "{error}");

    // A program that is not there is missed before anything is made.
    let hands = "driver = \"program\"\nprogram = \"/there/is/no/such/program\"";
    let missing = RIG.replace("[hands]\ndriver = \"simulated\"", &format!("[hands]\n{hands}"));
    std::fs::remove_dir_all(&session).unwrap();
    let made = init(folder.path(), &missing);
    assert!(made.code == 1 && made.stderr.contains("no/such/program"), "{}", made.stderr);
    assert!(!session.exists());

    let elsewhere = RIG.replace("slide = 2.0", "slide = 200.0");
    let made = init(folder.path(), &elsewhere);
    assert!(made.code == 2 && made.stderr.contains("places[0].at.slide"), "{}", made.stderr);
}

/// A plan that was changed in the middle is refused, and a branch goes on with it.
#[test]
fn a_changed_plan_goes_on_in_a_branch() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (session, branch) = (path("session"), path("branch"));
    tiny_session(&session, &[], "");
    step(&["capture", &session]);
    let file = Path::new(&session).join("session.toml");
    let before = std::fs::read_to_string(&file).unwrap();
    let changed = before.replace("board_exposure_s = 0.03", "board_exposure_s = 0.04");
    assert_ne!(before, changed);
    std::fs::write(&file, &changed).unwrap();
    let refused = diaphane(["capture", &session]);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    let hint = refused.json["hint"].as_str().unwrap();
    assert!(hint.contains("diaphane branch"), "{hint}");

    // Chart and sheet fit; boards and planes have another exposure.
    let made = step(&["branch", &session, &branch]);
    assert_eq!(made["carried"], 6 + 4 * 2);
    let taken = step(&["capture", &branch]);
    assert_eq!((&taken["taken"], &taken["kept"]), (&(12 + 2).into(), &(6 + 4 * 2).into()));
    // Not into a folder where something is.
    assert_eq!(diaphane(["branch", &session, &branch]).code, 2);

    std::fs::write(&file, before).unwrap();
    let back = step(&["capture", &session]);
    assert_eq!((&back["taken"], &back["kept"]), (&0.into(), &(12 + 2 + 6 + 4 * 2).into()));
}

/// The second Ctrl-C puts the devices away, whatever the first is still waiting for.
#[test]
#[cfg(unix)]
fn a_second_ctrl_c_puts_the_devices_away() {
    use std::io::Read;
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};
    let folder = tempfile::tempdir().unwrap();
    // Hands that never come: the capture waits for them.
    let script = folder.path().join("hands.sh");
    std::fs::write(&script, "#!/bin/sh\necho here >> \"$0.called\"\nexec sleep 60 2>&-\n").unwrap();
    std::fs::set_permissions(&script, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let hands = format!("driver = \"program\"\nprogram = \"{}\"", script.display());
    let rig = RIG.replace("[hands]\ndriver = \"simulated\"", &format!("[hands]\n{hands}"));
    assert_eq!(init(folder.path(), &rig).code, 0);
    let session = folder.path().join("devices");
    let mut child = Command::new(env!("CARGO_BIN_EXE_diaphane"))
        .args(["capture", session.to_str().unwrap(), "--noise"])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let called = folder.path().join("hands.sh.called");
    let until = Instant::now() + Duration::from_secs(60);
    while !called.exists() && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(20));
    }
    let interrupt = || {
        let pid = child.id().to_string();
        assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    };
    interrupt();
    std::thread::sleep(Duration::from_millis(300));
    interrupt();
    let status = child.wait().unwrap();
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(status.code(), Some(130), "{said}");
    assert!(said.contains("putting the devices away") && !said.contains("error:"), "{said}");
}
