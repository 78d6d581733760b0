//! `diaphane report`: a session on one page.

use crate::Failure;
use crate::output::{Done, check_output};
use crate::report::{Verdict, page};
use crate::session::Session;
use crate::steps::steps;
use material::{Overwrite, atomic_write};
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
    let (path, verdict) = report(&session, args.output.as_deref(), overwrite)?;
    let missing: Vec<&str> =
        steps(&session)?.iter().filter(|s| !s.done && s.name != "report").map(|s| s.name).collect();
    let mut text = match &verdict {
        Some(v) => format!("{}: {}\n", v.grade.word(), v.reason()),
        None => "no verdict yet\n".to_owned(),
    };
    if !missing.is_empty() {
        text += &format!("missing: {}\n", missing.join(", "));
    }
    text += &path.display().to_string();
    Ok(Done::new(json!({ "report": path, "verdict": verdict, "missing": missing }), text))
}

/// Writes the page and tells where it is and what it says.
pub(crate) fn report(
    session: &Session,
    output: Option<&Path>,
    overwrite: Overwrite,
) -> Result<(PathBuf, Option<Verdict>), Failure> {
    let path = match output {
        Some(path) => path.to_owned(),
        None => {
            session.refuse_existing(RESULT, overwrite)?;
            session.result(RESULT)?
        }
    };
    check_output(&path, overwrite)?;
    let (page, verdict) = page(session)?;
    atomic_write(&path, overwrite, |file| file.write_all(page.as_bytes()))?;
    Ok((path, verdict))
}
