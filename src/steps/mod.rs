//! The steps of a session: what each one's result is worth now, and which command comes next.

mod inputs;
mod judge;
mod ledger;

pub(crate) use inputs::check_frames;
pub(crate) use judge::State;
pub(crate) use ledger::Ledger;

/// What the results are made from; see the module.
pub(crate) mod made_from {
    pub(crate) use super::inputs::{calibration, export, measurement, report, verification};
    pub(crate) use super::ledger::inputs;
}

use crate::Failure;
use crate::adaptive;
use crate::commands::{calibrate, export, report, solve, verify};
use crate::measurement::ARRAYS;
use crate::output::counted;
use crate::session::{RigConfig, Session};
use judge::{Judgement, judge};
use rig::{Inventory, Plan};
use serde::Serialize;

/// One step.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Step {
    pub name: &'static str,
    /// It is whole, and made from what is there now.
    pub done: bool,
    pub state: State,
    /// Why it is out of date or damaged; or what to know of one that is done.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub remark: Option<String>,
    /// The command that does it, with `--force` where a result has to be replaced.
    pub command: String,
    /// Pictures on disk and pictures wanted, for a step that takes pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<Frames>,
    /// The file that is its result.
    #[serde(skip)]
    pub result: Option<&'static str>,
}

/// Pictures of one plan.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Frames {
    pub taken: usize,
    pub wanted: usize,
    /// Shots that lack at least one picture.
    pub incomplete_shots: Vec<String>,
}

impl Step {
    /// What it is worth, in words; a hyphen for one that is missing.
    pub fn told(&self) -> String {
        let (state, joint) = match self.state {
            State::Missing => return "-".into(),
            State::Done => ("done", "; "),
            State::OutOfDate => ("out of date", ": "),
            State::Damaged => ("damaged", ": "),
        };
        match &self.remark {
            Some(remark) => format!("{state}{joint}{remark}"),
            None => state.into(),
        }
    }

    /// Pictures are many, a result is one.
    fn verb(&self) -> &'static str {
        if self.frames.is_some() { "are" } else { "is" }
    }

    fn of_result(
        ledger: &Ledger<'_>,
        name: &'static str,
        result: &'static str,
        words: &str,
    ) -> Result<Self, Failure> {
        let Judgement { state, remark } = judge(ledger, result)?;
        let force = if state == State::Missing { "" } else { " --force" };
        let command = ledger.session.command(&format!("{words}{force}"));
        let (done, result) = (state == State::Done, Some(result));
        Ok(Self { name, done, state, remark, command, frames: None, result })
    }

    fn of_pictures(
        ledger: &Ledger<'_>,
        name: &'static str,
        plan: &Plan,
        settled: bool,
        words: &str,
    ) -> Result<Self, Failure> {
        plan.check()?;
        let session = ledger.session;
        let found = Inventory::of(plan, session.folder(), &ledger.journal);
        let (mut state, mut remark, mut command) = (State::Done, None, session.command(words));
        if let Some(first) = found.otherwise.first() {
            state = State::OutOfDate;
            remark = Some(format!(
                "{} of another plan than session.toml has now ({first} first); put the old values back, or go on in another session",
                counted(found.otherwise.len(), "picture")
            ));
            command = session.branch_command();
        } else if found.taken < found.wanted || !settled {
            state = State::Missing;
        }
        let Inventory { taken, wanted, incomplete_shots, .. } = found;
        let frames = Some(Frames { taken, wanted, incomplete_shots });
        let done = state == State::Done;
        Ok(Self { name, done, state, remark, command, frames, result: None })
    }
}

/// All steps in their order; the first that is not done is the next one.
pub(crate) fn steps(session: &Session) -> Result<Vec<Step>, Failure> {
    of_ledger(&Ledger::of(session)?)
}

