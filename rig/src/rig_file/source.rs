//! The text of a rig file, and where in it each value stands: a mistake is told by line and key.

use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue, Deserializer};

use super::RigFile;

/// Parts whose other keys depend on their `driver`.
const DRIVEN: [&[&str]; 5] =
    [&["camera"], &["projector", "display"], &["projector", "control"], &["stage"], &["hands"]];

/// A text that is TOML.
pub(super) struct Source<'a> {
    text: &'a str,
    root: Spanned<DeTable<'a>>,
    places: Vec<Place>,
}

/// Where a key and its value stand, bytes from the start of the text.
struct Place {
    /// From the root of the file, such as `stage.axes[0].range`.
    key: String,
    name: Range<usize>,
    value: Range<usize>,
}

/// Why a text is no rig file.
pub(super) struct Mistake {
    /// Counted from 1.
    pub line: Option<usize>,
    /// From the root of the file; none where the text is no TOML.
    pub key: Option<String>,
    pub message: String,
}

impl<'a> Source<'a> {
    pub fn parse(text: &'a str) -> Result<Self, Mistake> {
        let root = DeTable::parse(text).map_err(|error| Mistake {
            line: error.span().map(|span| line(text, span.start)),
            key: None,
            message: error.message().to_owned(),
        })?;
        let mut places = Vec::new();
        collect(root.get_ref(), "", &mut places);
        Ok(Self { text, root, places })
    }

    pub fn version(&self) -> Result<u32, Mistake> {
        #[derive(Deserialize)]
        struct Version {
            version: u32,
        }
        let read = Version::deserialize(Deserializer::from(self.root.clone()));
        read.map(|found| found.version).map_err(|error| self.mistake(&error))
    }

    pub fn read(&self) -> Result<RigFile, Mistake> {
        let mut root = self.root.clone();
        for path in DRIVEN {
            if let Some(part) = part(root.get_mut(), path) {
                name_by_driver(part).map_err(|(span, message)| self.at(span, message))?;
            }
        }
        RigFile::deserialize(Deserializer::from(root)).map_err(|error| self.mistake(&error))
    }

    /// The line of a key, from the root of the file.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        let place = self.places.iter().find(|place| place.key == key)?;
        Some(line(self.text, place.name.start))
    }

    fn mistake(&self, error: &toml::de::Error) -> Mistake {
        let message = in_plain_words(error.message());
        match error.span() {
            Some(span) => self.at(span, message),
            None => Mistake { line: None, key: None, message },
        }
    }

    fn at(&self, span: Range<usize>, message: String) -> Mistake {
        let here = |place: &&Place| place.name == span || place.value == span;
        // What stands in a table comes after it.
        let key = self.places.iter().rfind(here).map(|place| place.key.clone());
        Mistake { line: Some(line(self.text, span.start)), key, message }
    }
}

fn line(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|&byte| byte == b'\n').count()
}

fn collect(table: &DeTable<'_>, above: &str, places: &mut Vec<Place>) {
    for (name, value) in table {
        let dot = if above.is_empty() { "" } else { "." };
        let key = format!("{above}{dot}{}", name.get_ref());
        collect_value(value, key, name.span(), places);
    }
}

fn collect_value(
    value: &Spanned<DeValue<'_>>,
    key: String,
    name: Range<usize>,
    places: &mut Vec<Place>,
) {
    places.push(Place { key: key.clone(), name, value: value.span() });
    match value.get_ref() {
        DeValue::Table(table) => collect(table, &key, places),
        DeValue::Array(values) => {
            for (i, value) in values.iter().enumerate() {
                collect_value(value, format!("{key}[{i}]"), value.span(), places);
            }
        }
        _ => {}
    }
}

fn part<'t, 'a>(table: &'t mut DeTable<'a>, path: &[&str]) -> Option<&'t mut Spanned<DeValue<'a>>> {
    let (first, rest) = path.split_first()?;
    let value = table.get_mut(*first)?;
    if rest.is_empty() {
        return Some(value);
    }
    match value.get_mut() {
        DeValue::Table(inner) => part(inner, rest),
        _ => None,
    }
}

/// Makes of a part whose `driver` stands among its other keys one that has nothing but the driver's
/// name, with the other keys below it. A driver that were read from among them (serde's internal
/// tag) would cost every one of them its place in the text.
fn name_by_driver(part: &mut Spanned<DeValue<'_>>) -> Result<(), (Range<usize>, String)> {
    let span = part.span();
    // Whatever else it is, its type is refused when it is read.
    let DeValue::Table(keys) = part.get_mut() else { return Ok(()) };
    let Some(driver) = keys.remove("driver") else {
        return Err((span, "missing field `driver`".into()));
    };
    let at = driver.span();
    let DeValue::String(name) = driver.into_inner() else {
        return Err((at, "expected the name of a driver, in quotes".into()));
    };
    let rest = std::mem::take(keys);
    keys.insert(Spanned::new(at, name), Spanned::new(span, DeValue::Table(rest)));
    Ok(())
}

/// Types by the words of people who write rig files, not programs.
fn in_plain_words(message: &str) -> String {
    const WORDS: [(&str, &str); 6] = [
        ("expected u8", "expected a whole number from 0 to 255"),
        ("expected u16", "expected a whole number from 0 to 65535"),
        ("expected u32", "expected a whole number, 0 or more"),
        ("expected i32", "expected a whole number"),
        ("expected f64", "expected a number"),
        ("expected a string", "expected text in quotes"),
    ];
    // What was found is quoted as it stands, and may hold any words.
    let (found, expected) = match message.rfind("expected ") {
        Some(at) => message.split_at(at),
        None => ("", message),
    };
    let expected = WORDS.iter().find(|(type_, _)| *type_ == expected).map_or(expected, |w| w.1);
    format!("{found}{expected}")
}
