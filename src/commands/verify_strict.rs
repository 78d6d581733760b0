//! `diaphane verify --strict`: does everything follow from the pictures once more?

use crate::Failure;
use crate::commands::calibrate;
use crate::commands::solve::MATERIAL;
use crate::commands::verify::{self, load_material};
use crate::commands::{demo, merge};
use crate::measurement::{ARRAYS, Measured, MeasuredPattern};
use crate::output::{Done, Progress, counted};
use crate::session::{FILE, RigConfig, Session};
use crate::steps::{Ledger, State, of_ledger};
use material::hash_file;
use rig::Purpose;
use serde::Serialize;
use serde_json::{Value, json};

/// Goes from the pictures to the figures, and ends at the first thing that differs.
pub(crate) fn run(session: &Session) -> Result<Done, Failure> {
    let ledger = Ledger::of(session)?;
    let mut checked = Vec::new();
    // Imported pictures are not the session's.
    if !matches!(session.config.rig, RigConfig::Imported) {
        checked.push(frames(&ledger)?);
    }
    checked.push(results(&ledger)?);
    let measured = match session.config.rig {
        RigConfig::Imported => {
            checked.push(
                "the imported pictures lie elsewhere: their measurement is taken as it is".into(),
            );
            Measured::load(session)?
        }
        RigConfig::Simulated { .. } | RigConfig::Devices { .. } => {
            let again = calibrate::derive(&ledger, |_, _| Ok(()))?;
            same(session, calibrate::RESULT, &again, &[])?;
            checked.push("calibration derived again: the same".into());
            let (again, _) = merge::derive(&ledger, |_, _| Ok(()))?;
            let kept = Measured::load(session)?;
            if let Some(what) = first_difference(&kept, &again) {
                return Err(differs(session, ARRAYS, &what));
            }
            checked.push("measurement derived again: the same".into());
            kept
        }
    };
    let again = verify::compare(session, &measured)?;
    // What it was made from was compared above.
    same(session, verify::RESULT, &again, &["inputs"])?;
    checked.push("figures derived again: the same".into());
    if session.path(demo::SUMMARY).is_file() {
        let figures = json!({
            "fit": again.fit,
            "bssrdf_error": again.bssrdf_error,
            "heldout_rel_rms": again.heldout_rel_rms,
        });
        let kept: Value = session.read_json(demo::SUMMARY, "diaphane verify SESSION")?;
        let kept: Value = ["fit", "bssrdf_error", "heldout_rel_rms"]
            .into_iter()
            .map(|key| (key.to_owned(), kept[key].clone()))
            .collect::<serde_json::Map<_, _>>()
            .into();
        if let Some(what) = difference("", &kept, &figures) {
            return Err(differs(session, demo::SUMMARY, &what));
        }
        checked.push("summary.json: the same".into());
    }
    let text = format!("{}\nnothing differs", checked.join("\n"));
    Ok(Done::new(json!({ "differs": false, "checked": checked }), text))
}

/// Every frame of the journal against its hash.
fn frames(ledger: &Ledger<'_>) -> Result<String, Failure> {
    let session = ledger.session;
    let written = ledger.journal.frame_hashes();
    let mut progress = Progress::new("frames", written.len());
    for (done, (file, hash)) in written.iter().enumerate() {
        progress.set(done, file);
        super::calibrate::go_on()?;
        let path = session.path(file);
        if !path.is_file() {
            let hint = format!("take it again: {}", session.command("capture SESSION"));
            return Err(Failure::input(format!("{file}: not there, the journal has it")).hint(hint));
        }
        let found = hash_file(&path)?;
        if found != *hash {
            let error = format!(
                "{file}: has changed since it was taken: BLAKE3 {found}, the journal has {hash}"
            );
            let hint = format!("take it again: {}", session.command("capture SESSION"));
            return Err(Failure::input(error).hint(hint));
        }
    }
    let told = format!("{}: as the journal has them", counted(written.len(), "picture"));
    progress.finish("as the journal has them");
    Ok(told)
}

/// Every result that the figures rest on, by the hashes of what it was made from.
fn results(ledger: &Ledger<'_>) -> Result<String, Failure> {
    let session = ledger.session;
    let steps = of_ledger(ledger)?;
    // Files for other programs and the page are no inputs of anything.
    let behind = |name: &str| !["export", "report"].contains(&name);
    if let Some(step) = steps.iter().find(|s| behind(s.name) && s.state != State::Done) {
        let told = match step.state {
            State::Missing => "not there yet".to_owned(),
            _ => step.told(),
        };
        let hint = format!("make it: {}", step.command);
        return Err(Failure::input(format!("{}: {told}", step.name)).hint(hint));
    }
    for input in &load_material(session)?.provenance().inputs {
        let now = ledger.file(&input.name).blake3;
        // The parts of session.toml that count were compared one by one.
        if input.name != FILE && now.as_ref() != Some(&input.blake3) {
            let now = now.map_or("is not there any more".into(), |hash| format!("is {hash} now"));
            let what =
                format!("made from {} with BLAKE3 {}, which {now}", input.name, input.blake3);
            let hint = format!("solve again: {}", session.command("solve SESSION --force"));
            return Err(Failure::input(format!("{MATERIAL}: {what}")).hint(hint));
        }
    }
    Ok("every result: made from what is there now".into())
}

