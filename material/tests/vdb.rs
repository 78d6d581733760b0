//! OpenVDB files, read back by OpenVDB itself (Debian's `python3-openvdb` and `libopenvdb-tools`).

mod common;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use common::{medium, sample};
use material::{
    FileError, Grid, Impossible, Material, Overwrite, ScatteringMedium, SceneUnit, vdb,
};
use serde::Deserialize;

/// Of Debian and Ubuntu: their modules are of no use to another Python.
const PYTHON: &str = "/usr/bin/python3";

/// What `peers/vdb.py` prints.
#[derive(Debug, Deserialize)]
struct Seen {
    metadata: BTreeMap<String, serde_json::Value>,
    grids: BTreeMap<String, SeenGrid>,
}

#[derive(Debug, Deserialize)]
struct SeenGrid {
    #[serde(rename = "type")]
    kind: String,
    low: [i32; 3],
    cells: [usize; 3],
    active: i64,
    class: String,
    first: [f64; 3],
    next: [f64; 3],
    uniform: bool,
    metadata: BTreeMap<String, String>,
    /// In the order x, y, z, component, the last fastest.
    #[serde(skip)]
    values: Vec<f32>,
}

impl SeenGrid {
    /// The numbers at an index.
    fn at(&self, index: [i32; 3]) -> &[f32] {
        let width = self.values.len() / self.cells.iter().product::<usize>();
        let [x, y, z] = [0, 1, 2].map(|axis| (index[axis] - self.low[axis]) as usize);
        let voxel = (x * self.cells[1] + y) * self.cells[2] + z;
        &self.values[voxel * width..(voxel + 1) * width]
    }
}