/// As [`steps`], where somebody has the ledger already.
pub(crate) fn of_ledger(ledger: &Ledger<'_>) -> Result<Vec<Step>, Failure> {
    let session = ledger.session;
    let mut out = Vec::new();
    match session.config.rig {
        RigConfig::Imported => {
            let words = "import SESSION --images DIR --manifest m.toml";
            out.push(Step::of_result(ledger, "measurement", ARRAYS, words)?);
        }
        RigConfig::Simulated { .. } | RigConfig::Devices { .. } => {
            let plan = session.acquisition().calibration_plan();
            let words = match calibrate::is_done(session) {
                true => "calibrate all SESSION --force",
                false => "calibrate all SESSION",
            };
            out.push(Step::of_pictures(ledger, "calibration pictures", &plan, true, words)?);
            let words = "calibrate all SESSION";
            out.push(Step::of_result(ledger, "calibration", calibrate::RESULT, words)?);
            let (plan, settled) = (adaptive::sample_plan(session)?, adaptive::is_settled(session)?);
            let words = "capture SESSION";
            out.push(Step::of_pictures(ledger, "sample pictures", &plan, settled, words)?);
            out.push(Step::of_result(ledger, "measurement", ARRAYS, "merge SESSION")?);
        }
    }
    out.push(Step::of_result(ledger, "material", solve::MATERIAL, "solve SESSION")?);
    out.push(Step::of_result(ledger, "verification", verify::RESULT, "verify SESSION")?);
    out.push(Step::of_result(ledger, "export", export::NPZ, "export SESSION")?);
    out.push(Step::of_result(ledger, "report", report::RESULT, "report SESSION")?);
    pass_on(&mut out);
    Ok(out)
}

/// What a step works from directly.
pub(crate) fn rests_on(name: &str) -> &'static [&'static str] {
    match name {
        "calibration" => &["calibration pictures"],
        "measurement" => &["calibration", "sample pictures"],
        "material" => &["measurement"],
        "verification" => &["material", "measurement"],
        "export" => &["material"],
        "report" => &["calibration", "measurement", "material", "verification"],
        _ => &[],
    }
}

/// What rests on something that is out of date or damaged is out of date.
fn pass_on(steps: &mut [Step]) {
    for i in 0..steps.len() {
        let (before, rest) = steps.split_at_mut(i);
        let Some(step) = rest.first_mut().filter(|step| step.state == State::Done) else {
            continue;
        };
        let bad = |s: &&Step| {
            rests_on(step.name).contains(&s.name)
                && matches!(s.state, State::OutOfDate | State::Damaged)
        };
        if let Some(bad) = before.iter().find(bad) {
            let word = if bad.state == State::Damaged { "damaged" } else { "out of date" };
            step.remark = Some(format!("the {} {} {word}", bad.name, bad.verb()));
            step.state = State::OutOfDate;
            step.done = false;
        }
    }
}

/// The last line of a step that went well.
pub(crate) fn next_line(session: &Session) -> Result<String, Failure> {
    Ok(told_next(next(&steps(session)?)))
}

/// The first step that is not done.
pub(crate) fn next(steps: &[Step]) -> Option<&Step> {
    steps.iter().find(|step| !step.done)
}

/// The step that comes next, as a line for people.
pub(crate) fn told_next(next: Option<&Step>) -> String {
    next.map_or("all steps are done".into(), |step| format!("next: {}", step.command))
}

/// Says on what a step would rest that is out of date.
pub(crate) fn warn(ledger: &Ledger<'_>, name: &str) -> Result<(), Failure> {
    for step in of_ledger(ledger)? {
        if rests_on(name).contains(&step.name) && step.state == State::OutOfDate {
            let (what, is, told) = (step.name, step.verb(), step.told());
            eprintln!("warning: the {what} {is} {told}; make it anew with: {}", step.command);
        }
    }
    Ok(())
}

/// Why a result that is there is not replaced, and how it is.
pub(crate) fn is_there(session: &Session, result: &str) -> Failure {
    let plain = Failure::from(material::FileError::Exists { path: session.path(result) });
    let steps = steps(session).unwrap_or_default();
    match steps.iter().find(|step| step.result == Some(result)) {
        Some(step) if matches!(step.state, State::OutOfDate | State::Damaged) => {
            let error = format!("{}; it is {}", plain.error, step.told());
            Failure { error, ..plain }.hint(format!("replace it with: {}", step.command))
        }
        _ => plain,
    }
}
