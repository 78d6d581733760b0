//! Materials out of OpenVDB files: ours, other programs', and files that lie.

mod common;

use std::path::Path;
use std::process::Command;

use common::{medium, sample};
use material::{FileError, Grid, Material, Overwrite, SceneUnit, vdb};

fn bytes(material: &Material, unit: SceneUnit) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.vdb");
    vdb::write(&path, &medium(material, unit), Overwrite::Refuse).unwrap();
    std::fs::read(path).unwrap()
}

fn read(bytes: &[u8]) -> Result<Material, FileError> {
    vdb::read(bytes, Path::new("m.vdb")).map(|reading| reading.material)
}

/// The same bytes with one text in place of another of the same length, wherever it stands.
fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut out = bytes.to_vec();
    let mut found = 0;
    for at in 0..bytes.len() - from.len() {
        if bytes[at..].starts_with(from.as_bytes()) {
            out[at..at + to.len()].copy_from_slice(to.as_bytes());
            found += 1;
        }
    }
    assert!(found > 0, "{from}");
    out
}

#[test]
fn a_material_round_trips() {
    for names in [&["R", "G", "B"][..], &["Y"]] {
        for unit in SceneUnit::ALL {
            let material = sample(names);
            let reading = vdb::read(&bytes(&material, unit), Path::new("m.vdb")).unwrap();
            assert_eq!(reading.material, material);
            assert!(reading.assumed.is_empty());
        }
    }
    let material = common::with_grid(Grid::new([131, 9, 18], [0.5; 3]).unwrap(), &["Y"]);
    assert_eq!(read(&bytes(&material, SceneUnit::Metre)).unwrap(), material);
}

/// Without κ and μ the coefficients of scattering do, up to the rounding of two conversions.
#[test]
fn scattering_alone_is_a_material_too() {
    let material = sample(&["R", "G", "B"]);
    let file = replaced(&bytes(&material, SceneUnit::Metre), "kappa", "other");
    let found = read(&file).unwrap();
    assert_eq!(found.grid(), material.grid());
    for (found, expected) in found.channels().iter().zip(material.channels()) {
        let pairs = found.kappa_mm.iter().zip(&expected.kappa_mm);
        for (a, b) in pairs.chain(found.mu_per_mm.iter().zip(&expected.mu_per_mm)) {
            assert!((a / b - 1.0).abs() < 4.0 * f32::EPSILON, "{a} {b}");
        }
    }
}

/// Saved without our metadata the block is what is active, and what is assumed is told.
#[test]
fn without_metadata_it_is_told_what_was_assumed() {
    let material = sample(&["R", "G", "B"]);
    let file = bytes(&material, SceneUnit::Centimetre);
    let file = replaced(&file, "diaphane_header", "somebody_header");
    let reading = vdb::read(&file, Path::new("m.vdb")).unwrap();
    assert_eq!(reading.assumed.len(), 2, "{:?}", reading.assumed);
    assert_eq!(reading.material.grid().cells(), [9, 8, 7]);
    for (found, expected) in
        reading.material.grid().spacing_mm().iter().zip(material.grid().spacing_mm())
    {
        // Divided by ten and multiplied by it.
        assert!((found / expected - 1.0).abs() < 1e-15);
    }
    let (found, expected) = (&reading.material.channels()[2], &material.channels()[2]);
    let inside = reading.material.grid().index(4, 3, 2);
    assert_eq!(found.kappa_mm[inside], expected.kappa_mm[material.grid().index(2, 1, 0)]);
}

/// As OpenVDB's own Python module saves it again: grids in another order, other metadata.
#[test]
fn other_grids_and_compressions_are_named() {
    let material = sample(&["R", "G", "B"]);
    let file = bytes(&material, SceneUnit::Millimetre);
    let other = replaced(&replaced(&file, "kappa", "other"), "sigma_a", "absorbs");
    let error = read(&other).unwrap_err().to_string();
    for part in ["kappa", "density, color, absorbs, sigma_s, other, mu"] {
        assert!(error.contains(part), "{error}");
    }
    let error = read(&replaced(&file, "Tree_vec3s", "Tree_vec3d")).unwrap_err().to_string();
    assert!(error.contains("vec3d") && error.contains("\"kappa\""), "{error}");

    let folder = tempfile::tempdir().unwrap();
    let (ours, theirs) = (folder.path().join("a.vdb"), folder.path().join("b.vdb"));
    std::fs::write(&ours, &file).unwrap();
    let script = "
import sys
try: import openvdb as vdb
except ImportError: import pyopenvdb as vdb
grids, metadata = vdb.readAll(sys.argv[1])
vdb.write(sys.argv[2], grids, metadata)";
    let mut python = Command::new("/usr/bin/python3");
    if !python.args(["-c", script]).args([&ours, &theirs]).status().unwrap().success() {
        println!("SKIPPED: /usr/bin/python3 has no OpenVDB (python3-openvdb; cargo xtask setup)");
        return;
    }
    // Debian's OpenVDB compresses with Blosc.
    match read(&std::fs::read(&theirs).unwrap()) {
        Ok(found) => assert_eq!(found, material),
        Err(error) => assert!(error.to_string().contains("Blosc"), "{error}"),
    }
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let file = bytes(&sample(&["Y"]), SceneUnit::Millimetre);
    // μ is the last grid: nothing of the file can be spared.
    for cut in (0..file.len()).step_by(97).chain([file.len() - 1]) {
        let error = read(&file[..cut]).unwrap_err().to_string();
        assert!(error.contains("m.vdb"), "{error}");
    }
    let error = read(b"PK\x03\x04 and so on").unwrap_err().to_string();
    assert!(error.contains("OpenVDB"), "{error}");
}

/// A header that claims more voxels than a file of this size has is refused before they are made.
#[test]
fn sizes_that_lie_are_refused() {
    let file = bytes(&sample(&["Y"]), SceneUnit::Millimetre);
    let lie = replaced(&file, "\"cells\":[5,4,3]", "\"cells\":[5e3,4]");
    assert!(read(&lie).unwrap_err().to_string().contains("cannot be understood"));
    // As long as what it stands for: digits are taken from the spacing.
    let truth = "\"cells\":[5,4,3],\"spacing_mm\":[0.1,0.25,0.3333333333333333]";
    let claims = "\"cells\":[5000,4000,3000],\"spacing_mm\":[1,1,0.";
    let claims = format!("{claims}{}]", "3".repeat(truth.len() - claims.len() - 1));
    let error = read(&replaced(&file, truth, &claims)).unwrap_err().to_string();
    assert!(error.contains("60000000000 voxels are more than"), "{error}");
}
