//! Archives for NumPy: round trips, files that other writers make, and files that lie.

mod common;

use std::io::Write;
use std::path::{Path, PathBuf};

use common::{resolved, sample, surfaced};
use material::npz::{self, NpzReader};
use material::{FileError, Material, Overwrite};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use zip::write::SimpleFileOptions;

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.npz");
    (folder, path)
}

/// An archive with one array, written without our writer.
fn foreign(path: &Path, header: &str, data: &[u8], method: zip::CompressionMethod) {
    let mut zip = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    zip.start_file("a.npy", SimpleFileOptions::default().compression_method(method)).unwrap();
    zip.write_all(b"\x93NUMPY\x01\x00").unwrap();
    zip.write_all(&(header.len() as u16).to_le_bytes()).unwrap();
    zip.write_all(header.as_bytes()).unwrap();
    zip.write_all(data).unwrap();
    zip.finish().unwrap();
}

#[test]
fn a_material_round_trips() {
    let (_folder, path) = folder();
    let material = sample(&["R", "G", "B"]);
    material.write_npz(&path, Overwrite::Refuse).unwrap();
    assert_eq!(Material::read_npz(&path).unwrap(), material);
    assert!(matches!(material.write_npz(&path, Overwrite::Refuse), Err(FileError::Exists { .. })));
    let mut npz = NpzReader::open(&path).unwrap();
    assert_eq!(npz.array_f64("kappa").unwrap().shape, [3, 3, 4, 5]);
    assert_eq!(npz.scalar("eta").unwrap(), 1.0 / 0.7);
    assert_eq!(npz.shaped("spacing_mm", &[3]).unwrap(), [0.1, 0.25, 1.0 / 3.0]);
}

#[test]
fn a_resolution_round_trips() {
    let (_folder, path) = folder();
    let material = resolved(&["R", "G"]);
    material.write_npz(&path, Overwrite::Refuse).unwrap();
    assert_eq!(Material::read_npz(&path).unwrap(), material);
    let mut npz = NpzReader::open(&path).unwrap();
    assert_eq!(npz.array_f64("mu_resolution_mm").unwrap().shape, [2, 3, 4, 5]);
}

#[test]
fn a_surface_round_trips() {
    let (_folder, path) = folder();
    let material = surfaced(&["R", "G"]);
    material.write_npz(&path, Overwrite::Refuse).unwrap();
    assert_eq!(Material::read_npz(&path).unwrap(), material);
    let mut npz = NpzReader::open(&path).unwrap();
    let map = npz.array_f64("surface_reflectance").unwrap();
    assert_eq!(map.shape, [2, 4, 5]);
    // Row 1, column 2 of the second channel.
    assert_eq!(map.data[20 + 7] as f32, material.surface().unwrap()[1].reflectance[7]);

    // One row short, as if somebody had cut the picture.
    let (header, plain) = (npz.text("header").unwrap(), material.channels());
    npz::write(&path, Overwrite::Replace, |npz| {
        let kappa = plain.iter().map(|c| c.kappa_mm.as_slice());
        npz.parts_f32("kappa", &[2, 3, 4, 5], kappa)?;
        npz.parts_f32("mu", &[2, 3, 4, 5], plain.iter().map(|c| c.mu_per_mm.as_slice()))?;
        npz.array_f64("spacing_mm", &[3], &material.grid().spacing_mm())?;
        npz.array_f64("gain", &[2], &[plain[0].gain, plain[1].gain])?;
        npz.scalar("eta", material.optics().eta)?;
        npz.scalar("C", material.optics().boundary_constant)?;
        npz.array_f32("surface_reflectance", &[2, 3, 5], &[0.1; 30])?;
        npz.text("header", &header)
    })
    .unwrap();
    let told = Material::read_npz(&path).unwrap_err().to_string();
    assert!(
        ["surface_reflectance", "[2, 4, 5]", "[2, 3, 5]"].iter().all(|t| told.contains(t)),
        "{told}"
    );
}

#[test]
fn numbers_of_every_type_and_order() {
    let (_folder, path) = folder();
    let stored = zip::CompressionMethod::Stored;
    let little = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>();
    let expect = |header: &str, data: &[u8], shape: &[usize], values: &[f64]| {
        foreign(&path, header, data, stored);
        let array = NpzReader::open(&path).unwrap().array_f64("a").unwrap();
        assert_eq!(array.shape, shape, "{header}");
        assert_eq!(array.data, values, "{header}");
    };
    let c = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }";
    let six = little(&[0., 1., 2., 3., 4., 5.]);
    expect(c, &six, &[2, 3], &[0., 1., 2., 3., 4., 5.]);
    let fortran = c.replace("False", "True");
    expect(&fortran, &six, &[2, 3], &[0., 2., 4., 1., 3., 5.]);
    let cube = fortran.replace("(2, 3)", "(2, 1, 3)");
    expect(&cube, &six, &[2, 1, 3], &[0., 2., 4., 1., 3., 5.]);
    let scalar = "{'descr': '>i8', 'fortran_order': False, 'shape': (), }";
    expect(scalar, &(-7_i64).to_be_bytes(), &[], &[-7.0]);
    let small = "{'descr': '<i4', 'fortran_order': False, 'shape': (1,), }";
    expect(small, &7_i32.to_le_bytes(), &[1], &[7.0]);
    let double = "{'descr': '>f8', 'fortran_order': False, 'shape': (1,), }";
    expect(double, &0.1_f64.to_be_bytes(), &[1], &[0.1]);
    expect("{'descr': '|u1', 'fortran_order': False, 'shape': (0, 9), }", &[], &[0, 9], &[]);
}

