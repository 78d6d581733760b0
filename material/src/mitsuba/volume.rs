//! Mitsuba 3's grid volumes (`.vol`, version 3, float32).

use std::io::{self, Write};
use std::path::Path;

use crate::{FileError, Overwrite, ScatteringMedium, atomic_write};

const HEADER: usize = 48;

/// A grid volume as the file holds it, in Mitsuba's frame and order.
#[derive(Clone, Debug, PartialEq)]
pub struct GridVolume {
    /// Cells along x, y and z.
    pub cells: [usize; 3],
    /// Values a cell: 1, 3 or 6.
    pub channels: usize,
    /// Corners of the box, lowest and highest.
    pub bounds: [[f32; 3]; 2],
    /// Values at `((z · ny + y) · nx + x) · channels + c`.
    pub data: Vec<f32>,
}

impl GridVolume {
    /// A volume from the cells of a material: `value(channel, index into the material's arrays)`.
    pub fn of(
        medium: &ScatteringMedium<'_>,
        channels: usize,
        value: impl Fn(usize, usize) -> f32,
    ) -> Self {
        let cells = medium.material().grid().cells();
        let [nx, ny, nz] = cells;
        let mut data = Vec::with_capacity(medium.material().grid().len() * channels);
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let index = medium.index([x, y, z]);
                    data.extend((0..channels).map(|c| value(c, index)));
                }
            }
        }
        let bounds = [[0.0; 3], medium.size().map(|length| length as f32)];
        Self { cells, channels, bounds, data }
    }

    /// The value at a cell of our own frame, `None` outside.
    pub fn at_sample(&self, [x, y, z]: [usize; 3], channel: usize) -> Option<f32> {
        let [nx, ny, nz] = self.cells;
        if x >= nx || y >= ny || z >= nz || channel >= self.channels {
            return None;
        }
        let cell = ((nz - 1 - z) * ny + (ny - 1 - y)) * nx + x;
        self.data.get(cell * self.channels + channel).copied()
    }

    /// Writes the file.
    ///
    /// # Errors
    /// More cells than the format's 32 bits can count, the file is there already and
    /// `overwrite` refuses, or the system does.
    pub fn write(&self, path: &Path, overwrite: Overwrite) -> Result<(), FileError> {
        let [nx, ny, nz] = self.cells;
        atomic_write(path, overwrite, |file| {
            file.write_all(b"VOL\x03")?;
            for number in [1, nx, ny, nz, self.channels] {
                let number = i32::try_from(number).map_err(io::Error::other)?;
                file.write_all(&number.to_le_bytes())?;
            }
            for bound in self.bounds.as_flattened() {
                file.write_all(&bound.to_le_bytes())?;
            }
            let mut bytes = Vec::new();
            self.data.chunks(1 << 14).try_for_each(|values| {
                bytes.clear();
                values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
                file.write_all(&bytes)
            })
        })
    }

    /// Reads a float32 volume.
    ///
    /// # Errors
    /// The file cannot be read, is something else than a version 3 float32 volume, or has
    /// another size than its header says.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Self::parse(&std::fs::read(path).map_err(FileError::reading(path))?, path)
    }

    pub(crate) fn parse(bytes: &[u8], path: &Path) -> Result<Self, FileError> {
        let other = |found: String| FileError::OtherFormat {
            path: path.into(),
            expected: "a Mitsuba .vol file, version 3, float32",
            found,
        };
        if !bytes.starts_with(b"VOL") {
            return Err(other("something else".into()));
        }
        if bytes.len() < HEADER {
            return Err(FileError::WrongSize {
                path: path.into(),
                expected: HEADER as u64,
                found: bytes.len() as u64,
            });
        }
        if bytes[3] != 3 {
            return Err(other(format!("version {}", bytes[3])));
        }
        let words = &bytes[4..].as_chunks::<4>().0;
        let number = |i: usize| i32::from_le_bytes(words[i]);
        if number(0) != 1 {
            return Err(other(format!("encoding {}", number(0))));
        }
        let mut sizes = [0; 4];
        for (i, size) in sizes.iter_mut().enumerate() {
            *size = usize::try_from(number(i + 1)).ok().filter(|&n| n > 0).ok_or_else(|| {
                FileError::malformed(
                    path,
                    format!("sizes must be positive, found {}", number(i + 1)),
                )
            })?;
        }
        let expected = sizes.iter().try_fold(4_u64, |n, &size| n.checked_mul(size as u64));
        let expected = expected.and_then(|n| n.checked_add(HEADER as u64)).unwrap_or(u64::MAX);
        if bytes.len() as u64 != expected {
            let found = bytes.len() as u64;
            return Err(FileError::WrongSize { path: path.into(), expected, found });
        }
        let float = |i: usize| f32::from_le_bytes(words[i]);
        let [nx, ny, nz, channels] = sizes;
        Ok(Self {
            cells: [nx, ny, nz],
            channels,
            bounds: [[float(5), float(6), float(7)], [float(8), float(9), float(10)]],
            data: (11..words.len()).map(float).collect(),
        })
    }
}
