//! Exported files in other people's programs: pynrrd, OpenEXR's own Python module, NumPy, and
//! Mitsuba, which renders its scene. They are Python packages (`cargo xtask peers` installs them);
//! the environment variable `DIAPHANE_PYTHON` names an interpreter that has them.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::{medium, sample};
use material::{
    Channel, Conversion, Face, Format, Grid, Material, Optics, Overwrite, Provenance, SceneUnit,
    nrrd,
};
use serde::Deserialize;

/// The interpreter; `None`, and a word about it, where none is named.
fn python(packages: &str) -> Option<PathBuf> {
    let python = std::env::var_os("DIAPHANE_PYTHON").map(PathBuf::from);
    if python.is_none() {
        println!("SKIPPED: DIAPHANE_PYTHON names no Python with {packages} (cargo xtask peers)");
    }
    python
}

fn output(python: &Path, script: &Path, arguments: &[&Path]) -> Vec<u8> {
    let out = Command::new(python).arg(script).args(arguments).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    out.stdout
}

#[derive(Deserialize)]
struct Seen {
    nrrd: SeenNrrd,
    density: Vec<f32>,
    exr: BTreeMap<String, Vec<f32>>,
    exr_about: String,
    npz: BTreeMap<String, Vec<f32>>,
}

#[derive(Deserialize)]
struct SeenNrrd {
    values: Vec<Vec<f32>>,
    coefficients: String,
    about: String,
    directions: [[f64; 3]; 3],
    space: String,
}

#[test]
fn nrrd_exr_and_npz_bit_for_bit() {
    let Some(python) = python("pynrrd, OpenEXR and numpy") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let material = sample(&["R", "G", "B"]);
    for format in [Format::Nrrd, Format::Exr, Format::Npz] {
        let to = path("m").with_extension(format.ending());
        format.write(&to, &material, Conversion::default(), Overwrite::Refuse).unwrap();
    }
    let medium = medium(&material, SceneUnit::Metre);
    nrrd::write_density(&path("density.nrrd"), &medium, Overwrite::Refuse).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers/formats.py");
    let seen: Seen = serde_json::from_slice(&output(&python, &script, &[folder.path()])).unwrap();

    let (channels, face) = (material.channels(), material.grid().face_len());
    for (c, channel) in channels.iter().enumerate() {
        assert_eq!(seen.nrrd.values[2 * c], channel.kappa_mm);
        assert_eq!(seen.nrrd.values[2 * c + 1], channel.mu_per_mm);
        for (name, values) in [("kappa", &channel.kappa_mm), ("mu", &channel.mu_per_mm)] {
            for (z, slice) in values.chunks(face).enumerate() {
                assert_eq!(seen.exr[&format!("{name}_z{z:03}.{}", channel.name)], slice);
            }
            let whole = values.len();
            assert_eq!(seen.npz[name][c * whole..(c + 1) * whole], values[..]);
        }
    }
    assert_eq!(seen.nrrd.coefficients, "kappa R,mu R,kappa G,mu G,kappa B,mu B");
    assert_eq!(seen.nrrd.directions[1], [0.0, 0.25, 0.0]);
    assert_eq!(seen.nrrd.space, "left-posterior-superior");
    // Per mm, whatever the scene's unit; the largest of the channels is the first one's.
    let first = &channels[0];
    for (found, kappa) in seen.density.iter().zip(&first.kappa_mm) {
        assert!((found * 3.0 * kappa - 1.0).abs() < 4.0 * f32::EPSILON, "{found} {kappa}");
    }
    for about in [&seen.nrrd.about, &seen.exr_about] {
        assert!(about.contains("measurement/radiance.exr"), "{about}");
    }
    let again = Format::read(&path("again.nrrd")).unwrap();
    assert_eq!(again.material, material);
}

/// Mitsuba renders the scene and the script as they are written; the more there is of it the less
/// light comes through, in the order of the channels; and no light comes from elsewhere.
#[test]
fn mitsuba_renders_its_scene() {
    let Some(python) = python("mitsuba") else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.xml");
    let grid = Grid::new([8, 6, 4], [1.0; 3]).unwrap();
    let channel = |name: &str, mu: f32| Channel {
        name: name.into(),
        kappa_mm: vec![1.0 / 3.0; grid.len()],
        mu_per_mm: vec![mu; grid.len()],
        gain: 1.0,
    };
    let channels = vec![channel("R", 0.01), channel("G", 0.1), channel("B", 0.5)];
    let optics = Optics::from_eta(1.3);
    let material =
        Material::new(grid, channels, optics, Face::Back, Provenance::default()).unwrap();
    Format::Mitsuba.write(&scene, &material, Conversion::default(), Overwrite::Refuse).unwrap();
    let means = "
import sys, numpy as np, mitsuba as mi
mi.set_variant('scalar_rgb')
scene = mi.load_file(sys.argv[1], spp=1)
image = np.array(mi.render(scene))
print(image.shape, *image.mean((0, 1)))";
    let probe = folder.path().join("probe.py");
    std::fs::write(&probe, means).unwrap();
    let text = String::from_utf8(output(&python, &probe, &[&scene])).unwrap();
    let (shape, values) = text.rsplit_once(')').unwrap();
    assert_eq!(shape, "(192, 256, 3");
    let joint: Vec<f64> = values.split_whitespace().map(|n| n.parse().unwrap()).collect();

    let picture = folder.path().join("out.exr");
    let script = folder.path().join("render.py");
    let text = output(&python, &script, &[Path::new("1"), &picture]);
    let text = String::from_utf8(text).unwrap();
    let apart: Vec<f64> =
        text.lines().filter_map(|line| line.split("mean radiance ").nth(1)?.parse().ok()).collect();
    assert!(picture.is_file() && picture.with_extension("png").is_file());
    // Four mean free paths of white light's 1/π, less what the surface sends back.
    assert!(apart[0] > 0.03 && apart[0] < 0.2, "{apart:?}");
    assert!(apart[0] > 1.2 * apart[1] && apart[1] > 2.0 * apart[2], "{apart:?}");
    for (joint, apart) in joint.iter().zip(&apart) {
        // 49,152 paths each, of which one in ten arrives or fewer: about 3 % and 10 % in blue.
        assert!((joint / apart - 1.0).abs() < 0.25, "{joint} {apart}");
    }
}
