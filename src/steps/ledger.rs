//! What a session's files are now, by the hashes of their content. Each file is read once at most;
//! frames are not read where the journal knows them.

use crate::Failure;
use crate::session::Session;
use material::{Input, hash_file};
use rig::{Plan, Recorded, frame_path, read_journal};
use serde::Serialize;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// The files of one session.
pub(crate) struct Ledger<'a> {
    pub session: &'a Session,
    pub journal: Recorded,
    frames: BTreeMap<String, String>,
    hashes: RefCell<BTreeMap<String, Option<String>>>,
}

/// Something that a step works from, as it is now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Source {
    /// Its file as seen from the session, or the part of `session.toml`.
    pub name: String,
    /// None where it is not there, so that nobody can say whether it is another one now.
    pub blake3: Option<String>,
}

impl<'a> Ledger<'a> {
    pub fn of(session: &'a Session) -> Result<Self, Failure> {
        let journal = read_journal(&session.path("journal.jsonl"))?;
        let owned = |(file, hash): (&str, &str)| (file.to_owned(), hash.to_owned());
        let frames = journal.frame_hashes().into_iter().map(owned).collect();
        Ok(Self { session, journal, frames, hashes: RefCell::default() })
    }

    /// A file of the session.
    pub fn file(&self, name: &str) -> Source {
        let mut known = self.hashes.borrow_mut();
        let hash = || hash_file(&self.session.path(name)).ok();
        let blake3 = known.entry(name.to_owned()).or_insert_with(hash).clone();
        Source { name: name.to_owned(), blake3 }
    }

    /// The frames of a plan, as the journal says.
    pub fn frames(&self, plan: &Plan) -> Vec<Source> {
        let mut out = Vec::new();
        for shot in &plan.shots {
            for exposure in 0..shot.exposures_s.len() {
                for repeat in 0..shot.repeats {
                    let name = frame_path(&shot.name, exposure, repeat);
                    out.push(match self.frames.get(&name) {
                        Some(hash) => Source { blake3: Some(hash.clone()), name },
                        None => self.file(&name),
                    });
                }
            }
        }
        out
    }

    /// A part of `session.toml`: other parts may change without any harm to what was made from it.
    pub fn settings(&self, part: &str, value: &impl Serialize) -> Result<Source, Failure> {
        let text = serde_json::to_vec(value).map_err(Failure::other)?;
        let blake3 = Some(blake3::hash(&text).to_hex().to_string());
        Ok(Source { name: format!("{SETTINGS}{part}"), blake3 })
    }
}

/// How the names of parts of `session.toml` begin.
const SETTINGS: &str = "session.toml: ";

/// What a result keeps of what it was made from.
pub(crate) fn inputs(sources: &[Source]) -> Vec<Input> {
    let known = |s: &Source| Some(Input { name: s.name.clone(), blake3: s.blake3.clone()? });
    sources.iter().filter_map(known).collect()
}

/// Why a result that was made from `made` is out of date, if its sources are others `now`.
pub(crate) fn difference(made: &[Input], now: &[Source]) -> Option<String> {
    let then: BTreeMap<&str, &str> =
        made.iter().map(|i| (i.name.as_str(), i.blake3.as_str())).collect();
    let mut other = Vec::new();
    let mut new = Vec::new();
    for source in now {
        let Some(hash) = &source.blake3 else { continue };
        match then.get(source.name.as_str()) {
            Some(made) if made == hash => {}
            Some(_) => other.push(source.name.as_str()),
            None => new.push(source.name.as_str()),
        }
    }
    let gone = made.iter().map(|input| input.name.as_str());
    let gone = gone.filter(|name| !now.iter().any(|source| source.name == *name)).collect();
    let mut told = Vec::new();
    for (names, one, several) in [
        (other, "from another", "from other"),
        (new, "without the", "without the"),
        (gone, "with a former", "with former"),
    ] {
        told.extend(words(&names, one, several));
    }
    // Two files of one result are one to people.
    told.dedup();
    (!told.is_empty()).then(|| format!("made {}", told.join(", ")))
}

/// What `names` are, after "from another" or the like; `several` stands before pictures.
fn words(names: &[&str], one: &str, several: &str) -> Vec<String> {
    let (frames, files): (Vec<&str>, Vec<&str>) =
        names.iter().partition(|name| name.starts_with("frames/"));
    let word = |name: &str| match name.strip_prefix(SETTINGS) {
        Some(part) => format!("{one} {part} than session.toml has now"),
        None => format!("{one} {}", result_of(name)),
    };
    let mut out: Vec<String> = files.into_iter().map(word).collect();
    if let Some(first) = frames.first() {
        let more = match frames.len() {
            1 => String::new(),
            n => format!(" and {} more", n - 1),
        };
        out.push(format!("{several} pictures ({first}{more})"));
    }
    out
}

/// The result that a file belongs to, in a word.
fn result_of(file: &str) -> &str {
    use crate::commands::{calibrate, solve, verify};
    use crate::measurement::{ARRAYS, INDEX};
    match file {
        calibrate::RESULT => "calibration",
        crate::sensor::NOISE => "measurement of the camera's noise",
        ARRAYS | INDEX => "measurement",
        solve::MATERIAL | solve::CONVERGENCE => "material",
        verify::RESULT => "verification",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(names: &[&str]) -> Vec<Input> {
        names.iter().map(|name| Input { name: (*name).into(), blake3: "1".into() }).collect()
    }

    fn now(sources: &[(&str, Option<&str>)]) -> Vec<Source> {
        let source = |(name, hash): &(&str, Option<&str>)| Source {
            name: (*name).into(),
            blake3: hash.map(str::to_owned),
        };
        sources.iter().map(source).collect()
    }

    #[test]
    fn a_difference_is_told_in_the_words_of_the_steps() {
        let material = "material/material.diaphane";
        let (a, b) = ("frames/black/black-e0-r0.png", "frames/black/black-e1-r0.png");
        for (made_from, is_now, told) in [
            (vec![material], vec![(material, Some("1"))], None),
            // Not there any more: nobody knows.
            (vec![material], vec![(material, None)], None),
            (vec![material], vec![(material, Some("2"))], Some("made from another material")),
            (
                vec![material],
                vec![(material, Some("1")), ("calibration/calibration.json", Some("1"))],
                Some("made without the calibration"),
            ),
            (
                vec![a, b],
                vec![(a, Some("2")), (b, Some("2"))],
                Some("made from other pictures (frames/black/black-e0-r0.png and 1 more)"),
            ),
            (vec![a, b], vec![(a, Some("1"))], Some("made with former pictures")),
            (vec![a], vec![(a, Some("1")), (b, Some("1"))], Some("made without the pictures")),
            // The two files of a measurement are one to people.
            (
                vec!["measurement/measurement.npz", "measurement/measurement.json"],
                vec![
                    ("measurement/measurement.npz", Some("2")),
                    ("measurement/measurement.json", Some("2")),
                ],
                Some("made from another measurement"),
            ),
            (
                vec!["session.toml: board"],
                vec![("session.toml: board", Some("2"))],
                Some("made from another board than session.toml has now"),
            ),
        ] {
            let found = difference(&made(&made_from), &now(&is_now));
            match told {
                None => assert_eq!(found, None),
                Some(told) => {
                    let found = found.unwrap_or_default();
                    assert!(found.starts_with(told), "{found:?}, not {told:?}");
                    assert_eq!(
                        found.matches("measurement").count(),
                        told.matches("measurement").count()
                    );
                }
            }
        }
    }
}
