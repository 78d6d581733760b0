//! What a command tells: results for machines on standard output, everything human on standard
//! error, and progress with the time that is left.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
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
                "{prefix:16} [{bar:30}] {pos}/{len} {msg} ({eta} left)"
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

    /// `done` of the total is done; `message` says what is going on.
    pub fn set(&mut self, done: usize, message: &str) {
        if let Some(bar) = &self.bar {
            bar.set_position(done as u64);
            bar.set_message(message.to_owned());
            return;
        }
        if self.last_line.elapsed() < QUIET {
            return;
        }
        self.last_line = Instant::now();
        let spent = self.started.elapsed().as_secs_f64();
        if self.total > 0 && done > 0 {
            let left = spent / done as f64 * (self.total as f64 - done as f64);
            eprintln!("{}: {done}/{} {message} ({left:.0} s left)", self.label, self.total);
        } else {
            eprintln!("{}: {message} ({spent:.0} s)", self.label);
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
