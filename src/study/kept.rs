//! Rows of a study that are done, kept beside its table until it is whole, so that a study that was
//! interrupted goes on where it was.

use crate::Failure;
use crate::output::counted;
use material::{Overwrite, atomic_write};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The rows so far, each under a key of its own.
pub(crate) struct Kept<T> {
    path: PathBuf,
    settings: String,
    rows: Vec<Row<T>>,
}

#[derive(Serialize, Deserialize)]
struct Head {
    /// Hash of what the rows depend on.
    settings: String,
}

#[derive(Serialize, Deserialize)]
struct Row<T> {
    key: String,
    row: T,
}

impl<T: Serialize + DeserializeOwned> Kept<T> {
    /// The rows that an interrupted run left beside `table`, if these are what they depend on.
    ///
    /// # Errors
    /// The file cannot be read or is none of these; its rows have other settings, unless they may be
    /// replaced.
    pub fn open(
        table: &Path,
        settings: &impl Serialize,
        overwrite: Overwrite,
    ) -> Result<Self, Failure> {
        let path = table.with_extension("partial.jsonl");
        let settings = serde_json::to_vec(&(env!("CARGO_PKG_VERSION"), settings));
        let settings = blake3::hash(&settings.map_err(Failure::other)?).to_hex().to_string();
        let told = path.display();
        let mut rows = Vec::new();
        match std::fs::read_to_string(&path) {
            Ok(text) => {
                let bad = |e: serde_json::Error| {
                    Failure::input(format!("{told}: these are no rows of this study: {e}"))
                        .hint(format!("move {told} away"))
                };
                let mut lines = text.lines();
                let head: Result<Head, _> = serde_json::from_str(lines.next().unwrap_or(""));
                match (head, overwrite) {
                    (Ok(head), _) if head.settings == settings => {
                        rows = lines
                            .map(serde_json::from_str)
                            .collect::<Result<_, _>>()
                            .map_err(bad)?;
                    }
                    (_, Overwrite::Replace) => {}
                    (Err(error), Overwrite::Refuse) => return Err(bad(error)),
                    (Ok(_), Overwrite::Refuse) => {
                        let error = format!(
                            "{told}: rows of an unfinished study with other settings, or by another version"
                        );
                        return Err(Failure::input(error).hint(
                            "finish it with the options it was begun with, or start over with --force",
                        ));
                    }
                }
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => {
                return Err(Failure::input(format!("{told}: cannot be read: {error}")));
            }
        }
        Ok(Self { path, settings, rows })
    }

    /// Whether a row is done.
    pub fn has(&self, key: &str) -> bool {
        self.rows.iter().any(|row| row.key == key)
    }

    /// The row of that key; `make` is asked for one that is not done yet, which is then kept.
    ///
    /// # Errors
    /// What `make` fails with, and that the file cannot be written.
    pub fn row(
        &mut self,
        key: &str,
        make: impl FnOnce() -> Result<T, Failure>,
    ) -> Result<(), Failure> {
        if self.has(key) {
            return Ok(());
        }
        let row = make().map_err(|failure| self.told(failure))?;
        self.rows.push(Row { key: key.to_owned(), row });
        let mut text = serde_json::to_vec(&Head { settings: self.settings.clone() });
        for row in &self.rows {
            let line = serde_json::to_vec(row);
            text = text.and_then(|text| Ok([text, line?].join(&b'\n')));
        }
        let text = text.map_err(Failure::other)?;
        atomic_write(&self.path, Overwrite::Replace, |file| file.write_all(&text))?;
        Ok(())
    }

    /// A failure, with what is not lost.
    pub fn told(&self, failure: Failure) -> Failure {
        if failure.code != 1 || self.rows.is_empty() {
            return failure;
        }
        let rows = counted(self.rows.len(), "row");
        let error = format!("{}; {rows} kept in {}", failure.error, self.path.display());
        Failure { error, ..failure }.hint("run the same command again: it goes on where it was")
    }

    /// All rows, in the order in which they were made.
    pub fn rows(&self) -> Vec<&T> {
        self.rows.iter().map(|row| &row.row).collect()
    }

    /// Removes the file: the table is written.
    ///
    /// # Errors
    /// It cannot be removed.
    pub fn finish(self) -> Result<(), Failure> {
        match std::fs::remove_file(&self.path) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(Failure::other(format!("{}: cannot be removed: {error}", self.path.display())))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(table: &Path, settings: u32, overwrite: Overwrite) -> Result<Kept<f64>, Failure> {
        Kept::open(table, &settings, overwrite)
    }

    #[test]
    fn rows_are_kept_until_the_table_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let table = folder.path().join("study.csv");
        let file = folder.path().join("study.partial.jsonl");
        let mut kept = open(&table, 1, Overwrite::Refuse).unwrap();
        kept.row("a", || Ok(0.1)).unwrap();
        let stopped = kept.row("b", || Err(Failure::other("interrupted"))).unwrap_err();
        assert!(stopped.error.contains("1 row kept in") && stopped.code == 1, "{stopped:?}");
        drop(kept);

        let mut kept = open(&table, 1, Overwrite::Refuse).unwrap();
        kept.row("a", || panic!("it is there")).unwrap();
        kept.row("b", || Ok(0.2)).unwrap();
        assert_eq!(kept.rows(), [&0.1, &0.2]);

        let other = open(&table, 2, Overwrite::Refuse).map(|_| ()).unwrap_err();
        assert!(other.code == 2 && other.hint.unwrap().contains("--force"), "{}", other.error);
        assert!(open(&table, 2, Overwrite::Replace).unwrap().rows().is_empty());
        kept.finish().unwrap();
        assert!(!file.exists());

        std::fs::write(&file, "nothing of ours").unwrap();
        assert_eq!(open(&table, 1, Overwrite::Refuse).map(|_| ()).unwrap_err().code, 2);
    }
}
