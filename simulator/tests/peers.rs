//! Emulators and drivers against other people's programs, so that the two sides of a protocol are
//! not one misunderstanding. These programs are Python packages (`cargo xtask peers` installs
//! them); the environment variable `DIAPHANE_PYTHON` names an interpreter that has them.
#![cfg(unix)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rig::devices::{
    Coordinate, Fault, Grbl, Link, Millimetres, Part, Patience, Range, Severity, Stage, StageAxis,
};
use serde::Deserialize;
use simulator::devices::{
    PjlinkEmulator, ProjectorSpec, SimulatedProjector, SimulatedStage, Wire, ZaberEmulator,
};

/// The interpreter; `None`, and a word about it, where none is named.
fn python(packages: &str) -> Option<PathBuf> {
    let python = std::env::var_os("DIAPHANE_PYTHON").map(PathBuf::from);
    if python.is_none() {
        println!("SKIPPED: DIAPHANE_PYTHON names no Python with {packages} (cargo xtask peers)");
    }
    python
}

/// Longer than any of them takes; one that hangs is ended.
const LONGEST: Duration = Duration::from_secs(60);

/// What a script of `peers/` prints.
fn run<T: for<'a> Deserialize<'a>>(python: &Path, script: &str, arguments: &[&str]) -> T {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(script);
    let mut child = Command::new(python)
        .arg(&script)
        .args(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit())
        .spawn()
        .unwrap();
    let started = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if started.elapsed() > LONGEST {
            child.kill().unwrap();
            panic!("{} hangs", script.display());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", script.display());
    serde_json::from_slice(&output.stdout).unwrap()
}

fn projector() -> SimulatedProjector {
    let warm_up = Duration::from_millis(500);
    let projector = SimulatedProjector::new(ProjectorSpec { warm_up, ..ProjectorSpec::default() });
    projector.report(Fault { part: Part::Temperature, severity: Severity::Warning });
    projector.report(Fault { part: Part::Filter, severity: Severity::Error });
    projector
}

const PASSWORDS: [Option<&str>; 2] = [None, Some("JBMIAProjectorLink")];

#[derive(Deserialize)]
struct PypjlinkSaw {
    authenticated: Option<bool>,
    before: String,
    states: Vec<String>,
    input: (String, u32),
    muted: (bool, bool),
    unmuted: (bool, bool),
    lamps: Vec<(u32, bool)>,
    errors: std::collections::BTreeMap<String, String>,
    maker: String,
}

#[test]
fn pypjlink_switches_the_emulated_projector() {
    let Some(python) = python("pypjlink2") else { return };
    for password in PASSWORDS {
        let wire = Wire::tcp(0, PjlinkEmulator::new(projector(), password)).unwrap();
        let arguments: Vec<&str> = [Some(wire.address()), password].into_iter().flatten().collect();
        let saw: PypjlinkSaw = run(&python, "pypjlink_client.py", &arguments);
        assert_eq!(saw.authenticated, password.map(|_| true));
        assert_eq!(saw.before, "off");
        assert_eq!(saw.states, ["warm-up"]);
        assert_eq!(saw.input, ("DIGITAL".to_owned(), 1));
        assert_eq!((saw.muted, saw.unmuted), ((true, true), (false, false)));
        assert_eq!(saw.lamps, [(1234, true)]);
        let errors = ["fan", "lamp", "temperature", "cover", "filter", "other"];
        let states = ["ok", "ok", "warning", "ok", "error", "ok"];
        for (part, state) in errors.into_iter().zip(states) {
            assert_eq!(saw.errors[part], state, "{part}");
        }
        assert_eq!(saw.maker, "Diaphane");
    }
}

#[derive(Deserialize)]
struct AiopjlinkSaw {
    refused: Option<bool>,
    before: String,
    muted: (bool, bool),
    unmuted: (bool, bool),
    lamps: Vec<(u32, String)>,
    errors: std::collections::BTreeMap<String, String>,
    maker: String,
}

#[test]
fn aiopjlink_switches_the_emulated_projector() {
    let Some(python) = python("aiopjlink") else { return };
    for password in PASSWORDS {
        let wire = Wire::tcp(0, PjlinkEmulator::new(projector(), password)).unwrap();
        let arguments: Vec<&str> = [Some(wire.address()), password].into_iter().flatten().collect();
        let saw: AiopjlinkSaw = run(&python, "aiopjlink_client.py", &arguments);
        assert_eq!(saw.refused, password.map(|_| true));
        assert_eq!(saw.before, "OFF");
        assert_eq!((saw.muted, saw.unmuted), ((true, true), (false, false)));
        assert_eq!(saw.lamps, [(1234, "ON".to_owned())]);
        assert_eq!((&*saw.errors["TEMP"], &*saw.errors["FILTER"]), ("WARN", "ERROR"));
        assert_eq!(saw.maker, "Diaphane");
    }
}

#[derive(Deserialize)]
struct ZaberSaw {
    warning_before: String,
    busy: bool,
    at: String,
    status: String,
    warning: String,
    refused: Option<String>,
}

fn slide() -> StageAxis {
    let range = Range::Linear(Millimetres(0.0), Millimetres(100.0));
    StageAxis { name: "x".into(), range, park: None }
}

#[test]
fn zabers_own_library_moves_the_emulated_stage() {
    let Some(python) = python("zaber-motion") else { return };
    let stage = SimulatedStage::new(vec![slide()], 20.0);
    let wire = Wire::serial(ZaberEmulator::new(stage.clone(), 0.000_5)).unwrap();
    let saw: ZaberSaw = run(&python, "zaber_client.py", &[wire.address()]);
    assert_eq!(saw.warning_before, "WR");
    assert!(saw.busy);
    assert_eq!((&*saw.at, &*saw.status, &*saw.warning), ("20000", "IDLE", "--"));
    assert_eq!(saw.refused.as_deref(), Some("BadCommandException"));
    assert_eq!(stage.at(0), 10.0);
}

/// Ended when the test ends, however it ends.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn the_grbl_driver_moves_meerk40ts_emulator() {
    let Some(python) = python("meerk40t") else { return };
    let folder = tempfile::tempdir().unwrap();
    // Somebody else may take the port in between: then the test fails, loudly.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let batch = folder.path().join("batch");
    std::fs::write(&batch, format!("service device start -i grbl\ngrblcontrol -p {port}\n"))
        .unwrap();
    let child = Command::new(&python)
        .args(["-c", "from meerk40t.main import run; run()", "-z", "-c", "-X", "-A", "-b"])
        .arg(&batch)
        // Its settings are its own business, and not the user's.
        .env("HOME", folder.path())
        // A console that never says anything; without one it prints prompts for ever.
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let _running = Running(child);
    let started = Instant::now();
    while std::net::TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(started.elapsed() < LONGEST, "meerk40t does not start");
        std::thread::sleep(Duration::from_millis(200));
    }
    let link = Link::tcp("meerk40t", "127.0.0.1", port, Patience::default());
    let mut stage = Grbl::over(link, vec![(slide(), 0)]);
    let limit = Duration::from_secs(20);
    stage.unlock().unwrap();
    for to in [5.0, 12.5, 3.0] {
        // The driver itself compares where it is with where it was sent.
        stage.move_to(0, Coordinate::Linear(Millimetres(to)), limit).unwrap();
        let at = stage.position(0).unwrap().value();
        // Its own unit is 1/65535 of an inch, its report has three decimals.
        assert!((at - to).abs() < 2e-3, "{at} for {to}");
    }
    stage.hold().unwrap();
    stage.halt().unwrap();
    stage.unlock().unwrap();
    stage.move_to(0, Coordinate::Linear(Millimetres(8.0)), limit).unwrap();
}
