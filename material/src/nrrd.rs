//! NRRD (`.nrrd`): for 3D Slicer, ParaView, three.js and `pynrrd`.
//!
//! A text header up to an empty line, then numbers. The material is one array of four axes: the
//! coefficients κ and μ of each channel (fastest), x, y, z, in the sample's frame, which is what
//! medical programs call left-posterior-superior when they look at it from below: x to the right,
//! y down, z away from the camera.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::path::Path;

use flate2::read::MultiGzDecoder;

use crate::header::{Header, KEY};
use crate::reading::{Known, Reading};
use crate::{FileError, Grid, Material, Overwrite, ScatteringMedium, atomic_write};

const MAGIC: &str = "NRRD000";
/// Key of the names of what lies along the first axis.
const COEFFICIENTS: &str = "coefficients";
/// No header of ours is longer.
const LONGEST_HEADER: usize = 1 << 20;

/// Writes κ (mm) and μ (1/mm) of each channel as one array, of float32.
///
/// # Errors
/// The file is there already and `overwrite` refuses, or the system does.
pub fn write(path: &Path, material: &Material, overwrite: Overwrite) -> Result<(), FileError> {
    let channels = material.channels();
    let count = 2 * channels.len();
    let names: Vec<String> =
        channels.iter().flat_map(|c| ["kappa", "mu"].map(|k| format!("{k} {}", c.name))).collect();
    let extra = [(COEFFICIENTS, names.join(",")), ("units of coefficients", "mm,1/mm".into())];
    atomic_write(path, overwrite, |file| {
        head(file, material, Some(count), &extra)?;
        let mut bytes = Vec::new();
        for start in (0..material.grid().len()).step_by(1 << 12) {
            bytes.clear();
            for i in start..material.grid().len().min(start + (1 << 12)) {
                for channel in channels {
                    bytes.extend(channel.kappa_mm[i].to_le_bytes());
                    bytes.extend(channel.mu_per_mm[i].to_le_bytes());
                }
            }
            file.write_all(&bytes)?;
        }
        Ok(())
    })
}

/// Writes the largest extinction σt of the channels, 1/mm, as an array of three axes: for viewers
/// of volumes that know nothing else, such as three.js.
///
/// # Errors
/// As [`write`].
pub fn write_density(
    path: &Path,
    medium: &ScatteringMedium<'_>,
    overwrite: Overwrite,
) -> Result<(), FileError> {
    let material = medium.material();
    let unit_mm = medium.unit().millimetres();
    atomic_write(path, overwrite, |file| {
        head(file, material, None, &[("content", "largest extinction, 1/mm".into())])?;
        (0..material.grid().len())
            .try_for_each(|i| file.write_all(&((medium.density(i) / unit_mm) as f32).to_le_bytes()))
    })
}

/// The header of an array over the grid, with `list` numbers a voxel.
fn head(
    out: &mut impl Write,
    material: &Material,
    list: Option<usize>,
    keys: &[(&str, String)],
) -> io::Result<()> {
    let grid = material.grid();
    let ([nx, ny, nz], [hx, hy, hz]) = (grid.cells(), grid.spacing_mm());
    let [x, y, z] = grid.centre_mm(0, 0, 0);
    // What stands before the three axes of space.
    let (sizes, kinds, none, unknown, label) = match list {
        Some(count) => (format!("{count} "), "list ", "none ", "??? ", "\"coefficient\" "),
        None => (String::new(), "", "", "", ""),
    };
    writeln!(out, "{MAGIC}5")?;
    writeln!(out, "# A translucent material. Lengths are in mm.")?;
    writeln!(out, "type: float")?;
    writeln!(out, "dimension: {}", 3 + usize::from(list.is_some()))?;
    writeln!(out, "space: left-posterior-superior")?;
    writeln!(out, "sizes: {sizes}{nx} {ny} {nz}")?;
    writeln!(out, "space directions: {none}({hx},0,0) (0,{hy},0) (0,0,{hz})")?;
    writeln!(out, "centerings: {unknown}cell cell cell")?;
    writeln!(out, "kinds: {kinds}domain domain domain")?;
    writeln!(out, "labels: {label}\"x\" \"y\" \"z\"")?;
    writeln!(out, "space units: \"mm\" \"mm\" \"mm\"")?;
    writeln!(out, "space origin: ({x},{y},{z})")?;
    writeln!(out, "endian: little")?;
    writeln!(out, "encoding: raw")?;
    for (key, value) in keys {
        writeln!(out, "{key}:={value}")?;
    }
    let header = Header::of(material).ascii()?;
    // The format's own escapes; there are no line breaks in it.
    writeln!(out, "{KEY}:={}\n", header.replace('\\', "\\\\"))
}

