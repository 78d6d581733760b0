//! Runs the real program.

use std::ffi::OsStr;
use std::process::Command;

/// What a run gave back.
#[allow(dead_code, reason = "each test looks at what it needs")]
pub struct Run {
    /// Exit code.
    pub code: i32,
    /// The line of JSON; null where there was none.
    pub json: serde_json::Value,
    /// Standard error.
    pub stderr: String,
}

/// Runs `diaphane --json` with arguments. Whatever happens it must not panic.
pub fn diaphane<S: AsRef<OsStr>>(args: impl IntoIterator<Item = S>) -> Run {
    let out =
        Command::new(env!("CARGO_BIN_EXE_diaphane")).arg("--json").args(args).output().unwrap();
    let stderr = String::from_utf8(out.stderr).unwrap();
    assert!(!stderr.contains("panicked"), "{stderr}");
    Run {
        code: out.status.code().unwrap(),
        json: serde_json::from_slice(&out.stdout).unwrap_or_default(),
        stderr,
    }
}

/// The smallest rig file that makes pictures; a person puts things in place.
#[allow(dead_code, reason = "not every test needs a rig file")]
pub const SIMULATED_RIG: &str = r#"
version = 1

[camera]
driver = "simulated"

[projector.display]
driver = "simulated"
"#;

/// Makes a session of few pictures on the simulated rig: one region, three exposures, six poses,
/// with other keys of `[plan]` and more at the end of its file.
#[allow(dead_code, reason = "not every test needs a session")]
pub fn tiny_session(session: &str, keys: &[(&str, &str)], more: &str) {
    let made = diaphane(["init", session, "--seed", "3"]);
    assert_eq!(made.code, 0, "{}", made.stderr);
    let file = std::path::Path::new(session).join("session.toml");
    let mut text = std::fs::read_to_string(&file).unwrap();
    let small = [
        ("board_poses", "6"),
        ("ramp_levels", "5"),
        ("regions", "[1, 1]"),
        ("bracket_s", "[0.05, 0.4, 3.0]"),
        ("reference_bracket_s", "[0.0333334, 0.5]"),
        ("response_bracket_s", "[0.0333334, 0.05, 0.11, 0.25, 0.6, 1.7]"),
    ];
    for (key, value) in small.iter().chain(keys) {
        let start = text.find(&format!("\n{key} = ")).unwrap() + 1;
        let end = start + text[start..].find('\n').unwrap();
        text.replace_range(start..end, &format!("{key} = {value}"));
    }
    std::fs::write(file, text + more).unwrap();
}