#[test]
fn compressed_archives_are_read() {
    let (_folder, path) = folder();
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (100000,), }";
    foreign(&path, header, &[0; 800_000], zip::CompressionMethod::Deflated);
    assert!(std::fs::metadata(&path).unwrap().len() < 10_000);
    let array = NpzReader::open(&path).unwrap().array_f64("a").unwrap();
    assert_eq!(array.data, vec![0.0; 100_000]);
}

#[test]
fn missing_and_misshapen_arrays_are_named() {
    let (_folder, path) = folder();
    npz::write(&path, Overwrite::Refuse, |npz| {
        npz.array_f32("kappa", &[2, 2], &[1., 2., 3., 4.])?;
        npz.scalar("h", 0.5)?;
        npz.text("note", "κ")
    })
    .unwrap();
    let mut npz = NpzReader::open(&path).unwrap();
    assert_eq!(npz.names(), ["kappa", "h", "note"]);
    assert_eq!(npz.text("note").unwrap(), "κ");
    let says = |error: FileError, parts: &[&str]| {
        let message = error.to_string();
        for part in [&["p.npz"], parts].concat() {
            assert!(message.contains(part), "{message:?} does not say {part:?}");
        }
    };
    says(npz.array_f64("mu").unwrap_err(), &["\"mu\"", "kappa, h, note"]);
    says(npz.shaped("kappa", &[4]).unwrap_err(), &["kappa", "[4]", "[2, 2]"]);
    says(npz.scalar("kappa").unwrap_err(), &["kappa", "[2, 2]"]);
    says(npz.array_f64("note").unwrap_err(), &["note", "text"]);
    says(npz.text("h").unwrap_err(), &["\"h\"", "numbers"]);
    says(Material::read_npz(&path).unwrap_err(), &["header", "kappa, h, note"]);
}

#[test]
fn a_writer_given_the_wrong_shape_leaves_no_file() {
    let (_folder, path) = folder();
    let outcome = npz::write(&path, Overwrite::Refuse, |npz| npz.array_f32("a", &[3], &[1.0]));
    assert!(outcome.unwrap_err().to_string().contains("[3]"));
    assert!(!path.exists());
}

/// `spacing_mm`, `gain`, `eta` and `C` stand in the header too: an edit of one alone is told.
#[test]
fn a_number_changed_beside_the_header_is_noticed() {
    let (_folder, path) = folder();
    let material = sample(&["R"]);
    let header = {
        material.write_npz(&path, Overwrite::Refuse).unwrap();
        NpzReader::open(&path).unwrap().text("header").unwrap()
    };
    let write = |eta: f64| {
        let channel = &material.channels()[0];
        npz::write(&path, Overwrite::Replace, |npz| {
            npz.array_f32("kappa", &[1, 3, 4, 5], &channel.kappa_mm)?;
            npz.array_f32("mu", &[1, 3, 4, 5], &channel.mu_per_mm)?;
            npz.array_f64("spacing_mm", &[3], &material.grid().spacing_mm())?;
            npz.array_f64("gain", &[1], &[channel.gain])?;
            npz.scalar("eta", eta)?;
            npz.scalar("C", material.optics().boundary_constant)?;
            npz.text("header", &header)
        })
        .unwrap();
    };
    write(1.0 / 0.7);
    assert_eq!(Material::read_npz(&path).unwrap(), material);
    write(1.5);
    assert!(Material::read_npz(&path).unwrap_err().to_string().contains("\"eta\""));
}

#[test]
fn headers_that_lie_are_refused_without_taking_the_memory() {
    let (_folder, path) = folder();
    for shape in
        ["(99999999999,)", "(4294967296, 4294967296, 4)", "(18446744073709551615,)", "(2,)"]
    {
        let header = format!("{{'descr': '<f8', 'fortran_order': True, 'shape': {shape}, }}");
        foreign(&path, &header, &[0; 8], zip::CompressionMethod::Stored);
        let error = NpzReader::open(&path).unwrap().array_f64("a").unwrap_err();
        assert!(error.to_string().contains("found 8"), "{error}");
    }
    // The archive's own directory claims 4 GB for an entry of a few bytes.
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1,), }";
    foreign(&path, header, &[0; 8], zip::CompressionMethod::Stored);
    let mut bytes = std::fs::read(&path).unwrap();
    let directory = bytes.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
    bytes[directory + 24..directory + 28].copy_from_slice(&0xffff_fff0_u32.to_le_bytes());
    std::fs::write(&path, &bytes).unwrap();
    // What matters is that it ends at once, whether or not the few bytes are given out.
    let _ = NpzReader::open(&path).and_then(|mut npz| npz.array_f64("a"));
}

#[test]
fn archives_cut_or_damaged_anywhere_never_panic() {
    let (_folder, path) = folder();
    sample(&["R"]).write_npz(&path, Overwrite::Refuse).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for cut in (0..bytes.len()).step_by(37) {
        std::fs::write(&path, &bytes[..cut]).unwrap();
        assert!(Material::read_npz(&path).is_err(), "cut at {cut}");
    }
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let good = sample(&["R"]);
    for _ in 0..2000 {
        let mut damaged = bytes.clone();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..damaged.len());
            damaged[at] = random.random();
        }
        std::fs::write(&path, &damaged).unwrap();
        // Flags, dates and names of the archive may change without harm, the content may not.
        if let Ok(read) = Material::read_npz(&path) {
            assert_eq!(read, good);
        }
    }
}
