//! Runs the real program.

use std::ffi::OsStr;
use std::process::Command;

/// What a run gave back.
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
