//! `diaphane doctor`: is this machine, and a session on it, fit for the work?

use crate::Failure;
use crate::adaptive::{Brackets, Chosen, text};
use crate::commands::export;
use crate::commands::rig::how_to_get;
use crate::measurement::{ARRAYS, Measured};
use crate::output::Done;
use crate::session::{RigConfig, Session};
use crate::steps::{State, Step, steps};
use diffusion::Gpu;
use material::hash_file;
use rig::devices::camera::CameraDriver;
use rig::{DeviceErrorKind, free_bytes, read_journal};
use serde::Serialize;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Check this machine, and a session if one is named
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  diaphane doctor\n  diaphane doctor my-wax")]
pub(crate) struct Args {
    /// Folder of a session to check too
    session: Option<PathBuf>,
}

/// How a check went.
#[derive(Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Mark {
    Found,
    /// The work goes on without it, or slower.
    Note,
    Missing,
}

#[derive(Serialize)]
struct Check {
    name: &'static str,
    state: Mark,
    found: String,
    /// What to do about it.
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<String>,
}

impl Check {
    fn found(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, state: Mark::Found, found: found.into(), advice: None }
    }

    fn note(name: &'static str, found: impl Into<String>, advice: &str) -> Self {
        Self { state: Mark::Note, advice: Some(advice.into()), ..Self::found(name, found) }
    }

    fn missing(name: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { state: Mark::Missing, advice: Some(advice.into()), ..Self::found(name, found) }
    }
}

/// What a demo wants, GiB: an acquisition on the simulated rig, solved in all channels.
const MEMORY_GIB: f64 = 3.0;
const DISK_GIB: f64 = 2.0;

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    // Without its session.toml there is nothing to check a session against.
    let session = args.session.as_deref().map(Session::open).transpose()?;
    let folder = args.session.clone().unwrap_or_else(|| PathBuf::from("."));
    let mut checks = vec![
        processor(),
        memory(),
        disk(&folder),
        writable(&folder),
        Check::found("OpenCV", calibration::opencv_version()),
        graphics(),
        projector(),
        Check::found("devices", "which are connected: diaphane rig list"),
    ];
    checks.extend(CameraDriver::ALL.map(camera_driver));
    if let Some(session) = &session {
        checks.extend(files(session));
    }
    let mut text = String::new();
    for check in &checks {
        let mark = match check.state {
            Mark::Found => "found  ",
            Mark::Note => "note   ",
            Mark::Missing => "MISSING",
        };
        text += &format!("{mark}  {:14} {}\n", check.name, check.found);
        if let Some(advice) = &check.advice {
            text += &format!("{:25}{advice}\n", "");
        }
    }
    let bad: Vec<&Check> = checks.iter().filter(|c| c.state == Mark::Missing).collect();
    if let Some(first) = bad.first() {
        eprint!("{text}");
        let names: Vec<&str> = bad.iter().map(|c| c.name).collect();
        let error = format!("{}: {}", names.join(", "), first.found);
        return Err(Failure {
            error,
            hint: first.advice.clone(),
            code: 1,
            details: Some(json!({ "ready": false, "checks": checks })),
        });
    }
    text += "ready";
    Ok(Done::new(json!({ "ready": true, "checks": checks }), text))
}

fn processor() -> Check {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let found = format!("{} threads, {}", threads, std::env::consts::ARCH);
    #[cfg(target_arch = "x86_64")]
    {
        let has = [
            ("AVX2", std::is_x86_feature_detected!("avx2")),
            ("FMA", std::is_x86_feature_detected!("fma")),
            ("AVX-512F", std::is_x86_feature_detected!("avx512f")),
        ];
        let named: Vec<&str> = has.iter().filter(|(_, there)| *there).map(|(n, _)| *n).collect();
        let found = format!("{found} with {}", named.join(", "));
        if !(has[0].1 && has[1].1) {
            return Check::note(
                "processor",
                found,
                "without AVX2 and FMA the solver is several times slower",
            );
        }
        Check::found("processor", found)
    }
    #[cfg(not(target_arch = "x86_64"))]
    Check::found("processor", found)
}

fn memory() -> Check {
    let available = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find(|l| l.starts_with("MemAvailable:"))?;
        line.split_whitespace().nth(1)?.parse::<f64>().ok()
    });
    match available.map(|kib| kib / 1024.0 / 1024.0) {
        Some(gib) if gib >= MEMORY_GIB => Check::found("memory", format!("{gib:.1} GiB available")),
        Some(gib) => Check::note(
            "memory",
            format!("{gib:.1} GiB available"),
            "a demo wants 3 GiB: close other programs, or solve on fewer cells",
        ),
        None => Check::note("memory", "not known on this system", "a demo wants 3 GiB"),
    }
}

fn disk(folder: &Path) -> Check {
    let told = |gib: f64| format!("{gib:.1} GiB free at {}", folder.display());
    match free_bytes(folder).map(|bytes| bytes as f64 / (1_u64 << 30) as f64) {
        Some(gib) if gib >= DISK_GIB => Check::found("disk", told(gib)),
        Some(gib) => Check::missing(
            "disk",
            told(gib),
            "a demo wants 2 GiB: make room, or work in another folder",
        ),
        None => Check::note("disk", "not known on this system", "a demo wants 2 GiB"),
    }
}

