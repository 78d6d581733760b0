//! Files that are either the old one, whole, or the new one, whole.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::FileError;

/// What to do where a file of that name is already there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overwrite {
    /// Leave it alone and report [`FileError::Exists`].
    #[default]
    Refuse,
    /// Put the new file in its place.
    Replace,
}

/// Writes a file under a temporary name in the same folder, syncs it and renames it, so
/// that a reader, or the next run after a power failure, never meets half a file.
///
/// `write` gets a buffered, seekable file; flushing and syncing are done here. When it
/// fails, nothing is left behind and a file that was there stays as it was.
///
/// # Errors
/// [`FileError::Exists`] where `overwrite` is [`Overwrite::Refuse`] and the name is taken,
/// also when it was taken while `write` ran; [`FileError::Io`] otherwise.
pub fn atomic_write(
    path: &Path,
    overwrite: Overwrite,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), FileError> {
    let failed = |source| FileError::Io { path: path.into(), action: "write", source };
    let unfinished = Unfinished::begin(path, overwrite)?;
    // `write` gets a handle of its own; the guard that deletes on failure stays here.
    let mut file = BufWriter::new(unfinished.temporary.reopen().map_err(failed)?);
    write(&mut file).map_err(failed)?;
    file.flush().map_err(failed)?;
    drop(file);
    unfinished.finish()
}

/// Copies a file's content as [`atomic_write`] writes one.
///
/// # Errors
/// Those of [`atomic_write`], and that `from` cannot be read.
pub fn atomic_copy(from: &Path, to: &Path, overwrite: Overwrite) -> Result<(), FileError> {
    let mut source = File::open(from).map_err(FileError::reading(from))?;
    let mut unfinished = Unfinished::begin(to, overwrite)?;
    // Which of the two files failed is not told.
    let failed = |source| FileError::Io { path: from.into(), action: "copy", source };
    io::copy(&mut source, unfinished.file()).map_err(failed)?;
    unfinished.finish()
}

/// The two halves of [`atomic_write`], for who writes a file on one thread and waits for the disk
/// on another. A file that is not finished leaves nothing behind when it is dropped.
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
    overwrite: Overwrite,
    temporary: tempfile::NamedTempFile,
}

impl Unfinished {
    /// How the names of temporary files begin.
    pub const PREFIX: &str = ".part-";

    /// Opens a temporary file beside `path`.
    ///
    /// # Errors
    /// [`FileError::Exists`] where `overwrite` is [`Overwrite::Refuse`] and the name is taken,
    /// [`FileError::Io`] where the folder takes no file.
    pub fn begin(path: &Path, overwrite: Overwrite) -> Result<Self, FileError> {
        // Asked before the work as well as after, so that a long export does not run for nothing.
        if overwrite == Overwrite::Refuse && path.symlink_metadata().is_ok() {
            return Err(FileError::Exists { path: path.into() });
        }
        let mut builder = tempfile::Builder::new();
        builder.prefix(Self::PREFIX);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // A temporary file is private by default; the finished one obeys the umask.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let failed = |source| FileError::Io { path: path.into(), action: "write", source };
        let temporary = builder.tempfile_in(folder_of(path)).map_err(failed)?;
        Ok(Self { path: path.into(), overwrite, temporary })
    }

    /// The file, empty at first; it is not buffered.
    pub fn file(&mut self) -> &mut File {
        self.temporary.as_file_mut()
    }

    /// Syncs the file and gives it its name.
    ///
    /// # Errors
    /// [`FileError::Exists`] where the name was taken meanwhile and may not be;
    /// [`FileError::Io`] otherwise.
    pub fn finish(self) -> Result<(), FileError> {
        let Self { path, overwrite, temporary } = self;
        let failed = |source| FileError::Io { path: path.clone(), action: "write", source };
        temporary.as_file().sync_all().map_err(failed)?;
        let renamed = match overwrite {
            Overwrite::Replace => temporary.persist(&path),
            Overwrite::Refuse => temporary.persist_noclobber(&path),
        };
        if let Err(failure) = renamed {
            return Err(match (overwrite, failure.error.kind()) {
                (Overwrite::Refuse, io::ErrorKind::AlreadyExists) => {
                    FileError::Exists { path: path.clone() }
                }
                _ => failed(failure.error),
            });
        }
        // The new name itself has to reach the disk. Folders cannot be opened on Windows.
        #[cfg(unix)]
        File::open(folder_of(&path)).and_then(|folder| folder.sync_all()).map_err(failed)?;
        Ok(())
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_only_when_told_and_leaves_nothing_behind_on_failure() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let put = |text: &'static str, overwrite| {
            atomic_write(&path, overwrite, |f| f.write_all(text.as_bytes()))
        };
        put("one", Overwrite::Refuse).unwrap();
        assert!(matches!(put("two", Overwrite::Refuse), Err(FileError::Exists { .. })));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "one");
        put("two", Overwrite::Replace).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "two");

        let failing = atomic_write(&path, Overwrite::Replace, |f| {
            f.write_all(b"thr")?;
            Err(io::Error::other("lost"))
        });
        assert!(failing.unwrap_err().to_string().contains("a.txt"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "two");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn copies_are_whole_or_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name| folder.path().join(name);
        let content: Vec<u8> = (0..300_000_u32).map(|i| (i.wrapping_mul(i) >> 8) as u8).collect();
        std::fs::write(path("from"), &content).unwrap();
        atomic_copy(&path("from"), &path("to"), Overwrite::Refuse).unwrap();
        assert!(std::fs::read(path("to")).unwrap() == content);

        std::fs::write(path("from"), "short").unwrap();
        let refused = atomic_copy(&path("from"), &path("to"), Overwrite::Refuse);
        assert!(matches!(refused, Err(FileError::Exists { path: there }) if there == path("to")));
        assert!(std::fs::read(path("to")).unwrap() == content);
        // The second one can be opened, but has nothing to read.
        std::fs::create_dir(path("folder")).unwrap();
        for from in ["none", "folder"] {
            let error = atomic_copy(&path(from), &path("to"), Overwrite::Replace).unwrap_err();
            assert!(error.to_string().contains(from), "{error}");
            assert!(std::fs::read(path("to")).unwrap() == content);
        }
        atomic_copy(&path("from"), &path("to"), Overwrite::Replace).unwrap();
        assert_eq!(std::fs::read_to_string(path("to")).unwrap(), "short");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
    }

    /// The name is taken while the writer is at work: the race is lost, not the other's file.
    #[test]
    fn a_file_that_appears_meanwhile_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let outcome = atomic_write(&path, Overwrite::Refuse, |f| {
            std::fs::write(&path, "other")?;
            f.write_all(b"mine")
        });
        assert!(matches!(outcome, Err(FileError::Exists { .. })));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "other");
    }

    #[cfg(unix)]
    #[test]
    fn finished_files_obey_the_umask() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("a"), folder.path().join("b"));
        atomic_write(&ours, Overwrite::Refuse, |f| f.write_all(b"x")).unwrap();
        std::fs::write(&plain, "x").unwrap();
        let mode = |p| std::fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }
}
