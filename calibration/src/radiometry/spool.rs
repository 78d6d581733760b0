//! Planes of numbers that may be more than memory holds: the first stay, the others go to a file.

use std::borrow::Cow;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::error::{CalibrationError, Result};

/// Bytes of planes that stay in memory.
const HELD: usize = 192 << 20;

/// A number that can be written and read back.
pub(crate) trait Number: Copy + Default + Send + Sync + 'static {
    const BYTES: usize;
    fn put(self, bytes: &mut Vec<u8>);
    fn get(bytes: &[u8]) -> Self;
}

macro_rules! number {
    ($($t:ty),*) => { $(impl Number for $t {
        const BYTES: usize = size_of::<$t>();
        fn put(self, bytes: &mut Vec<u8>) {
            bytes.extend_from_slice(&self.to_le_bytes());
        }
        fn get(bytes: &[u8]) -> Self {
            bytes.try_into().map_or_else(|_| Self::default(), Self::from_le_bytes)
        }
    })* };
}
number!(u16, f32);

/// One frame's worth of numbers.
pub(crate) enum Plane<T> {
    Held(Vec<T>),
    Filed { at: u64 },
}

/// Where planes are kept. The file has no name and is gone when the spool is.
pub(crate) struct Spool {
    folder: PathBuf,
    file: Option<File>,
    end: u64,
    held: usize,
}

impl Spool {
    /// A spool whose file, if one is needed, lies in `folder`.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_path_buf(), file: None, end: 0, held: 0 }
    }

    pub fn put<T: Number>(&mut self, plane: Vec<T>) -> Result<Plane<T>> {
        let size = plane.len() * T::BYTES;
        if self.held + size <= HELD {
            self.held += size;
            return Ok(Plane::Held(plane));
        }
        let written = self.file().and_then(|file| {
            let mut bytes = Vec::new();
            for piece in plane.chunks(1 << 20) {
                bytes.clear();
                piece.iter().for_each(|v| v.put(&mut bytes));
                file.write_all(&bytes)?;
            }
            Ok(())
        });
        written.map_err(CalibrationError::io(&self.folder))?;
        let at = self.end;
        self.end += size as u64;
        Ok(Plane::Filed { at })
    }

    /// A part of a plane; `range` lies within it.
    pub fn part<'a, T: Number>(
        &mut self,
        plane: &'a Plane<T>,
        range: Range<usize>,
    ) -> Result<Cow<'a, [T]>> {
        match plane {
            Plane::Held(values) => Ok(Cow::Borrowed(values.get(range).unwrap_or_default())),
            Plane::Filed { at } => {
                let mut bytes = vec![0; range.len() * T::BYTES];
                let from = at + (range.start * T::BYTES) as u64;
                let read = self.file().and_then(|file| {
                    file.seek(SeekFrom::Start(from))?;
                    file.read_exact(&mut bytes)
                });
                read.map_err(CalibrationError::io(&self.folder))?;
                Ok(Cow::Owned(bytes.chunks_exact(T::BYTES).map(T::get).collect()))
            }
        }
    }

    fn file(&mut self) -> std::io::Result<&mut File> {
        if self.file.is_none() {
            self.file = Some(tempfile::tempfile_in(&self.folder)?);
        }
        self.file.as_mut().ok_or_else(|| std::io::Error::other("no temporary file"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_goes_to_the_file_comes_back() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = Spool::new(folder.path());
        let first = spool.put(vec![7_u16, 8, 9]).unwrap();
        spool.held = HELD;
        let codes = spool.put((0..5000_u16).collect()).unwrap();
        let levels = spool.put(vec![0.5_f32, -1.25, f32::INFINITY]).unwrap();
        assert!(matches!(codes, Plane::Filed { .. }) && matches!(first, Plane::Held(_)));
        assert_eq!(*spool.part(&first, 1..3).unwrap(), [8, 9]);
        assert_eq!(*spool.part(&codes, 4321..4323).unwrap(), [4321, 4322]);
        assert_eq!(*spool.part(&levels, 0..3).unwrap(), [0.5, -1.25, f32::INFINITY]);
    }
}