/// The file as OpenVDB's Python module has it; `None`, and a word about it, where there is none.
fn seen(path: &Path) -> Option<Seen> {
    let probe = "\
try: import openvdb
except ImportError: import pyopenvdb
import numpy";
    if !Command::new(PYTHON).args(["-c", probe]).output().is_ok_and(|out| out.status.success()) {
        println!("SKIPPED: {PYTHON} has no OpenVDB (python3-openvdb; cargo xtask setup)");
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/vdb.py");
    let out = Command::new(PYTHON).arg(script).arg(path).arg(folder.path()).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let mut seen: Seen = serde_json::from_slice(&out.stdout).unwrap();
    for (name, grid) in &mut seen.grids {
        let bytes = std::fs::read(folder.path().join(format!("{name}.f32"))).unwrap();
        let numbers = bytes.as_chunks::<4>().0.iter();
        grid.values = numbers.map(|b| f32::from_le_bytes(*b)).collect();
    }
    Some(seen)
}

/// Each voxel of each grid, bit for bit, in the block and beyond it.
fn compare(seen: &Seen, medium: &ScatteringMedium<'_>) {
    let material = medium.material();
    let cells = material.grid().cells();
    let channels = material.channels();
    let all = |of: &dyn Fn(usize) -> f64| (0..channels.len()).map(|c| of(c) as f32).collect();
    let mut compared = 0;
    for x in -2..cells[0] as i32 + 2 {
        for y in -2..cells[1] as i32 + 2 {
            for z in -2..cells[2] as i32 + 2 {
                let voxel = [x, y, z];
                let nearest: [usize; 3] =
                    std::array::from_fn(|a| voxel[a].clamp(0, cells[a] as i32 - 1) as usize);
                let inside = (0..3).all(|a| voxel[a] == nearest[a] as i32);
                // Half a turn about the x axis.
                let [nx, ny, nz] = nearest;
                let index = material.grid().index(nx, cells[1] - 1 - ny, cells[2] - 1 - nz);
                let sigma = |c: usize| medium.sigma(c, index);
                let beyond = |value: f64| if inside { value } else { 0.0 };
                let expected: [(&str, Vec<f32>); 6] = [
                    ("density", vec![beyond(medium.density(index)) as f32]),
                    ("color", {
                        let albedo = |c: usize| (sigma(c).1 / (sigma(c).0 + sigma(c).1)) as f32;
                        (0..3).map(|c| albedo(c.min(channels.len() - 1))).collect()
                    }),
                    ("sigma_a", all(&|c| beyond(sigma(c).0))),
                    ("sigma_s", all(&|c| beyond(sigma(c).1))),
                    ("kappa", all(&|c| f64::from(channels[c].kappa_mm[index]))),
                    ("mu", all(&|c| f64::from(channels[c].mu_per_mm[index]))),
                ];
                assert_eq!(seen.grids.len(), expected.len());
                for (name, expected) in expected {
                    let found = seen.grids[name].at(voxel).iter().map(|v| v.to_bits());
                    let expected = expected.iter().map(|v| v.to_bits());
                    assert!(found.eq(expected), "{name} at {voxel:?}");
                    compared += 1;
                }
            }
        }
    }
    assert!(compared > 6 * material.grid().len());
}

fn written(medium: &ScatteringMedium<'_>) -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.vdb");
    vdb::write(&path, medium, Overwrite::Refuse).unwrap();
    (folder, path)
}

#[test]
fn openvdb_reads_every_voxel_bit_for_bit() {
    let material = sample(&["R", "G", "B"]);
    let medium = medium(&material, SceneUnit::Millimetre);
    let (_folder, path) = written(&medium);
    let Some(seen) = seen(&path) else { return };
    compare(&seen, &medium);
    for (name, grid) in &seen.grids {
        assert_eq!(grid.kind, if name == "density" { "float" } else { "vec3s" });
        assert_eq!(grid.class, if name == "density" { "fog volume" } else { "unknown" });
        // The block of 5 × 4 × 3 and two voxels around it.
        assert_eq!((grid.low, grid.cells, grid.active), ([-2; 3], [9, 8, 7], 9 * 8 * 7));
        // Cells of 0.1 × 0.25 × 1/3 mm, the first one's centre half a cell inside.
        assert!(!grid.uniform);
        let third = 1.0 / 3.0;
        assert_eq!(grid.first, [0.05, 0.125, third / 2.0]);
        let next = [0.15, 0.375, 1.5 * third];
        for axis in 0..3 {
            // Rounding of one sum.
            assert!((grid.next[axis] - next[axis]).abs() < 1e-15);
        }
        assert!(grid.metadata["diaphane_header"].contains("l-bfgs, κ and μ"));
    }
    assert_eq!(seen.grids["kappa"].metadata["unit"], "mm");
    assert_eq!(seen.grids["sigma_a"].metadata["unit"], "1/mm");
    assert_eq!(seen.grids["color"].metadata["vector_type"], "invariant");
    assert_eq!(seen.metadata["creator"], "diaphane 0.1.0");
    assert_eq!(seen.metadata["diaphane_scene_unit"], "mm");
    let header: serde_json::Value =
        serde_json::from_str(seen.metadata["diaphane_header"].as_str().unwrap()).unwrap();
    assert_eq!(header["provenance"]["inputs"][0]["blake3"], "0".repeat(64));
}

/// Several nodes of each level, leaves that end within the block, one channel, cubes, metres.
#[test]
fn larger_blocks_of_one_channel_in_metres() {
    let grid = Grid::new([131, 9, 18], [0.5; 3]).unwrap();
    let material = common::with_grid(grid, &["Y"]);
    let medium = medium(&material, SceneUnit::Metre);
    let (_folder, path) = written(&medium);
    let Some(seen) = seen(&path) else { return };
    compare(&seen, &medium);
    let grids = &seen.grids;
    assert!(grids.values().all(|grid| grid.uniform && grid.first == [0.25e-3; 3]));
    assert_eq!(grids["sigma_s"].kind, "float");
    assert_eq!(grids["sigma_s"].metadata["unit"], "1/m");
    assert_eq!(grids["mu"].metadata["unit"], "1/mm");
}

#[test]
fn vdb_print_reads_it() {
    let material = sample(&["R", "G", "B"]);
    let (_folder, path) = written(&medium(&material, SceneUnit::Millimetre));
    let Ok(out) = Command::new("vdb_print").arg("-l").arg("-m").arg(&path).output() else {
        println!("SKIPPED: there is no vdb_print (libopenvdb-tools; cargo xtask setup)");
        return;
    };
    let text = String::from_utf8_lossy(&out.stdout);
    assert!(out.status.success(), "{text}{}", String::from_utf8_lossy(&out.stderr));
    for part in ["density", "color", "sigma_a", "sigma_s", "kappa", "mu", "zip + active values"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    assert!(text.contains("fog volume") && text.contains("9 x 8 x 7"), "{text}");
}

#[test]
fn the_same_material_makes_the_same_bytes() {
    let material = sample(&["R", "G", "B"]);
    let medium = medium(&material, SceneUnit::Millimetre);
    let read = |(folder, path): (tempfile::TempDir, _)| {
        let bytes = std::fs::read(path).unwrap();
        drop(folder);
        bytes
    };
    assert_eq!(read(written(&medium)), read(written(&medium)));
}

#[test]
fn what_does_not_fit_is_not_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.vdb");
    let two = sample(&["R", "G"]);
    let medium = medium(&two, SceneUnit::Millimetre);
    let error = vdb::write(&path, &medium, Overwrite::Refuse).unwrap_err();
    assert!(error.to_string().contains("1 or 3 channels, found 2"), "{error}");
    assert!(!path.exists());
    std::fs::write(&path, "mine").unwrap();
    let material = sample(&["R"]);
    let medium = common::medium(&material, SceneUnit::Millimetre);
    let refused = vdb::write(&path, &medium, Overwrite::Refuse);
    assert!(matches!(refused, Err(FileError::Exists { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
}

/// What [`Material`] lets through and no medium has: counted, and clamped when told.
#[test]
fn impossible_voxels_absorb_and_do_not_scatter() {
    let mut material = sample(&["R"]);
    let mut channel = material.channels()[0].clone();
    channel.mu_per_mm[7] = 100.0;
    material = Material::new(
        *material.grid(),
        vec![channel],
        *material.optics(),
        material.lit_face(),
        material.provenance().clone(),
    )
    .unwrap();
    let of = |impossible| {
        ScatteringMedium::of(&material, SceneUnit::Millimetre, impossible, Path::new("m.vdb"))
    };
    assert!(of(Impossible::Refuse).unwrap_err().to_string().contains("1 of 60"));
    let medium = of(Impossible::Clamp).unwrap();
    assert_eq!(medium.sigma(0, 7), (100.0, 0.0));
    let (_folder, path) = written(&medium);
    let Some(seen) = seen(&path) else { return };
    compare(&seen, &medium);
}
