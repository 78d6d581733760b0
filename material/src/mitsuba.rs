//! Mitsuba 3's grid volumes (`.vol`, version 3).
//!
//! Mitsuba's frame is another than ours: its z axis points at the camera and its y axis up,
//! so that the exported block lies in the box (0, 0, 0) … (size x, size y, size z) with the
//! **back** face at z = 0, the **front** face at z = size z, and the image's top row at the
//! largest y. Going there is half a turn about the x axis, cell (x, y, z) → (x, ny−1−y,
//! nz−1−z): nothing is mirrored.
//!
//! Lengths are millimetres. Mitsuba puts a volume into the unit cube unless the scene says
//! otherwise: set `use_grid_bbox` or give it a `to_world`.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::{Channel, FileError, Grid, Material, Overwrite, atomic_write};

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

/// What to do with voxels whose κ and μ no scattering medium has: 3κμ > 1, σs' < 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Impossible {
    /// Export nothing and count them.
    #[default]
    Refuse,
    /// Give them σs' = 0: they absorb as they should and scatter not at all.
    Clamp,
}

/// What [`export`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// `sigma_t.vol`, `albedo.vol`, `sigma_a.vol` and `sigma_s.vol`.
    pub files: [PathBuf; 4],
    /// Voxel values whose scattering was set to zero.
    pub clamped: usize,
}

/// Absorption and reduced scattering of one voxel, 1/mm: σa = μ, σs' = 1/(3κ) − μ (negative
/// where 3κμ > 1).
pub fn absorption_and_scattering(kappa_mm: f32, mu_per_mm: f32) -> (f64, f64) {
    let mu = f64::from(mu_per_mm);
    (mu, 1.0 / (3.0 * f64::from(kappa_mm)) - mu)
}

/// Writes the material into `folder` as `sigma_t.vol` and `albedo.vol`, which Mitsuba's
/// heterogeneous medium takes (with an isotropic phase function), and `sigma_a.vol` and
/// `sigma_s.vol` (σs') for others. Extinctions in 1/mm.
///
/// # Errors
/// One, three or six channels are what the format holds; impossible voxels unless they may
/// be clamped; one of the files is there already; the system refuses. Nothing is written in
/// the first two cases.
pub fn export(
    folder: &Path,
    material: &Material,
    impossible: Impossible,
    overwrite: Overwrite,
) -> Result<Exported, FileError> {
    let cannot = |reason: String| FileError::CannotHold { path: folder.into(), reason };
    let channels = material.channels();
    if ![1, 3, 6].contains(&channels.len()) {
        let reason = format!("a .vol holds 1, 3 or 6 channels, found {}", channels.len());
        return Err(cannot(reason));
    }
    let clamped = channels.iter().map(impossible_voxels).sum();
    if clamped > 0 && impossible == Impossible::Refuse {
        let of = channels.len() * material.grid().len();
        return Err(cannot(format!(
            "{clamped} of {of} voxel values have 3κμ > 1, which needs negative scattering"
        )));
    }
    let files = ["sigma_t.vol", "albedo.vol", "sigma_a.vol", "sigma_s.vol"];
    let files = files.map(|name| folder.join(name));
    if overwrite == Overwrite::Refuse
        && let Some(path) = files.iter().find(|file| file.symlink_metadata().is_ok())
    {
        return Err(FileError::Exists { path: path.clone() });
    }
    let quantities: [fn(f64, f64) -> f64; 4] =
        [|a, s| a + s, |a, s| s / (a + s), |a, _| a, |_, s| s];
    for (file, quantity) in files.iter().zip(quantities) {
        let value = |channel: &Channel, i: usize| {
            let (a, s) = absorption_and_scattering(channel.kappa_mm[i], channel.mu_per_mm[i]);
            quantity(a, s.max(0.0)) as f32
        };
        let volume =
            GridVolume::from_grid(material.grid(), channels.len(), |c, i| value(&channels[c], i));
        volume.write(file, overwrite)?;
    }
    Ok(Exported { files, clamped })
}

fn impossible_voxels(channel: &Channel) -> usize {
    let pairs = channel.kappa_mm.iter().zip(&channel.mu_per_mm);
    pairs.filter(|&(&kappa, &mu)| absorption_and_scattering(kappa, mu).1 < 0.0).count()
}

impl GridVolume {
    /// A volume from values on our grid: `value(channel, index in grid order)`, turned into
    /// Mitsuba's frame.
    pub fn from_grid(grid: &Grid, channels: usize, value: impl Fn(usize, usize) -> f32) -> Self {
        let [nx, ny, nz] = grid.cells();
        let mut data = Vec::with_capacity(grid.len() * channels);
        for z in (0..nz).rev() {
            for y in (0..ny).rev() {
                for x in 0..nx {
                    let index = grid.index(x, y, z);
                    data.extend((0..channels).map(|c| value(c, index)));
                }
            }
        }
        let bounds = [[0.0; 3], grid.size_mm().map(|length| length as f32)];
        Self { cells: grid.cells(), channels, bounds, data }
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
            self.data.iter().try_for_each(|v| file.write_all(&v.to_le_bytes()))
        })
    }

    /// Reads a float32 volume.
    ///
    /// # Errors
    /// The file cannot be read, is something else than a version 3 float32 volume, or has
    /// another size than its header says.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let bytes = std::fs::read(path).map_err(FileError::reading(path))?;
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
