//! The native form, one `.diaphane` file; `docs/material-format.md` describes it for others.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | `DIAPHANE` |
//! | 4 | u32, version of the format: 1 |
//! | 4 | u32, length of the header in bytes, a multiple of 8 |
//! | … | the header, JSON in UTF-8, padded with spaces |
//! | … | f32 arrays, channel by channel, κ before μ; then, if there is one, the resolution likewise, and the surface reflectance |
//! | 32 | BLAKE3 of everything before it |
//!
//! All numbers are little-endian.

use std::io::Write;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::header::{Header, Optional};
use crate::{Coefficient, FileError, Material, Overwrite, Resolution, Surface, atomic_write};

const MAGIC: &[u8; 8] = b"DIAPHANE";
const VERSION: u32 = 1;
const PREAMBLE: usize = 16;
const HASH: usize = 32;

/// The header as it stands in the file: the material's own, and where the arrays are.
#[derive(Serialize, Deserialize)]
struct NativeHeader {
    #[serde(flatten)]
    material: Header,
    arrays: Vec<ArrayEntry>,
    /// A list of its own, which readers that do not know it leave alone.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    resolution: Vec<ArrayEntry>,
    /// Another one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    surface: Vec<ArrayEntry>,
}

impl NativeHeader {
    /// Every array of the file.
    fn listed(&self) -> impl Iterator<Item = &ArrayEntry> {
        self.arrays.iter().chain(&self.resolution).chain(&self.surface)
    }
}

/// One array of f32 in the order of the grid.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct ArrayEntry {
    channel: usize,
    coefficient: Coefficient,
    /// Bytes from the end of the header.
    offset: u64,
    /// Number of values.
    length: u64,
}

impl Material {
    /// Writes the native form.
    ///
    /// # Errors
    /// The file is there already and `overwrite` refuses, or the system does.
    pub fn save(&self, path: &Path, overwrite: Overwrite) -> Result<(), FileError> {
        let header = self.native_header().map_err(|e| FileError::Io {
            path: path.into(),
            action: "write",
            source: e.into(),
        })?;
        atomic_write(path, overwrite, |file| {
            let mut hasher = blake3::Hasher::new();
            let mut put = |bytes: &[u8]| {
                hasher.update(bytes);
                file.write_all(bytes)
            };
            put(MAGIC)?;
            put(&VERSION.to_le_bytes())?;
            let length = u32::try_from(header.len()).map_err(std::io::Error::other)?;
            put(&length.to_le_bytes())?;
            put(&header)?;
            for channel in self.channels() {
                put(&little_endian(&channel.kappa_mm))?;
                put(&little_endian(&channel.mu_per_mm))?;
            }
            for resolution in self.resolution().unwrap_or_default() {
                put(&little_endian(&resolution.kappa_mm))?;
                put(&little_endian(&resolution.mu_mm))?;
            }
            for surface in self.surface().unwrap_or_default() {
                put(&little_endian(&surface.reflectance))?;
            }
            file.write_all(hasher.finalize().as_bytes())
        })
    }

    /// Reads the native form.
    ///
    /// Nothing is believed before the hash over the whole file agrees, and no more memory
    /// is taken than the file is long.
    ///
    /// # Errors
    /// The file cannot be read, is something else, comes from a newer version, is cut short
    /// or damaged, or holds something that is not a material.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let bytes = std::fs::read(path).map_err(FileError::reading(path))?;
        parse(&bytes, path)
    }

    fn native_header(&self) -> Result<Vec<u8>, serde_json::Error> {
        let mut offset = 0;
        let mut list = |channels: usize, coefficients: &[Coefficient]| {
            let pairs = (0..channels).flat_map(|c| coefficients.iter().map(move |k| (c, *k)));
            let entry = |(channel, coefficient): (usize, Coefficient)| {
                let length = coefficient.places(self.grid()).1 as u64;
                let entry = ArrayEntry { channel, coefficient, offset, length };
                offset += length * 4;
                entry
            };
            pairs.map(entry).collect::<Vec<_>>()
        };
        let arrays = list(self.channels().len(), &[Coefficient::Kappa, Coefficient::Mu]);
        let resolution = list(
            self.resolution().map_or(0, <[_]>::len),
            &[Coefficient::KappaResolution, Coefficient::MuResolution],
        );
        let surface =
            list(self.surface().map_or(0, <[_]>::len), &[Coefficient::SurfaceReflectance]);
        let header = NativeHeader { material: Header::of(self), arrays, resolution, surface };
        let mut header = serde_json::to_vec(&header)?;
        // Arrays start at a multiple of 8, so that a reader may map the file and use them in place.
        header.resize(header.len().next_multiple_of(8), b' ');
        Ok(header)
    }
}