fn writable(folder: &Path) -> Check {
    let probe = folder.join(format!(".diaphane-doctor-{}", std::process::id()));
    let made = std::fs::OpenOptions::new().write(true).create_new(true).open(&probe);
    let told = folder.display();
    match made {
        Ok(_) => match std::fs::remove_file(&probe) {
            Ok(()) => Check::found("permission", format!("files can be written at {told}")),
            Err(e) => Check::note(
                "permission",
                format!("{}: cannot be removed: {e}", probe.display()),
                "remove it by hand",
            ),
        },
        Err(e) => Check::missing(
            "permission",
            format!("no file can be written at {told}: {e}"),
            "work in a folder of your own",
        ),
    }
}

/// Opened, its kernels compiled: what a solve would do.
fn graphics() -> Check {
    let name = "GPU";
    match Gpu::open(None) {
        Ok(gpu) if gpu.is_software() => {
            let found = format!("none in hardware; {} plays one", gpu.name());
            Check::note(name, found, "not needed: solves run on the processor")
        }
        Ok(gpu) => Check::found(name, gpu.name()),
        Err(error) => {
            Check::note(name, error.to_string(), "not needed: solves run on the processor")
        }
    }
}

/// Whether a projector could show pictures.
fn projector() -> Check {
    let name = "projector";
    match rig::devices::list_monitors(None) {
        Ok(monitors) if !monitors.is_empty() => {
            let all: Vec<String> = monitors.iter().map(ToString::to_string).collect();
            Check::found(name, format!("monitors that it can be: {}", all.join(", ")))
        }
        Ok(_) => Check::note(name, "no monitor shows a picture", "plug the projector in"),
        Err(error) => {
            let advice = match error.kind() {
                DeviceErrorKind::MissingDriver => {
                    "build with the feature display (it is a default one, on Linux) to show pictures"
                }
                _ => "only needed to show pictures: log in to a desktop with X",
            };
            Check::note(name, error.to_string(), advice)
        }
    }
}

/// Whether this program speaks to a kind of camera, or how it would.
fn camera_driver(driver: CameraDriver) -> Check {
    if driver.is_built() {
        Check::found(driver.name(), driver.what_for())
    } else {
        let found = format!("not built: {}", driver.what_for());
        Check::note(driver.name(), found, &how_to_get(driver))
    }
}

/// Every file that a session says it has.
fn files(session: &Session) -> Vec<Check> {
    let mut out = vec![Check::found(
        "session.toml",
        format!("{} readable", session.path("session.toml").display()),
    )];
    if !matches!(session.config.rig, RigConfig::Imported) {
        out.push(frames(session));
    }
    if session.config.plan.brackets == Brackets::Adaptive {
        out.push(match Chosen::read(session) {
            Ok(None) => Check::note("exposures", "not chosen yet", "diaphane capture chooses them"),
            Ok(Some(chosen)) => Check::found("exposures", text(&chosen.choice)),
            Err(e) => Check::missing("exposures", e.error, e.hint.unwrap_or_default()),
        });
    }
    match steps(session) {
        Ok(steps) => out.extend(steps.iter().filter_map(|step| result(session, step))),
        Err(e) => out.push(Check::missing("steps", e.error, e.hint.unwrap_or_default())),
    }
    out
}

/// A step's result: what `status` says of it, and whether all of its content is as it was written.
fn result(session: &Session, step: &Step) -> Option<Check> {
    let command = &step.command;
    let Some(file) = step.result else {
        // Frames have a check of their own; that they are of another plan it does not see.
        let advice = format!("go on with the new plan in a session of its own: {command}");
        return (step.state == State::OutOfDate)
            .then(|| Check::note(step.name, step.told(), &advice));
    };
    let again = format!("make it again: {command}");
    Some(match step.state {
        State::Missing => Check::note(
            step.name,
            format!("{file}: not there yet"),
            &format!("make it with: {command}"),
        ),
        State::OutOfDate => Check::note(step.name, format!("{file}: {}", step.told()), &again),
        State::Damaged => Check::missing(step.name, step.told(), again),
        State::Done => match content(session, file) {
            Ok(()) => {
                let remark = step.remark.as_ref().map_or(String::new(), |r| format!("; {r}"));
                Check::found(step.name, format!("{file} whole{remark}"))
            }
            Err(e) => Check::missing(step.name, e.error, format!("{again} --force")),
        },
    })
}

/// What is too much work for `status`.
fn content(session: &Session, file: &str) -> Result<(), Failure> {
    match file {
        ARRAYS => Measured::load(session).map(drop),
        export::NPZ => match export::Record::read(session)? {
            Some(record) => record.check_content(session),
            None => Ok(()),
        },
        _ => Ok(()),
    }
}

/// Every frame of the journal against its hash.
fn frames(session: &Session) -> Check {
    let command = session.command("capture SESSION");
    let journal = match read_journal(&session.path("journal.jsonl")) {
        Ok(journal) => journal,
        Err(e) => {
            return Check::missing(
                "frames",
                e.to_string(),
                "move the journal away and capture again",
            );
        }
    };
    let written = journal.frame_hashes();
    let differs =
        |file: &str, hash: &str| hash_file(&session.path(file)).map_or(true, |h| h != hash);
    let bad: Vec<&str> = written.iter().filter(|(f, h)| differs(f, h)).map(|(f, _)| *f).collect();
    match bad.first() {
        None if written.is_empty() => {
            Check::note("frames", "none yet", &format!("take them with: {command}"))
        }
        None => Check::found("frames", format!("{} as the journal says", written.len())),
        Some(first) => Check::missing(
            "frames",
            format!("{} of {} missing or changed, {first} first", bad.len(), written.len()),
            format!("take them again: {command}"),
        ),
    }
}
