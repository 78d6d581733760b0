//! Somebody at a terminal who is asked to put something in place, and stops instead.
#![cfg(unix)]

mod common;

use common::{Run, SIMULATED_RIG, diaphane};
use serialport::{SerialPort, TTYPort};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Command, Stdio};

/// How somebody stops.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stop {
    Letter,
    CtrlC,
}

/// Runs a command at a terminal and stops it where it asks for something.
fn stopped(arguments: &[&str], how: Stop) -> Run {
    let (mut keyboard, mut terminal) = TTYPort::pair().unwrap();
    terminal.set_exclusive(false).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_diaphane"))
        .arg("--json")
        .args(arguments)
        .stdin(File::open(terminal.name().unwrap()).unwrap())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut stderr = String::new();
    while !stderr.contains("put on the rig") {
        assert_ne!(said.read_line(&mut stderr).unwrap(), 0, "it ended: {stderr}");
    }
    match how {
        Stop::Letter => keyboard.write_all(b"q\n").unwrap(),
        Stop::CtrlC => {
            let pid = child.id().to_string();
            assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
        }
    }
    said.read_to_string(&mut stderr).unwrap();
    let out = child.wait_with_output().unwrap();
    let code = out.status.code().unwrap();
    Run { code, json: serde_json::from_slice(&out.stdout).unwrap_or_default(), stderr }
}

#[test]
fn who_stops_at_a_placement_interrupts_and_is_told_how_to_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let (rig, session) = (folder.path().join("rig.toml"), folder.path().join("session"));
    std::fs::write(&rig, SIMULATED_RIG).unwrap();
    let (rig, session) = (rig.to_str().unwrap(), session.to_str().unwrap());
    let made = diaphane([
        "init",
        session,
        "--rig",
        rig,
        "--size",
        "18x18x4.5",
        "--cells",
        "40x40x10",
        "--board",
        "8x5",
        "--square",
        "2",
    ]);
    assert_eq!(made.code, 0, "{}", made.stderr);
    for how in [Stop::Letter, Stop::CtrlC] {
        for (command, asked) in [
            (&["capture", session, "--noise"][..], "the cap on the lens"),
            (&["calibrate", "all", session], "the chessboard, pose 1"),
        ] {
            let run = stopped(command, how);
            assert_eq!(run.code, 1, "{how:?}: {}", run.stderr);
            let error = run.json["error"].as_str().unwrap();
            let interrupted = format!("interrupted while waiting for {asked}");
            assert!(error.starts_with(&interrupted), "{how:?}: {error}");
            assert!(error.contains("0 frames kept"), "{how:?}: {error}");
            let hint = run.json["hint"].as_str().unwrap();
            let again = format!("go on with: diaphane {}", command.join(" "));
            assert_eq!(hint, again, "{how:?}");
        }
    }
    let journal = std::fs::read_to_string(Path::new(session).join("journal.jsonl")).unwrap();
    assert!(!journal.contains("\"failed\""), "{journal}");
}
