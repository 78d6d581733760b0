//! `diaphane report`: a session on one page.

use crate::Failure;
use crate::output::{Done, check_output};
use crate::report::{Verdict, page};
use crate::session::Session;
use crate::steps::{Ledger, State, Step, made_from, of_ledger};
use material::{Input, Overwrite, atomic_write};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

pub(crate) const RESULT: &str = "report/report.html";

/// Write one page about a session: how good the material is, what it looks like, where it comes
/// from. A session that is half done is told as far as it is
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane report my-wax --output my-wax.html")]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    /// The HTML file to write; report/report.html in the session if not given
    #[arg(long)]
    output: Option<PathBuf>,
    /// Replace a report that is there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let Reported { path, verdict, steps } = report(&session, args.output.as_deref(), overwrite)?;
    let in_state = |states: &[State]| -> Vec<&str> {
        let those = steps.iter().filter(|s| s.name != "report" && states.contains(&s.state));
        those.map(|s| s.name).collect()
    };
    let missing = in_state(&[State::Missing]);
    let out_of_date = in_state(&[State::OutOfDate, State::Damaged]);
    let mut text = match &verdict {
        Some(v) => format!("{}: {}\n", v.grade.word(), v.reason()),
        None => "no verdict yet\n".to_owned(),
    };
    if !missing.is_empty() {
        text += &format!("missing: {}\n", missing.join(", "));
    }
    if !out_of_date.is_empty() {
        text += &format!("out of date: {}\n", out_of_date.join(", "));
    }
    text += &path.display().to_string();
    if let Some(next) = steps.iter().find(|s| !s.done && s.name != "report") {
        text += &format!("\nnext: {}", next.command);
    }
    let json = json!({
        "report": path,
        "verdict": verdict,
        "missing": missing,
        "out_of_date": out_of_date,
    });
    Ok(Done::new(json, text))
}

/// A page that was written.
pub(crate) struct Reported {
    pub path: PathBuf,
    pub verdict: Option<Verdict>,
    /// The session's steps as the page tells them.
    pub steps: Vec<Step>,
}

/// Writes the page and tells where it is and what it says.
pub(crate) fn report(
    session: &Session,
    output: Option<&Path>,
    overwrite: Overwrite,
) -> Result<Reported, Failure> {
    let path = match output {
        Some(path) => path.to_owned(),
        None => {
            session.refuse_existing(RESULT, overwrite)?;
            session.result(RESULT)?
        }
    };
    check_output(&path, overwrite)?;
    // One ledger for all, so that each file is hashed once.
    let ledger = Ledger::of(session)?;
    let inputs = made_from::inputs(&made_from::report(&ledger)?);
    let steps = of_ledger(&ledger)?;
    let (page, verdict) = page(&ledger, &steps)?;
    let page = with_inputs(&page, &inputs)?;
    atomic_write(&path, overwrite, |file| file.write_all(page.as_bytes()))?;
    Ok(Reported { path, verdict, steps })
}

/// What stands around the inputs in the page.
const BEFORE: &str = "<script type=\"application/json\" id=\"inputs\">";
const AFTER: &str = "</script>";
/// How every page ends.
const END: &str = "</html>";

/// The page with what it was made from, where programs find it and nobody sees it.
fn with_inputs(page: &str, inputs: &[Input]) -> Result<String, Failure> {
    // A name could hold anything, the end of this element too.
    let text = serde_json::to_string(inputs).map_err(Failure::other)?.replace('<', "\\u003c");
    Ok(page.replacen("</body>", &format!("{BEFORE}{text}{AFTER}</body>"), 1))
}

/// What the session's page was made from; nothing if it does not say, as those of earlier versions.
///
/// # Errors
/// It is not whole.
pub(crate) fn made_from(session: &Session) -> Result<Vec<Input>, Failure> {
    let path = session.path(RESULT);
    let bytes = std::fs::read(&path)
        .map_err(|e| Failure::input(format!("{}: cannot be read: {e}", path.display())))?;
    let page = String::from_utf8_lossy(&bytes);
    if !page.trim_end().ends_with(END) {
        return Err(Failure::input(format!("{}: it has no end", path.display())));
    }
    let Some((_, rest)) = page.rsplit_once(BEFORE) else { return Ok(Vec::new()) };
    let text = rest.split_once(AFTER).map_or("", |(text, _)| text);
    serde_json::from_str(text)
        .map_err(|e| Failure::input(format!("{}: what it says of its inputs: {e}", path.display())))
}
