//! All formats under one roof: told apart when read, chosen by a name's ending when written.

use std::fs::File;
use std::io::Read;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};

use crate::mitsuba::GridVolume;
use crate::npz::NpzReader;
use crate::reading::Reading;
use crate::{
    FileError, Impossible, Material, Overwrite, ScatteringMedium, SceneUnit, exr_stack, gltf,
    mitsuba, native, nrrd, openpbr, pbrt, vdb,
};

/// A kind of file that a material goes into or comes out of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Diaphane's own, `.diaphane`.
    Native,
    /// NumPy, `.npz`.
    Npz,
    /// OpenVDB, `.vdb`.
    Vdb,
    /// NRRD, `.nrrd`.
    Nrrd,
    /// A stack of slices in OpenEXR, `.exr`.
    Exr,
    /// Mitsuba 3: read from `.vol` beside another; written as a scene, `.xml`, with all volumes
    /// in the same folder, whatever the scene is called.
    Mitsuba,
    /// pbrt-v4, `.pbrt`; only written.
    Pbrt,
    /// The average as glTF, `.gltf`; only written.
    Gltf,
    /// The average as OpenPBR in MaterialX, `.mtlx`; only written.
    OpenPbr,
}

/// How renderers' formats are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Conversion {
    /// The scene's unit of length.
    pub unit: SceneUnit,
    /// What becomes of voxels that no medium has.
    pub impossible: Impossible,
}

/// What was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// The files, the one that was asked for first.
    pub files: Vec<PathBuf>,
    /// Values, voxels times channels, whose scattering was set to zero.
    pub clamped: usize,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Native,
        Self::Npz,
        Self::Vdb,
        Self::Nrrd,
        Self::Exr,
        Self::Mitsuba,
        Self::Pbrt,
        Self::Gltf,
        Self::OpenPbr,
    ];

    /// Ending of the names of files that are written.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Native => "diaphane",
            Self::Npz => "npz",
            Self::Vdb => "vdb",
            Self::Nrrd => "nrrd",
            Self::Exr => "exr",
            Self::Mitsuba => "xml",
            Self::Pbrt => "pbrt",
            Self::Gltf => "gltf",
            Self::OpenPbr => "mtlx",
        }
    }

    /// By the ending of a file that is to be written.
    ///
    /// # Errors
    /// [`FileError::OtherFormat`] with all endings that are known.
    pub fn to_write(path: &Path) -> Result<Self, FileError> {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let format = Self::ALL.into_iter().find(|format| format.ending() == ending);
        format.ok_or_else(|| FileError::OtherFormat {
            path: path.into(),
            expected: "a name that ends in .diaphane, .npz, .vdb, .nrrd, .exr, .xml (Mitsuba), .pbrt, .gltf or .mtlx",
            found: if ending.is_empty() { "no ending".into() } else { format!(".{ending}") },
        })
    }

    /// By the first bytes of a file that is to be read.
    ///
    /// # Errors
    /// The file cannot be read, or is of no format that a material is read from.
    pub fn to_read(path: &Path) -> Result<Self, FileError> {
        let mut start = Vec::new();
        let file = File::open(path).map_err(FileError::reading(path))?;
        file.take(8).read_to_end(&mut start).map_err(FileError::reading(path))?;
        let signatures: [(&[u8], Self); 6] = [
            (b"DIAPHANE", Self::Native),
            (b"PK\x03\x04", Self::Npz),
            (b" BDV\0\0\0\0", Self::Vdb),
            (b"NRRD000", Self::Nrrd),
            (b"\x76\x2f\x31\x01", Self::Exr),
            (b"VOL", Self::Mitsuba),
        ];
        let known = signatures.into_iter().find(|(signature, _)| start.starts_with(signature));
        known.map(|(_, format)| format).ok_or_else(|| FileError::OtherFormat {
            path: path.into(),
            expected: "a material: .diaphane, .npz, .vdb, .nrrd, .exr, or Mitsuba's .vol",
            found: if start.is_empty() {
                "an empty file".into()
            } else {
                format!("first bytes {:?}", String::from_utf8_lossy(&start))
            },
        })
    }

    /// Reads a material in whichever format the file is.
    ///
    /// # Errors
    /// Those of [`Format::to_read`] and of the format.
    pub fn read(path: &Path) -> Result<Reading, FileError> {
        Self::to_read(path)?.load(path)
    }

    /// Reads a material from a file that [`to_read`](Self::to_read) says is of this format.
    ///
    /// # Errors
    /// Those of the format.
    pub fn load(self, path: &Path) -> Result<Reading, FileError> {
        let bytes = || std::fs::read(path).map_err(FileError::reading(path));
        let whole = |material| Reading { material, assumed: Vec::new() };
        match self {
            Self::Npz => Material::read_npz(path).map(whole),
            Self::Vdb => vdb::read(&bytes()?, path),
            Self::Nrrd => nrrd::read(&bytes()?, path),
            Self::Exr => exr_stack::read(&bytes()?, path),
            Self::Mitsuba => mitsuba::read(path),
            _ => Material::load(path).map(whole),
        }
    }

    /// Writes a material as `path`; the conversion counts for renderers' formats alone.
    ///
    /// # Errors
    /// Impossible voxels that are to be refused, and those of the format.
    pub fn write(
        self,
        path: &Path,
        material: &Material,
        conversion: Conversion,
        overwrite: Overwrite,
    ) -> Result<Written, FileError> {
        let medium =
            || ScatteringMedium::of(material, conversion.unit, conversion.impossible, path);
        type Write = fn(&Path, &ScatteringMedium<'_>, Overwrite) -> Result<(), FileError>;
        let rendered = |write: Write| {
            let medium = medium()?;
            write(path, &medium, overwrite)?;
            Ok(Written { files: vec![path.into()], clamped: medium.clamped() })
        };
        match self {
            Self::Native => material.save(path, overwrite)?,
            Self::Npz => material.write_npz(path, overwrite)?,
            Self::Nrrd => nrrd::write(path, material, overwrite)?,
            Self::Exr => exr_stack::write(path, material, overwrite)?,
            Self::Vdb => return rendered(vdb::write),
            Self::Pbrt => return rendered(pbrt::write),
            Self::Gltf => return rendered(gltf::write),
            Self::OpenPbr => return rendered(openpbr::write),
            Self::Mitsuba => {
                let medium = medium()?;
                let files = mitsuba::export(path, &medium, overwrite)?;
                return Ok(Written { files, clamped: medium.clamped() });
            }
        }
        Ok(Written { files: vec![path.into()], clamped: 0 })
    }
}

