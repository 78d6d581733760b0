//! Reading arrays out of an archive that need not be honest.

use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek};
use std::path::{Path, PathBuf};

use super::Kind;
use super::npy::{self, NpyHeader};
use crate::FileError;

/// Deflate cannot do better than 1032 : 1, so an entry that claims more is lying.
const MOST_COMPRESSION: u64 = 1032;

/// An array of numbers in C order (last axis fastest).
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis; empty for a scalar.
    pub shape: Vec<usize>,
    /// The values, as many as the product of `shape`.
    pub data: Vec<f64>,
}

/// An open `.npz` archive.
///
/// Sizes in the archive are claims: nothing is allocated beyond what the file could
/// really hold.
pub struct NpzReader {
    path: PathBuf,
    /// Bytes of the whole archive.
    size: u64,
    archive: zip::ZipArchive<Box<dyn Source>>,
    names: Vec<String>,
}

/// A file, or its bytes.
trait Source: Read + Seek + Send {}

impl<T: Read + Seek + Send> Source for T {}

impl NpzReader {
    /// Opens the archive and reads its directory.
    ///
    /// # Errors
    /// The file cannot be read, or is no zip archive or a truncated one.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let file = File::open(path).map_err(FileError::reading(path))?;
        let size = file.metadata().map_err(FileError::reading(path))?.len();
        Self::new(Box::new(BufReader::new(file)), size, path)
    }

    /// The archive that these bytes are; `path` is for messages.
    pub(crate) fn of_bytes(bytes: Vec<u8>, path: &Path) -> Result<Self, FileError> {
        let size = bytes.len() as u64;
        Self::new(Box::new(Cursor::new(bytes)), size, path)
    }

    fn new(source: Box<dyn Source>, size: u64, path: &Path) -> Result<Self, FileError> {
        let archive = zip::ZipArchive::new(source).map_err(|e| {
            FileError::malformed(path, format!("expected a whole .npz archive: {e}"))
        })?;
        let names = archive
            .file_names()
            .filter_map(|name| name.ok()?.strip_suffix(".npy").map(str::to_owned))
            .collect();
        Ok(Self { path: path.into(), size, archive, names })
    }

    /// Where the archive is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names of the arrays in it.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Whether it holds an array of that name.
    pub fn contains(&self, name: &str) -> bool {
        self.names.iter().any(|n| n == name)
    }

    /// The array of that name; float32, float64, int32, int64 and uint8 in either byte and
    /// axis order come out as f64 in C order.
    ///
    /// # Errors
    /// No such array (the message lists those that are there), another element type, or an
    /// array that is cut short or damaged.
    pub fn array_f64(&mut self, name: &str) -> Result<Array, FileError> {
        let (header, bytes) = self.raw(name)?;
        let data = numbers(&header, &bytes).ok_or_else(|| {
            FileError::malformed(
                &self.path,
                format!("array {name:?}: expected numbers, found text"),
            )
        })?;
        drop(bytes);
        let data = if header.fortran_order { c_order(&header.shape, &data) } else { data };
        Ok(Array { shape: header.shape, data })
    }

    /// The values of the array of that name, which must have that shape.
    ///
    /// # Errors
    /// As [`NpzReader::array_f64`], and another shape.
    pub fn shaped(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f64>, FileError> {
        let array = self.array_f64(name)?;
        if array.shape != shape {
            return Err(self.wrong_shape(name, format!("{shape:?}"), array.shape));
        }
        Ok(array.data)
    }

    /// The only value of an array of one element, of whatever number of axes.
    ///
    /// # Errors
    /// As [`NpzReader::array_f64`], and more or fewer values than one.
    pub fn scalar(&mut self, name: &str) -> Result<f64, FileError> {
        let array = self.array_f64(name)?;
        match array.data[..] {
            [value] => Ok(value),
            _ => Err(self.wrong_shape(name, "of one number".into(), array.shape)),
        }
    }

    /// The only value of an array of text.
    ///
    /// # Errors
    /// No such array, not text, or not exactly one value.
    pub fn text(&mut self, name: &str) -> Result<String, FileError> {
        let (header, bytes) = self.raw(name)?;
        let wrong = |what: &str| {
            FileError::malformed(
                &self.path,
                format!("array {name:?}: expected one text, found {what}"),
            )
        };
        if !matches!(header.kind, Kind::Text(_)) {
            return Err(wrong("numbers"));
        }
        if header.shape.iter().any(|&n| n != 1) {
            return Err(self.wrong_shape(name, "of one text".into(), header.shape));
        }
        let code = |b: &[u8; 4]| {
            let code =
                if header.big_endian { u32::from_be_bytes(*b) } else { u32::from_le_bytes(*b) };
            char::from_u32(code)
        };
        let text: Option<String> = bytes.as_chunks::<4>().0.iter().map(code).collect();
        // Shorter texts are padded with zeros.
        Ok(text.ok_or_else(|| wrong("no valid characters"))?.trim_end_matches('\0').into())
    }

    fn wrong_shape(&self, name: &str, expected: String, found: Vec<usize>) -> FileError {
        FileError::WrongShape { path: self.path.clone(), name: name.into(), expected, found }
    }

    /// The header of an array and exactly the bytes that its shape asks for.
    fn raw(&mut self, name: &str) -> Result<(NpyHeader, Vec<u8>), FileError> {
        let malformed =
            |reason: String| FileError::malformed(&self.path, format!("array {name:?}: {reason}"));
        let index = self.archive.index_for_name(&format!("{name}.npy"));
        let index = index.ok_or_else(|| FileError::MissingArray {
            path: self.path.clone(),
            name: name.into(),
            available: self.names.clone(),
        })?;
        let file_size = self.size;
        let mut entry = self.archive.by_index(index).map_err(|e| malformed(e.to_string()))?;
        let possible = entry.compressed_size().min(file_size).saturating_mul(MOST_COMPRESSION);
        let limit = entry.size().min(possible);
        let mut bytes = Vec::new();
        // Grows as data arrives, so that a false size costs nothing. One byte more than there
        // should be: the checksum is looked at where the entry ends, not a byte earlier.
        entry
            .by_ref()
            .take(limit.saturating_add(1))
            .read_to_end(&mut bytes)
            .map_err(|e| malformed(format!("cannot be unpacked: {e}")))?;
        let header = npy::parse(&bytes).map_err(malformed)?;
        let expected = header
            .shape
            .iter()
            .try_fold(header.kind.size(), |n, &axis| Some(n?.checked_mul(axis)))
            .flatten();
        bytes.drain(..header.length);
        if expected != Some(bytes.len()) {
            let expected = expected.map_or("more than can be addressed".into(), |n| n.to_string());
            return Err(malformed(format!(
                "shape {:?} needs {expected} bytes, found {}",
                header.shape,
                bytes.len()
            )));
        }
        Ok((header, bytes))
    }
}

