//! `cargo xtask setup|demo|peers|test|check`: what the README promises, in one word each.
//!
//! Standard library only, so that it builds in seconds on a machine that has nothing yet.

mod system;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};

const USAGE: &str = "\
usage: cargo xtask COMMAND

  setup         install the system packages that the build needs (asks nothing, says which)
  demo [FLAGS]  acquire a material on the simulated rig into ./demo;
                FLAGS go to `diaphane demo`, for example --sample marble --seed 7
  peers         install other people's programs that some tests compare with, into target/peers
  test [FLAGS]  run the whole test suite; FLAGS go to `cargo test`
  check         formatting and lints, warnings being errors
";

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let command = arguments.next().unwrap_or_default();
    let flags: Vec<String> = arguments.collect();
    let outcome = match command.as_str() {
        "setup" => system::setup(),
        "demo" => system::setup().and_then(|()| demo(&flags)),
        "peers" => peers(),
        "test" => system::setup().and_then(|()| cargo(&["test", "--workspace"], &flags)),
        "check" => system::setup().and_then(|()| check()),
        "help" | "--help" | "-h" => {
            print!("{USAGE}");
            return ExitCode::SUCCESS;
        }
        _ => Err(Stop::usage(USAGE)),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(stop) => {
            if let Some(message) = stop.message {
                eprintln!("{}", message.trim_end());
            }
            ExitCode::from(stop.code)
        }
    }
}

/// The end of the road: an exit code, and what to say where nobody has said it yet.
struct Stop {
    code: u8,
    message: Option<String>,
}

impl Stop {
    /// Something that whoever runs this has to change: exit code 2.
    fn usage(message: impl Into<String>) -> Self {
        Self { code: 2, message: Some(message.into()) }
    }

    /// Something went wrong: exit code 1.
    fn failed(message: impl Into<String>) -> Self {
        Self { code: 1, message: Some(message.into()) }
    }
}

fn demo(flags: &[String]) -> Result<(), Stop> {
    let chosen = flags.iter().any(|flag| flag == "--out" || flag.starts_with("--out="));
    let out: &[&str] = if chosen { &[] } else { &["--out", "demo"] };
    let run = ["run", "--release", "--package", "diaphane", "--bin", "diaphane", "--", "demo"];
    cargo(&[&run[..], out].concat(), flags)
}

/// Counterparts of the devices' protocols, in the versions that the tests were written against.
const PEERS: &[&str] = &[
    "OpenEXR==3.5.3",
    "aiopjlink==1.0.5",
    // It brings a virtual camera.
    "gphoto2==2.6.4",
    "materialx==1.39.5",
    "meerk40t==0.9.9100",
    // meerk40t does not start without it and does not ask for it.
    "mitsuba==3.9.1",
    "numpy",
    "pillow",
    "pynrrd==1.1.3",
    "pypjlink2==1.2.2",
    "zaber-motion==10.3.0",
];

/// Khronos' own, for Node.js.
const GLTF_VALIDATOR: &str = "gltf-validator@2.0.0-dev.3.10";

fn peers() -> Result<(), Stop> {
    let folder = root().join("target/peers");
    let python = folder.join("bin/python");
    let run = |program: &Path, arguments: &[&str]| {
        let status = Command::new(program).args(arguments).status();
        let name = program.display();
        let status = status.map_err(|e| Stop::failed(format!("{name} cannot be started: {e}")))?;
        if status.success() { Ok(()) } else { Err(Stop::failed(format!("{name} failed"))) }
    };
    run(Path::new("python3"), &["-m", "venv", &folder.to_string_lossy()])?;
    run(&python, &[&["-m", "pip", "install", "--quiet"], PEERS].concat())?;
    let validator = ["install", "--silent", "--no-save", "--prefix"].map(String::from);
    let place = [folder.display().to_string(), GLTF_VALIDATOR.into()];
    match Command::new("npm").args(validator).args(place).status() {
        Ok(status) if status.success() => {}
        _ => eprintln!("without npm's {GLTF_VALIDATOR}: the test that needs it will say SKIPPED"),
    }
    eprintln!("to have the tests use them: export DIAPHANE_PYTHON={}", python.display());
    Ok(())
}

fn check() -> Result<(), Stop> {
    cargo(&["fmt", "--all", "--check"], &[])?;
    cargo(&["clippy", "--workspace", "--all-targets", "--", "--deny", "warnings"], &[])
}

/// Runs cargo at the root of the workspace and passes its exit code on.
fn cargo(arguments: &[&str], flags: &[String]) -> Result<(), Stop> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.args(arguments).args(flags).current_dir(root());
    // What cargo tells this program about itself is none of the other programs' business.
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("CARGO_PKG_") {
            command.env_remove(name);
        }
    }
    command.env_remove("CARGO_MANIFEST_DIR").env_remove("CARGO_MANIFEST_PATH");
    let status = command.status();
    let status = status.map_err(|e| Stop::failed(format!("cargo cannot be started: {e}")))?;
    match status.code() {
        Some(0) => Ok(()),
        code => {
            let code = code.and_then(|code| u8::try_from(code).ok()).unwrap_or(1);
            Err(Stop { code, message: None })
        }
    }
}

/// The root of the workspace, one above this package.
fn root() -> PathBuf {
    let package = std::env::var_os("CARGO_MANIFEST_DIR")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    package.parent().map_or_else(|| package.clone(), Path::to_path_buf)
}