/// A header, taken apart.
struct Head<'a> {
    /// `name: value`, names in lower case.
    fields: BTreeMap<String, &'a str>,
    /// `name:=value`.
    keys: BTreeMap<&'a str, &'a str>,
}

impl<'a> Head<'a> {
    /// The header at the start of a file, and what comes after it.
    fn parse(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), String> {
        let window = &bytes[..bytes.len().min(LONGEST_HEADER)];
        let end = window.windows(2).position(|pair| pair == b"\n\n").map(|at| (at, at + 2));
        let windows_end = window.windows(4).position(|w| w == b"\r\n\r\n").map(|at| (at, at + 4));
        let (end, data) = [end, windows_end]
            .into_iter()
            .flatten()
            .min()
            .ok_or("expected a header that ends with an empty line, found none")?;
        let text = std::str::from_utf8(&bytes[..end]).map_err(|_| "the header is not text")?;
        let (mut fields, mut keys) = (BTreeMap::new(), BTreeMap::new());
        for line in text.lines().skip(1).filter(|line| !line.starts_with('#')) {
            if let Some((key, value)) = line.split_once(":=") {
                keys.insert(key, value);
            } else if let Some((field, value)) = line.split_once(": ") {
                fields.insert(field.trim().to_lowercase(), value.trim());
            } else {
                return Err(format!("expected \"field: value\" in the header, found {line:?}"));
            }
        }
        Ok((Self { fields, keys }, &bytes[data..]))
    }

    fn field(&self, name: &str) -> Result<&'a str, String> {
        self.fields.get(name).copied().ok_or_else(|| format!("the header has no field {name:?}"))
    }

    fn sizes(&self) -> Result<[usize; 4], String> {
        let text = self.field("sizes")?;
        let sizes: Vec<usize> = text.split_whitespace().filter_map(|n| n.parse().ok()).collect();
        let wrong = || format!("expected sizes (coefficients, x, y, z), found {text:?}");
        sizes.try_into().map_err(|_| wrong())
    }

    /// Edges of a cell, mm.
    fn spacing(&self) -> Result<[f64; 3], String> {
        let directions = self.fields.get("space directions");
        let numbers: Vec<f64> = match (directions, self.fields.get("spacings")) {
            (Some(text), _) => {
                let vectors = text.split(['(', ')']).filter(|part| part.contains(','));
                let vectors = vectors.map(|v| v.split(',').map(|n| n.trim().parse::<f64>()));
                let length = |v: Vec<f64>| v.iter().map(|n| n * n).sum::<f64>().sqrt();
                let lengths = vectors.map(|v| v.collect::<Result<Vec<_>, _>>().map(length));
                lengths.collect::<Result<_, _>>().map_err(|e| format!("{text:?}: {e}"))?
            }
            (None, Some(text)) => {
                let numbers = text.split_whitespace().filter_map(|n| n.parse().ok());
                numbers.filter(|n: &f64| n.is_finite()).collect()
            }
            (None, None) => return Err("the header has no field \"space directions\"".into()),
        };
        let found = numbers.len();
        numbers.try_into().map_err(|_| format!("expected the size of 3 edges, found {found}"))
    }

    /// Where the numbers of each channel's κ and μ stand along the first axis.
    fn places(
        &self,
        path: &Path,
        names: &[String],
        count: usize,
    ) -> Result<Vec<[usize; 2]>, FileError> {
        let Some(told) = self.keys.get(COEFFICIENTS) else {
            // In the order in which we write them.
            return Ok((0..count / 2).map(|c| [2 * c, 2 * c + 1]).collect());
        };
        let told: Vec<&str> = told.split(',').take(count).collect();
        let place = |name: String| {
            told.iter().position(|t| *t == name).ok_or_else(|| FileError::MissingArray {
                path: path.into(),
                name,
                available: told.iter().map(|&name| name.into()).collect(),
            })
        };
        let both =
            |name: &String| Ok([place(format!("kappa {name}"))?, place(format!("mu {name}"))?]);
        names.iter().map(both).collect()
    }
}

