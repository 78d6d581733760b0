//! What a command tells: results for machines on standard output, everything human on standard
//! error, and progress with the time that is left.

use crate::Failure;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use material::Overwrite;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What a command that went well has to say.
pub(crate) struct Done {
    /// For `--json`.
    pub json: serde_json::Value,
    /// For people.
    pub text: String,
}

impl Done {
    pub fn new(json: serde_json::Value, text: impl Into<String>) -> Self {
        Self { json, text: text.into() }
    }
}

/// Progress of one long piece of work: a bar on a terminal, a plain line now and then elsewhere.
pub(crate) struct Progress {
    bar: Option<ProgressBar>,
    label: String,
    total: u64,
    started: Instant,
    last_line: Instant,
}

/// Between two plain lines.
const QUIET: Duration = Duration::from_secs(10);

impl Progress {
    /// `total` 0: nobody knows how much there is.
    pub fn new(label: &str, total: usize) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar =
                ProgressBar::with_draw_target(Some(total as u64), ProgressDrawTarget::stderr());
            let template = if total > 0 {
                "{prefix:16} [{bar:30}] {pos}/{len} {msg}"
            } else {
                "{prefix:16} {spinner} {msg} ({elapsed})"
            };
            if let Ok(style) = ProgressStyle::with_template(template) {
                bar.set_style(style.progress_chars("=> "));
            }
            bar.set_prefix(label.to_owned());
            bar
        });
        let started = Instant::now();
        let last_line = started;
        Self { bar, label: label.into(), total: total as u64, started, last_line }
    }

    /// `done` of the total is done; `message` says what is going on. The time that is left is
    /// judged by the time so far.
    pub fn set(&mut self, done: usize, message: &str) {
        let spent = self.started.elapsed().as_secs_f64();
        let left = (self.total > 0 && done > 0)
            .then(|| spent / done as f64 * (self.total as f64 - done as f64));
        self.set_left(done, message, left);
    }

    /// Like [`set`](Self::set), where somebody knows better how many seconds are left.
    pub fn set_left(&mut self, done: usize, message: &str, left_s: Option<f64>) {
        let left = left_s.map(|left| format!("{} left", duration(left)));
        if let Some(bar) = &self.bar {
            bar.set_position(done as u64);
            let left = left.map_or(String::new(), |left| format!(" ({left})"));
            bar.set_message(format!("{message}{left}"));
            return;
        }
        if self.last_line.elapsed() < QUIET {
            return;
        }
        self.last_line = Instant::now();
        match left {
            Some(left) => eprintln!("{}: {done}/{} {message} ({left})", self.label, self.total),
            None => {
                let spent = self.started.elapsed().as_secs_f64();
                eprintln!("{}: {message} ({spent:.0} s)", self.label);
            }
        }
    }

    /// A line that stays, above the bar.
    pub fn say(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| eprintln!("{line}")),
            None => eprintln!("{line}"),
        }
    }

    /// Ends the bar with a last word.
    pub fn finish(self, message: &str) {
        if let Some(bar) = self.bar {
            bar.finish_and_clear();
        }
        let spent = self.started.elapsed().as_secs_f64();
        eprintln!("{}: {message} ({spent:.1} s)", self.label);
    }
}

/// `1 frame`, `2 frames`.
pub(crate) fn counted(n: usize, one: &str) -> String {
    let s = if n == 1 { "" } else { "s" };
    format!("{n} {one}{s}")
}

/// In the unit that people would use.
pub(crate) fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{s:.0} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// Fails where a folder that is to be read is not there; `flag` names it.
pub(crate) fn check_input_folder(folder: &Path, flag: &str) -> Result<(), Failure> {
    if folder.is_dir() {
        return Ok(());
    }
    let what = if folder.exists() { "is no folder" } else { "there is no such folder" };
    let error = format!("{}: {what}", folder.display());
    Err(Failure::input(error).hint(format!("{flag} names the folder that holds the pictures")))
}

/// The file to write: the one that was asked for, else `name` in the folder of pictures that `flag`
/// names.
pub(crate) fn output_beside(
    asked: Option<&Path>,
    pictures: &Path,
    name: &str,
    flag: &str,
) -> Result<PathBuf, Failure> {
    match asked {
        Some(path) => Ok(path.to_owned()),
        None => check_input_folder(pictures, flag).map(|()| pictures.join(name)),
    }
}

/// Fails where pictures are written as PNG but would not be named so.
pub(crate) fn check_png_name(path: &Path, flag: &str) -> Result<(), Failure> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
        return Ok(());
    }
    let error = format!("{flag}: {}: the picture is written as PNG", path.display());
    Err(Failure::input(error).hint(format!("name it {}", path.with_extension("png").display())))
}

/// Files of these names in a folder, which is made if it is not there; fails before the work where
/// they could not be written.
pub(crate) fn outputs<const N: usize>(
    folder: &Path,
    names: [&str; N],
    overwrite: Overwrite,
) -> Result<[PathBuf; N], Failure> {
    std::fs::create_dir_all(folder)
        .map_err(|e| Failure::input(format!("{}: cannot be made: {e}", folder.display())))?;
    let paths = names.map(|name| folder.join(name));
    paths.iter().try_for_each(|path| check_output(path, overwrite))?;
    Ok(paths)
}

/// Fails before the work where its result could not be written: a file that is there and not to be
/// replaced, a folder that is not there or takes no files.
pub(crate) fn check_output(path: &Path, overwrite: Overwrite) -> Result<(), Failure> {
    if overwrite == Overwrite::Refuse && path.symlink_metadata().is_ok() {
        return Err(material::FileError::Exists { path: path.into() }.into());
    }
    if path.is_dir() {
        return Err(Failure::input(format!("{}: expected a file, found a folder", path.display()))
            .hint("name a file in it"));
    }
    let folder = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        let error = format!("{}: its folder is not there", path.display());
        return Err(Failure::input(error).hint(format!("make it: mkdir -p {}", folder.display())));
    }
    // The only way to know that is the same everywhere; it is gone again at once.
    tempfile::tempfile_in(folder).map(drop).map_err(|e| {
        Failure::input(format!("{}: nothing can be written into its folder: {e}", path.display()))
    })
}
