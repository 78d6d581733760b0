//! Writing archives that `numpy.load` opens.

use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::Path;

use zip::write::SimpleFileOptions;

use super::npy;
use crate::{FileError, Overwrite, atomic_write};

/// Writes an archive to `path`, whole or not at all; `fill` adds the arrays.
///
/// # Errors
/// As [`atomic_write`], and whatever `fill` reports.
pub fn write(
    path: &Path,
    overwrite: Overwrite,
    fill: impl FnOnce(&mut NpzWriter<&mut BufWriter<File>>) -> io::Result<()>,
) -> Result<(), FileError> {
    atomic_write(path, overwrite, |file| {
        let mut npz = NpzWriter::new(file);
        fill(&mut npz)?;
        npz.finish()
    })
}

/// An archive in the making. Entries are stored without compression: coefficients are
/// noise to a compressor, and numpy can then read at the speed of the disk.
pub struct NpzWriter<W: Write + Seek> {
    zip: zip::ZipWriter<W>,
}

impl<W: Write + Seek> NpzWriter<W> {
    /// An empty archive.
    pub fn new(writer: W) -> Self {
        Self { zip: zip::ZipWriter::new(writer) }
    }

    /// Adds a float32 array in C order.
    ///
    /// # Errors
    /// `data` does not fit `shape`, the name is taken, or the system refuses.
    pub fn array_f32(&mut self, name: &str, shape: &[usize], data: &[f32]) -> io::Result<()> {
        self.chunks(name, "<f4", shape, 4, std::iter::once(data), |v, out| {
            out.extend(v.to_le_bytes());
        })
    }

    /// Adds a float32 array in C order out of parts that follow each other, so that volumes
    /// that are kept channel by channel need not be copied together.
    ///
    /// # Errors
    /// As [`NpzWriter::array_f32`].
    pub fn parts_f32<'a>(
        &mut self,
        name: &str,
        shape: &[usize],
        parts: impl Iterator<Item = &'a [f32]> + Clone,
    ) -> io::Result<()> {
        self.chunks(name, "<f4", shape, 4, parts, |v, out| out.extend(v.to_le_bytes()))
    }

    /// Adds a float64 array in C order.
    ///
    /// # Errors
    /// As [`NpzWriter::array_f32`].
    pub fn array_f64(&mut self, name: &str, shape: &[usize], data: &[f64]) -> io::Result<()> {
        self.chunks(name, "<f8", shape, 8, std::iter::once(data), |v, out| {
            out.extend(v.to_le_bytes());
        })
    }

    /// Adds a float64 scalar (an array of no axes).
    ///
    /// # Errors
    /// The name is taken, or the system refuses.
    pub fn scalar(&mut self, name: &str, value: f64) -> io::Result<()> {
        self.array_f64(name, &[], &[value])
    }

    /// Adds a list of texts, an array of one axis.
    ///
    /// # Errors
    /// The name is taken, or the system refuses.
    pub fn texts(&mut self, name: &str, texts: &[&str]) -> io::Result<()> {
        self.unicode(name, &[texts.len()], texts)
    }

    /// Adds one text (an array of no axes).
    ///
    /// # Errors
    /// The name is taken, or the system refuses.
    pub fn text(&mut self, name: &str, text: &str) -> io::Result<()> {
        self.unicode(name, &[], &[text])
    }

    /// Writes the directory of the archive and flushes.
    ///
    /// # Errors
    /// The system refuses.
    pub fn finish(self) -> io::Result<()> {
        self.zip.finish()?.flush()
    }

    fn unicode(&mut self, name: &str, shape: &[usize], texts: &[&str]) -> io::Result<()> {
        let width = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
        let padded = |text: &&str| {
            let codes = text.chars().map(u32::from).chain(std::iter::repeat(0)).take(width);
            codes.collect::<Vec<u32>>()
        };
        let rows: Vec<Vec<u32>> = texts.iter().map(padded).collect();
        let rows = rows.iter().map(Vec::as_slice);
        self.chunks(name, &format!("<U{width}"), shape, width * 4, rows, |code, out| {
            out.extend(code.to_le_bytes());
        })
    }

    /// Writes an array of `item_bytes` an element from slices of `T`.
    fn chunks<'a, T: 'a>(
        &mut self,
        name: &str,
        descr: &str,
        shape: &[usize],
        item_bytes: usize,
        parts: impl Iterator<Item = &'a [T]> + Clone,
        encode: impl Fn(&T, &mut Vec<u8>),
    ) -> io::Result<()> {
        let bytes: usize = parts.clone().map(std::mem::size_of_val).sum();
        if shape.iter().product::<usize>() * item_bytes != bytes {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("array {name:?} of shape {shape:?} was given {bytes} bytes"),
            ));
        }
        let options = SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored)
            .large_file(u32::try_from(bytes + 1024).is_err());
        self.zip.start_file(format!("{name}.npy"), options)?;
        self.zip.write_all(&npy::header(descr, shape))?;
        let mut buffer = Vec::new();
        for part in parts.flat_map(|part| part.chunks(1 << 14)) {
            buffer.clear();
            part.iter().for_each(|value| encode(value, &mut buffer));
            self.zip.write_all(&buffer)?;
        }
        Ok(())
    }
}