fn little_endian(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

pub(crate) fn parse(bytes: &[u8], path: &Path) -> Result<Material, FileError> {
    let magic = &bytes[..bytes.len().min(MAGIC.len())];
    if magic != MAGIC {
        return Err(FileError::OtherFormat {
            path: path.into(),
            expected: "a Diaphane material (first bytes \"DIAPHANE\")",
            found: if magic.is_empty() {
                "an empty file".into()
            } else {
                format!("first bytes {:?}", String::from_utf8_lossy(magic))
            },
        });
    }
    let too_short = || FileError::WrongSize {
        path: path.into(),
        expected: (PREAMBLE + HASH) as u64,
        found: bytes.len() as u64,
    };
    let word = |at: usize| {
        let word = bytes.get(at..at + 4).and_then(|b| b.try_into().ok());
        word.map(u32::from_le_bytes).ok_or_else(too_short)
    };
    // The version comes first: what follows may mean something else in a later one.
    let version = word(8)?;
    if version > VERSION {
        return Err(FileError::NewerVersion {
            path: path.into(),
            found: version,
            supported: VERSION,
        });
    }
    if version == 0 {
        return Err(FileError::malformed(path, "expected format version 1, found 0"));
    }
    let header_length = word(12)? as usize;
    let body_length = bytes.len().checked_sub(HASH).ok_or_else(too_short)?;
    let (body, hash) = bytes.split_at(body_length);
    let found = blake3::hash(body);
    if found.as_bytes() != hash {
        // A cut file is recognised where its header survived; then it can be called that.
        if let Some(expected) = expected_size(bytes, header_length)
            && expected != bytes.len() as u64
        {
            let found = bytes.len() as u64;
            return Err(FileError::WrongSize { path: path.into(), expected, found });
        }
        let hex = |bytes: &[u8]| bytes.iter().map(|b| format!("{b:02x}")).collect::<String>();
        return Err(FileError::Damaged {
            path: path.into(),
            expected: hex(hash),
            found: hex(found.as_bytes()),
        });
    }
    let (header, data) = body
        .get(PREAMBLE..)
        .and_then(|rest| rest.split_at_checked(header_length))
        .ok_or_else(too_short)?;
    let header: NativeHeader = serde_json::from_slice(header)
        .map_err(|e| FileError::malformed(path, format!("the header cannot be understood: {e}")))?;
    assemble(header, data, path)
}

/// The size that the header asks for, if the header is whole.
fn expected_size(bytes: &[u8], header_length: usize) -> Option<u64> {
    let header = bytes.get(PREAMBLE..PREAMBLE.checked_add(header_length)?)?;
    let header: NativeHeader = serde_json::from_slice(header).ok()?;
    let ends = header.listed().map(|a| a.length.checked_mul(4)?.checked_add(a.offset));
    let data = ends.collect::<Option<Vec<_>>>()?.into_iter().max()?;
    data.checked_add((PREAMBLE + header_length + HASH) as u64)
}

fn assemble(header: NativeHeader, data: &[u8], path: &Path) -> Result<Material, FileError> {
    let array = |channel: usize, coefficient: Coefficient| {
        let entry = header
            .listed()
            .find(|a| a.channel == channel && a.coefficient == coefficient)
            .ok_or_else(|| FileError::MissingArray {
                path: path.into(),
                name: format!("{coefficient} of channel {channel}"),
                available: header
                    .listed()
                    .map(|a| format!("{} of channel {}", a.coefficient, a.channel))
                    .collect(),
            })?;
        let range = || {
            let start = usize::try_from(entry.offset).ok()?;
            let length = usize::try_from(entry.length).ok()?.checked_mul(4)?;
            data.get(start..start.checked_add(length)?)
        };
        let bytes = range().ok_or_else(|| FileError::WrongSize {
            path: path.into(),
            expected: entry.length.saturating_mul(4).saturating_add(entry.offset),
            found: data.len() as u64,
        })?;
        let word = |b: &[u8; 4]| f32::from_le_bytes(*b);
        Ok::<_, FileError>(bytes.as_chunks::<4>().0.iter().map(word).collect())
    };
    let channels = header.material.channels.len();
    let volumes = |coefficient: Coefficient| {
        (0..channels).map(|c| array(c, coefficient)).collect::<Result<Vec<_>, FileError>>()
    };
    let (kappa, mu) = (volumes(Coefficient::Kappa)?, volumes(Coefficient::Mu)?);
    let resolution = if header.resolution.is_empty() {
        None
    } else {
        let of = |i: usize| {
            Ok(Resolution {
                kappa_mm: array(i, Coefficient::KappaResolution)?,
                mu_mm: array(i, Coefficient::MuResolution)?,
            })
        };
        Some((0..channels).map(of).collect::<Result<_, FileError>>()?)
    };
    let surface = if header.surface.is_empty() {
        None
    } else {
        let maps = volumes(Coefficient::SurfaceReflectance)?.into_iter();
        Some(maps.map(|reflectance| Surface { reflectance }).collect())
    };
    header.material.material(kappa, mu, Optional { resolution, surface }, path)
}
