//! What each result of a session is made from. A result keeps this list as it was when it was
//! made; where the list is another one now, the result is out of date.

use super::ledger::{Ledger, Source};
use crate::Failure;
use crate::adaptive;
use crate::commands::{calibrate, solve, verify};
use crate::measurement::{ARRAYS, INDEX};
use crate::sensor::NOISE;
use crate::session::RigConfig;
use material::hash_file;
use rig::{Inventory, NOISE_DARK_SHOT, Plan};

/// The calibration: boards, chart and sheet, and what the rig is said to be. The camera's measured
/// noise is left out: it only weighs the frames of bright sheets.
pub(crate) fn calibration(ledger: &Ledger<'_>) -> Result<Vec<Source>, Failure> {
    let session = ledger.session;
    let (board, noise) = calibrate::described(session)?;
    let sample = &session.config.sample;
    let mut out = ledger.frames(&session.acquisition().calibration_plan());
    out.push(ledger.settings("board", &board)?);
    out.push(ledger.settings("noise", &noise)?);
    out.push(ledger.settings("grid or lit face", &(sample.grid, sample.lit_face))?);
    Ok(out)
}

/// The measurement: the sample's pictures, the calibration, and the camera's noise and dark frames
/// where they were measured. An imported one has its pictures elsewhere.
pub(crate) fn measurement(ledger: &Ledger<'_>) -> Result<Vec<Source>, Failure> {
    let session = ledger.session;
    if matches!(session.config.rig, RigConfig::Imported) {
        return Ok(Vec::new());
    }
    let sample = &session.config.sample;
    let mut out = ledger.frames(&adaptive::sample_plan(session)?);
    let mut darks = session.acquisition().noise_plan();
    darks.shots.retain(|shot| shot.name == NOISE_DARK_SHOT);
    let found = Inventory::of(&darks, session.folder(), &ledger.journal);
    if found.taken == found.wanted {
        out.extend(ledger.frames(&darks));
    }
    out.push(ledger.file(calibrate::RESULT));
    out.push(ledger.file(NOISE));
    out.push(ledger.settings("grid or lit face", &(sample.grid, sample.lit_face))?);
    Ok(out)
}

/// The material; the block that it is solved for is compared by itself.
pub(crate) fn material(ledger: &Ledger<'_>) -> Vec<Source> {
    vec![ledger.file(ARRAYS), ledger.file(INDEX)]
}

/// The verification.
pub(crate) fn verification(ledger: &Ledger<'_>) -> Vec<Source> {
    [solve::MATERIAL, ARRAYS, INDEX].map(|name| ledger.file(name)).into()
}

/// The files for other programs.
pub(crate) fn export(ledger: &Ledger<'_>) -> Vec<Source> {
    vec![ledger.file(solve::MATERIAL)]
}

/// The page: everything that it shows.
pub(crate) fn report(ledger: &Ledger<'_>) -> Result<Vec<Source>, Failure> {
    let files =
        [calibrate::RESULT, ARRAYS, INDEX, solve::MATERIAL, solve::CONVERGENCE, verify::RESULT];
    let mut out: Vec<Source> = files.map(|name| ledger.file(name)).into();
    out.push(ledger.settings("sample", &ledger.session.config.sample)?);
    Ok(out)
}

/// Refuses frames that are not those that the plan asks for, or that were changed since they were
/// taken. `command` takes them again.
pub(crate) fn check_frames(ledger: &Ledger<'_>, plan: &Plan, command: &str) -> Result<(), Failure> {
    let session = ledger.session;
    let found = Inventory::of(plan, session.folder(), &ledger.journal);
    if let Some(first) = found.otherwise.first() {
        let error = format!(
            "{first}: taken with another target, pattern or exposure time than session.toml asks for now"
        );
        return Err(Failure::input(error).hint(session.branch_hint()));
    }
    for source in ledger.frames(plan) {
        let path = session.path(&source.name);
        if path.is_file() && source.blake3.as_ref() != Some(&hash_file(&path)?) {
            let error = format!("{}: has changed since it was taken", source.name);
            let hint = format!("take it again: {}", session.command(command));
            return Err(Failure::input(error).hint(hint));
        }
    }
    Ok(())
}