/// Fails where a file of JSON is not what was derived again; top-level keys `but` are not compared.
fn same(
    session: &Session,
    file: &str,
    again: &impl Serialize,
    but: &[&str],
) -> Result<(), Failure> {
    let mut kept: Value = session.read_json(file, "diaphane verify SESSION")?;
    // By way of text, as what is kept went.
    let again = serde_json::to_vec(again).map_err(Failure::other)?;
    let mut again: Value = serde_json::from_slice(&again).map_err(Failure::other)?;
    for value in [&mut kept, &mut again] {
        if let Some(map) = value.as_object_mut() {
            but.iter().for_each(|key| drop(map.remove(*key)));
        }
    }
    match difference("", &kept, &again) {
        None => Ok(()),
        Some(what) => Err(differs(session, file, &what)),
    }
}

fn differs(session: &Session, file: &str, what: &str) -> Failure {
    Failure::input(format!("{}: {what}", session.path(file).display())).hint(
        "it was edited, or made by another version or on another machine; --force of its command makes it anew",
    )
}

/// Where two values differ first, and how.
fn difference(at: &str, kept: &Value, again: &Value) -> Option<String> {
    let below = |key: &str| if at.is_empty() { key.to_owned() } else { format!("{at}.{key}") };
    match (kept, again) {
        (Value::Object(a), Value::Object(b)) => {
            let keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
            let none = Value::Null;
            keys.into_iter().find_map(|key| {
                let side = |map: &serde_json::Map<String, Value>| map.get(key).cloned();
                let (a, b) = (side(a).unwrap_or(none.clone()), side(b).unwrap_or(none.clone()));
                difference(&below(key), &a, &b)
            })
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => a
            .iter()
            .zip(b)
            .enumerate()
            .find_map(|(i, (a, b))| difference(&below(&i.to_string()), a, b)),
        (Value::Array(a), Value::Array(b)) => {
            Some(format!("{at}: has {} entries, derived again {}", a.len(), b.len()))
        }
        (a, b) if a == b => None,
        (a, b) => Some(format!("{at}: is {a}, derived again {b}")),
    }
}

/// Where two measurements differ first, as they are kept: in single precision.
fn first_difference(kept: &Measured, again: &Measured) -> Option<String> {
    if (kept.cells, &kept.channels) != (again.cells, &again.channels) {
        let told = |m: &Measured| format!("{:?} cells in {}", m.cells, m.channels.join(", "));
        return Some(format!("has {}, derived again {}", told(kept), told(again)));
    }
    let names = |m: &Measured| -> Vec<(String, Purpose)> {
        m.patterns.iter().map(|p| (p.name.clone(), p.purpose)).collect()
    };
    if names(kept) != names(again) {
        return Some("has other patterns than follow from the pictures".into());
    }
    let [nx, _] = kept.cells;
    kept.patterns.iter().zip(&again.patterns).find_map(|(a, b)| {
        maps(a, &kept.channels).into_iter().zip(maps(b, &kept.channels)).find_map(
            |((what, a), (_, b))| {
                let pairs = a.iter().zip(b).enumerate();
                let mut pairs = pairs.map(|(i, (a, b))| (i, *a as f32, *b as f32));
                let (i, x, y) = pairs.find(|(_, x, y)| x.to_bits() != y.to_bits())?;
                let [column, row] = [i % nx, i / nx];
                Some(format!("{what} of cell {column}, {row} is {x:e}, derived again {y:e}"))
            },
        )
    })
}

/// The maps of a pattern with their names.
fn maps<'a>(pattern: &'a MeasuredPattern, channels: &[String]) -> Vec<(String, &'a [f64])> {
    let name = &pattern.name;
    let mut out = vec![(format!("{name}: irradiance"), pattern.irradiance.as_slice())];
    for (kind, maps) in [
        ("radiance", &pattern.radiance),
        ("variance", &pattern.variance),
        ("variance of lit pixels,", &pattern.lit_variance),
    ] {
        for (channel, map) in channels.iter().zip(maps) {
            out.push((format!("{name}: {kind} {channel}"), map.as_slice()));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use material::Face;

    #[test]
    fn the_first_difference_is_named_with_its_place() {
        let kept = json!({ "a": { "b": [1.0, 2.0] }, "c": 3 });
        let told = |again: Value| difference("", &kept, &again);
        assert_eq!(told(kept.clone()), None);
        for (again, expected) in [
            (json!({ "a": { "b": [1.0, 2.5] }, "c": 4 }), "a.b.1: is 2.0, derived again 2.5"),
            (json!({ "a": { "b": [1.0] }, "c": 3 }), "a.b: has 2 entries, derived again 1"),
            (json!({ "a": { "b": [1.0, 2.0] } }), "c: is 3, derived again null"),
            (json!({ "a": { "b": [1.0, 2.0] }, "c": 3, "d": 0 }), "d: is null, derived again 0"),
        ] {
            assert_eq!(told(again).as_deref(), Some(expected));
        }
    }

    fn measured(radiance: f64) -> Measured {
        let named = ("p".into(), Purpose::Fit);
        let radiance = vec![vec![0.5, 0.5, 0.5, radiance]];
        let (irradiance, variance) = (vec![1.0; 4], vec![vec![f64::INFINITY; 4]]);
        let place = (Face::Back, [2, 2]);
        let pattern = MeasuredPattern::new(named, place, irradiance, radiance, variance);
        Measured { patterns: vec![pattern], cells: [2, 2], channels: vec!["Y".into()] }
    }

    #[test]
    fn measurements_are_compared_as_they_are_kept() {
        assert_eq!(first_difference(&measured(0.1), &measured(0.1 + 1e-12)), None);
        let told = first_difference(&measured(0.1), &measured(0.2)).unwrap();
        assert_eq!(told, "p: radiance Y of cell 1, 1 is 1e-1, derived again 2e-1");
    }
}
