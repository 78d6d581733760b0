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
const LONGEST: Duration = Duration::from_secs(180);

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

#[derive(Deserialize)]
struct MitsubaSaw {
    parts: Vec<Vec<f64>>,
}

/// A block with a vein, and nothing in it symmetric: swapped axes or sides show.
fn veined(grid: &material::Grid) -> diffusion::Medium {
    let [nx, ny, nz] = grid.cells();
    let (mut kappa, mut mu) = (Vec::new(), Vec::new());
    for i in 0..nx * ny * nz {
        let [x, y, z] = [i % nx, i / nx % ny, i / (nx * ny)].map(|k| k as f64);
        let vein = (0.5 * x + 0.2 * y + (0.3 * y + 0.6 * z).sin()).sin().abs() < 0.35;
        let (scattering, absorption) = if vein { (1.8, 0.1) } else { (1.0, 0.01) };
        kappa.push(1.0 / (3.0 * (scattering + absorption)));
        mu.push(absorption);
    }
    diffusion::Medium::new(*grid, kappa, mu).unwrap()
}

/// Monte Carlo against another path tracer, in absolute units, cell by cell: a projector's beam on
/// a part of the back face of a block without a surface, and diffuse light on all of a block of
/// η = 1.4. Mitsuba's camera sees the diffuse lamp through the block as well, which is
/// T² exp(−τ)/(1 − R² exp(−2τ)) of its radiance.
///
/// Totals: within four of their standard errors (of eight parts of Mitsuba's samples), and those
/// below 1.2 %. Maps: mean squared difference over what the noise of both makes it, from 0.7 to 1.4:
/// 192 cells, whose errors are known to a quarter each.
#[test]
fn mitsuba_sees_the_same_radiance() {
    use material::{Face, Grid, Illumination, Optics};
    let Some(python) = python("mitsuba") else { return };
    let grid = Grid::new([16, 12, 10], [1.0, 1.2, 0.6]).unwrap();
    let medium = veined(&grid);
    let extinction: Vec<f64> = medium.kappa_mm().iter().map(|k| 1.0 / (3.0 * k)).collect();
    let albedo: Vec<f64> =
        medium.mu_per_mm().iter().zip(&extinction).map(|(mu, t)| 1.0 - mu / t).collect();
    let folder = tempfile::tempdir().unwrap();
    for (eta, illumination, cells) in [
        (1.0, Illumination::Collimated, [3, 9, 2, 6]),
        (1.4, Illumination::Diffuse, [0, 16, 0, 12]),
    ] {
        let [x0, x1, y0, y1] = cells;
        let lit = |i: usize| (x0..x1).contains(&(i % 16)) && (y0..y1).contains(&(i / 16));
        let map: Vec<f64> = (0..192).map(|i| f64::from(u8::from(lit(i)))).collect();
        let light = diffusion::Illuminations::new(&grid, Face::Back, vec![map]).unwrap();
        let optics = Optics { illumination, ..Optics::from_eta(eta) };
        let block = simulator::MonteCarlo::new(&medium, &optics, 0.0).unwrap();
        let ours = block.radiance(&light, 1 << 19, [5; 32]).unwrap().remove(0);

        let job = folder.path().join("job.json");
        let [hx, hy, _] = grid.spacing_mm();
        let task = serde_json::json!({
            "cells": grid.cells(), "spacing_mm": grid.spacing_mm(), "extinction": &extinction,
            "albedo": &albedo, "eta": eta, "light": illumination, "samples": 4096, "seed": 11,
            "region": [x0 as f64 * hx, x1 as f64 * hx, y0 as f64 * hy, y1 as f64 * hy],
        });
        std::fs::write(&job, task.to_string()).unwrap();
        let saw: MitsubaSaw = run(&python, "mitsuba_slab.py", &[job.to_str().unwrap()]);
        let lamp = |c: usize| {
            if illumination == Illumination::Collimated {
                return 0.0;
            }
            let tau: f64 = (0..10).map(|z| 0.6 * extinction[z * 192 + c]).sum();
            let r = material::normal_reflectance(eta);
            let echo = 1.0 - r * r * (-2.0 * tau).exp();
            (1.0 - r).powi(2) * (-tau).exp() / echo / std::f64::consts::PI
        };
        let parts = saw.parts.len() as f64;
        let (mut squares, mut variances) = (0.0, 0.0);
        for c in 0..192 {
            let seen: Vec<f64> = saw.parts.iter().map(|part| part[c] - lamp(c)).collect();
            let mean = seen.iter().sum::<f64>() / parts;
            let spread = seen.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
            squares += (mean - ours.radiance[c]).powi(2);
            variances += spread / (parts - 1.0) / parts + ours.standard_error[c].powi(2);
        }
        let total = ours.radiance.iter().sum::<f64>();
        let lamps: f64 = (0..192).map(lamp).sum();
        let totals: Vec<f64> =
            saw.parts.iter().map(|part| (part.iter().sum::<f64>() - lamps) / total).collect();
        let ratio = totals.iter().sum::<f64>() / parts;
        let spread = totals.iter().map(|t| (t - ratio).powi(2)).sum::<f64>();
        let error = (spread / (parts - 1.0) / parts).sqrt();
        let noise = squares / variances;
        println!("η = {eta}: Mitsuba over ours {ratio:.4} ± {error:.4}, maps {noise:.3}");
        assert!(error < 0.012, "{error}");
        assert!((ratio - 1.0).abs() < 4.0 * error, "{eta}: {ratio} ± {error}");
        assert!((0.7..1.4).contains(&noise), "{eta}: {noise}");
    }
}
