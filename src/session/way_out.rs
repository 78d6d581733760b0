//! Commands that lead on, with the session's own folder in them.

use super::{FILE, Session};
use crate::Failure;
use rig::{JournalError, RunError};
use std::path::{Path, PathBuf};

impl Session {
    /// A command with this session's folder in the place of SESSION.
    pub(super) fn filled(&self, command: &str) -> String {
        command.replace("SESSION", &quoted(&self.folder))
    }

    /// `diaphane` with `words`, and this session's folder in the place of SESSION.
    pub fn command(&self, words: &str) -> String {
        self.filled(&format!("diaphane {words}"))
    }

    /// How a changed plan goes on elsewhere.
    pub fn branch_command(&self) -> String {
        self.command(&format!("branch SESSION {}", quoted(&free_beside(&self.folder))))
    }

    /// The way out where the plan is another one than that of the pictures.
    pub fn branch_hint(&self) -> String {
        format!(
            "put the old values back into {}, or go on with the new ones in a session of their own: {}",
            self.path(FILE).display(),
            self.branch_command()
        )
    }

    /// A failed run, with the way out that this session has.
    pub fn run_failure(&self, error: RunError) -> Failure {
        let hint = match &error {
            RunError::OtherSettings { .. } => self.branch_hint(),
            RunError::Journal(JournalError::InUse { .. }) => format!(
                "wait until it has ended, or end it with Ctrl-C; how far it is: {}",
                self.command("status SESSION")
            ),
            _ => return error.into(),
        };
        Failure::from(error).hint(hint)
    }
}

/// A path as it can be typed into a shell.
pub(super) fn quoted(path: &Path) -> String {
    let path = path.display().to_string();
    if path.contains(char::is_whitespace) { format!("\"{path}\"") } else { path }
}

/// The first folder of the names `folder-2`, `folder-3`, … that is not there.
fn free_beside(folder: &Path) -> PathBuf {
    // "." and ".." have no name of their own.
    let whole = match folder.file_name() {
        Some(_) => folder.to_owned(),
        None => folder.canonicalize().unwrap_or_default(),
    };
    let name = whole.file_name().map_or("session".into(), |name| name.to_string_lossy());
    // Names such as wax-2 count on.
    let (stem, from) = match name.rsplit_once('-').map(|(stem, n)| (stem, n.parse::<u32>())) {
        Some((stem, Ok(n))) if n < 1000 => (stem.to_owned(), n + 1),
        _ => (name.into_owned(), 2),
    };
    let places = (from..).map(|n| whole.with_file_name(format!("{stem}-{n}")));
    places.into_iter().find(|place| !place.exists()).unwrap_or_else(|| whole.join("branch"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn branches_are_named_after_their_session_and_counted() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert_eq!(free_beside(&at("wax")), at("wax-2"));
        std::fs::create_dir(at("wax-2")).unwrap();
        assert_eq!(free_beside(&at("wax")), at("wax-3"));
        assert_eq!(free_beside(&at("wax-2")), at("wax-3"));
        assert_eq!(free_beside(&at("old-marble")), at("old-marble-2"));
        // A date is no count.
        assert_eq!(free_beside(&at("2026-1123")), at("2026-1123-2"));
        let here = std::env::current_dir().unwrap();
        assert_eq!(free_beside(Path::new(".")).parent(), here.parent());
        assert_eq!(quoted(Path::new("my wax")), "\"my wax\"");
    }
}