/// Reads what [`write`] wrote, also after it was saved again by a program that keeps or loses the
/// keys of the header, raw or by gzip; `path` is for messages.
///
/// # Errors
/// Something else than a NRRD of four axes with the numbers in the same file, a truncated or
/// damaged one, or numbers that are no material's.
pub fn read(bytes: &[u8], path: &Path) -> Result<Reading, FileError> {
    if !bytes.starts_with(MAGIC.as_bytes()) {
        return Err(FileError::OtherFormat {
            path: path.into(),
            expected: "a NRRD file (first bytes \"NRRD000\")",
            found: "something else".into(),
        });
    }
    let malformed = |reason: String| FileError::malformed(path, reason);
    let (head, data) = Head::parse(bytes).map_err(malformed)?;
    let known = known(&head).map_err(malformed)?;
    let sizes = head.sizes().map_err(malformed)?;
    let values = numbers(&head, data, sizes).map_err(malformed)?;
    let names: Vec<String> = known.header.channels.iter().map(|c| c.name.clone()).collect();
    let [count, ..] = sizes;
    let places = head.places(path, &names, count)?;
    let pick = |place: usize| values.iter().skip(place).step_by(count).copied().collect();
    let volumes = |which: usize| places.iter().map(|both| pick(both[which])).collect();
    known.material(path, volumes(0), volumes(1))
}

fn known(head: &Head<'_>) -> Result<Known, String> {
    let [count, nx, ny, nz] = head.sizes()?;
    if let Some(json) = head.keys.get(KEY) {
        let known = Known::told(json.replace("\\\\", "\\").as_bytes())?;
        let (cells, channels) = (known.header.grid.cells(), known.header.channels.len());
        if cells != [nx, ny, nz] || count < 2 * channels {
            let expected = format!("{channels} channels of {cells:?} cells");
            return Err(format!("expected {expected}, found sizes {count} {nx} {ny} {nz}"));
        }
        return Ok(known);
    }
    if ![2, 6].contains(&count) {
        return Err(format!("expected kappa and mu of 1 or 3 channels, found {count} numbers"));
    }
    let grid = Grid::new([nx, ny, nz], head.spacing()?).map_err(|e| e.to_string())?;
    let mut known = Known::nothing(grid, count / 2);
    if !head.keys.contains_key(COEFFICIENTS) {
        known.assumed.push("its numbers are kappa (mm) and mu (1/mm) of each channel".into());
    }
    Ok(known)
}

/// All numbers, in the order of the file.
fn numbers(head: &Head<'_>, data: &[u8], sizes: [usize; 4]) -> Result<Vec<f32>, String> {
    for other in ["data file", "datafile", "byte skip", "line skip"] {
        if head.fields.contains_key(other) {
            return Err(format!("expected the numbers in the same file, found a {other:?}"));
        }
    }
    let width = match head.field("type")? {
        "float" => 4,
        "double" => 8,
        other => return Err(format!("expected float or double, found {other}")),
    };
    let big = head.fields.get("endian").is_some_and(|endian| *endian == "big");
    let expected = sizes.iter().try_fold(width, |n: usize, &size| n.checked_mul(size));
    let expected = expected.ok_or("its sizes are more than can be addressed")?;
    let wrong = |found: usize| format!("expected {expected} bytes of numbers, found {found}");
    let unpacked;
    let data = match head.field("encoding")? {
        "raw" => data,
        "gzip" | "gz" => {
            let mut out = Vec::new();
            // Grows as data arrives, so that a false size costs nothing.
            let limit = (expected as u64).saturating_add(1);
            let read = MultiGzDecoder::new(data).take(limit).read_to_end(&mut out);
            read.map_err(|e| format!("its numbers cannot be unpacked: {e}"))?;
            unpacked = out;
            &unpacked
        }
        other => return Err(format!("expected raw or gzip, found encoding {other}")),
    };
    if data.len() != expected {
        return Err(wrong(data.len()));
    }
    let float = |b: &[u8; 4]| if big { f32::from_be_bytes(*b) } else { f32::from_le_bytes(*b) };
    let double = |b: &[u8; 8]| if big { f64::from_be_bytes(*b) } else { f64::from_le_bytes(*b) };
    Ok(match width {
        4 => data.as_chunks::<4>().0.iter().map(float).collect(),
        _ => data.as_chunks::<8>().0.iter().map(|b| double(b) as f32).collect(),
    })
}