/// The elements as f64, in the order in which they are stored; `None` for text.
fn numbers(header: &NpyHeader, bytes: &[u8]) -> Option<Vec<f64>> {
    fn each<const N: usize>(
        bytes: &[u8],
        big_endian: bool,
        value: impl Fn([u8; N]) -> f64,
    ) -> Vec<f64> {
        let little_endian = |chunk: &[u8; N]| {
            let mut chunk = *chunk;
            if big_endian {
                chunk.reverse();
            }
            value(chunk)
        };
        bytes.as_chunks::<N>().0.iter().map(little_endian).collect()
    }
    let big = header.big_endian;
    Some(match header.kind {
        Kind::F32 => each(bytes, big, |b| f64::from(f32::from_le_bytes(b))),
        Kind::F64 => each(bytes, big, f64::from_le_bytes),
        Kind::I32 => each(bytes, big, |b| f64::from(i32::from_le_bytes(b))),
        Kind::I64 => each(bytes, big, |b| i64::from_le_bytes(b) as f64),
        Kind::U8 => bytes.iter().map(|&b| f64::from(b)).collect(),
        Kind::Text(_) => return None,
    })
}

/// Values stored first axis fastest, rearranged to last axis fastest.
fn c_order(shape: &[usize], data: &[f64]) -> Vec<f64> {
    let mut strides = Vec::with_capacity(shape.len());
    let mut stride = 1;
    for &axis in shape {
        strides.push(stride);
        stride *= axis;
    }
    let mut at = vec![0; shape.len()];
    let mut source = 0;
    let mut sorted = Vec::with_capacity(data.len());
    for _ in 0..data.len() {
        sorted.push(data[source]);
        for axis in (0..shape.len()).rev() {
            at[axis] += 1;
            source += strides[axis];
            if at[axis] < shape[axis] {
                break;
            }
            source -= strides[axis] * shape[axis];
            at[axis] = 0;
        }
    }
    sorted
}
