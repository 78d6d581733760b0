//! What a result is worth: whether it is there, whole, and made from what is there now.

use super::inputs;
use super::ledger::{Ledger, Source, difference};
use crate::Failure;
use crate::commands::solve::{CONVERGENCE, Convergence};
use crate::commands::{calibrate, export, report, solve, verify};
use crate::measurement::{self, ARRAYS};
use crate::session::Session;
use material::{Input, Material};
use serde::Serialize;

/// What a step's result is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum State {
    /// Nothing is there, or not all of it.
    Missing,
    /// Whole, and made from what is there now.
    Done,
    /// Made from something else than is there now.
    OutOfDate,
    /// It cannot be read, or is not as it was written.
    Damaged,
}

/// A state and a word on it.
pub(super) struct Judgement {
    pub state: State,
    pub remark: Option<String>,
}

impl Judgement {
    fn done() -> Self {
        Self { state: State::Done, remark: None }
    }

    /// By what it was `made` from and what that is `now`.
    fn of(made: &[Input], now: &[Source]) -> Self {
        if made.is_empty() && !now.is_empty() {
            let remark = "an earlier version, which did not note from what, made it";
            return Self { state: State::Done, remark: Some(remark.into()) };
        }
        Self::by(difference(made, now))
    }

    /// Out of date if there is a reason.
    fn by(reason: Option<String>) -> Self {
        match reason {
            None => Self::done(),
            remark => Self { state: State::OutOfDate, remark },
        }
    }
}

/// Looks at a result by its file.
pub(super) fn judge(ledger: &Ledger<'_>, result: &str) -> Result<Judgement, Failure> {
    if !ledger.session.path(result).exists() {
        return Ok(Judgement { state: State::Missing, remark: None });
    }
    let looked = match result {
        calibrate::RESULT => calibration(ledger),
        ARRAYS => measured(ledger),
        solve::MATERIAL => solved(ledger),
        verify::RESULT => verified(ledger),
        export::NPZ => exported(ledger),
        report::RESULT => reported(ledger),
        _ => Ok(Judgement::done()),
    };
    Ok(looked
        .unwrap_or_else(|failure| Judgement { state: State::Damaged, remark: Some(failure.error) }))
}

fn calibration(ledger: &Ledger<'_>) -> Result<Judgement, Failure> {
    let made = calibrate::load(ledger.session)?.inputs;
    Ok(Judgement::of(&made, &inputs::calibration(ledger)?))
}

fn measured(ledger: &Ledger<'_>) -> Result<Judgement, Failure> {
    let made = measurement::made_from(ledger)?;
    let grid = ledger.session.config.sample.grid;
    if grid.cells()[..2] != made.cells {
        let [nx, ny] = made.cells;
        let why = format!("made on {nx} × {ny} cells, session.toml has {:?}", grid.cells());
        return Ok(Judgement::by(Some(why)));
    }
    Ok(Judgement::of(&made.inputs, &inputs::measurement(ledger)?))
}

fn solved(ledger: &Ledger<'_>) -> Result<Judgement, Failure> {
    let session = ledger.session;
    let material = Material::load(&session.path(solve::MATERIAL))?;
    let convergence: Convergence = session.read_json(CONVERGENCE, "diaphane solve SESSION")?;
    if let Some(what) = another_block(session, &material)? {
        let why = format!("made for another {what} than session.toml has now");
        return Ok(Judgement::by(Some(why)));
    }
    // Its other inputs, which those of the measurement go back to, are judged with that.
    let sources = inputs::material(ledger);
    let mut made = material.provenance().inputs.clone();
    made.retain(|input: &Input| sources.iter().any(|source| source.name == input.name));
    let mut out = Judgement::of(&made, &sources);
    if out.state == State::Done {
        out.remark = convergence.cut_off();
    }
    Ok(out)
}

/// What of the block is another in `session.toml`.
fn another_block(session: &Session, material: &Material) -> Result<Option<&'static str>, Failure> {
    let sample = &session.config.sample;
    let (then, now) = (material.optics(), sample.optics()?);
    // What went through JSON may differ in the last digit.
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * b.abs();
    let sizes = material.grid().spacing_mm().into_iter().zip(sample.grid.spacing_mm());
    let grid = material.grid().cells() == sample.grid.cells()
        && sizes.into_iter().all(|(then, now)| close(then, now));
    let optics = close(then.eta, now.eta)
        && close(then.boundary_constant, now.boundary_constant)
        && (then.boundary, then.lateral, then.illumination, then.scheme)
            == (now.boundary, now.lateral, now.illumination, now.scheme);
    Ok(match (grid, material.lit_face() == sample.lit_face, optics) {
        (false, ..) => Some("grid"),
        (_, false, _) => Some("lit face"),
        (.., false) => Some("optics (eta, boundary, sides, light or scheme)"),
        _ => None,
    })
}

fn verified(ledger: &Ledger<'_>) -> Result<Judgement, Failure> {
    let made: verify::Verification =
        ledger.session.read_json(verify::RESULT, "diaphane verify SESSION")?;
    Ok(Judgement::of(&made.inputs, &inputs::verification(ledger)))
}

fn exported(ledger: &Ledger<'_>) -> Result<Judgement, Failure> {
    let sources = inputs::export(ledger);
    let Some(record) = export::Record::read(ledger.session)? else {
        return Ok(Judgement::of(&[], &sources));
    };
    record.check_sizes(ledger.session)?;
    Ok(Judgement::of(&record.inputs, &sources))
}

fn reported(ledger: &Ledger<'_>) -> Result<Judgement, Failure> {
    let made = report::made_from(ledger.session)?;
    Ok(Judgement::of(&made, &inputs::report(ledger)?))
}