/// Writes a material in several formats at once, by the endings of the names, and returns what was
/// written in the order of `paths`. Each file is whole or not there; where one cannot be written
/// the others may be.
///
/// # Errors
/// The first in the order of `paths` that [`Format::to_write`] or [`Format::write`] reports.
pub fn write_all(
    paths: &[PathBuf],
    material: &Material,
    conversion: Conversion,
    overwrite: Overwrite,
) -> Result<Vec<Written>, FileError> {
    let formats = paths.iter().map(|path| Format::to_write(path));
    let formats: Vec<Format> = formats.collect::<Result<_, _>>()?;
    // A thread each, not one of those that compress: most of the time that some formats take is the
    // disk's.
    std::thread::scope(|scope| {
        let write = |(format, path): (Format, &PathBuf)| {
            format.write(path, material, conversion, overwrite)
        };
        let start = |job| scope.spawn(move || write(job));
        let threads: Vec<_> = formats.into_iter().zip(paths).map(start).collect();
        let all =
            threads.into_iter().map(|thread| thread.join().unwrap_or_else(|e| resume_unwind(e)));
        all.collect()
    })
}

/// A reader over bytes, which says nothing but whether they are a file of its format.
type BytesReader = fn(&[u8]) -> Result<(), FileError>;

/// Every reader by its name, for whoever feeds them noise.
pub fn readers() -> [(&'static str, BytesReader); 6] {
    [
        ("native", |bytes| native::parse(bytes, Path::new("noise")).map(drop)),
        ("npz", |bytes| {
            let path = Path::new("noise");
            Material::of_npz(NpzReader::of_bytes(bytes.to_vec(), path)?, path).map(drop)
        }),
        ("vdb", |bytes| vdb::read(bytes, Path::new("noise")).map(drop)),
        ("nrrd", |bytes| nrrd::read(bytes, Path::new("noise")).map(drop)),
        ("exr", |bytes| exr_stack::read(bytes, Path::new("noise")).map(drop)),
        ("vol", |bytes| GridVolume::parse(bytes, Path::new("noise")).map(drop)),
    ]
}
