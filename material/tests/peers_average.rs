//! The averages of a block in other people's programs: Khronos' validator of glTF (an npm package,
//! for Node.js), and MaterialX, which makes a shader of OpenPBR. `cargo xtask peers` installs both
//! beside the Python that the environment variable `DIAPHANE_PYTHON` names.

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::sample;
use material::{Conversion, Format, Overwrite};
use serde::Deserialize;

/// The interpreter; `None`, and a word about it, where none is named.
fn python() -> Option<PathBuf> {
    let python = std::env::var_os("DIAPHANE_PYTHON").map(PathBuf::from);
    if python.is_none() {
        println!(
            "SKIPPED: DIAPHANE_PYTHON names no Python beside other programs (cargo xtask peers)"
        );
    }
    python
}

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers").join(name)
}

fn output(command: &mut Command) -> Vec<u8> {
    let out = command.output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    out.stdout
}

fn written(format: Format, names: &[&str]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("average").with_extension(format.ending());
    format.write(&path, &sample(names), Conversion::default(), Overwrite::Refuse).unwrap();
    (folder, path)
}

#[derive(Debug, Deserialize)]
struct Verdict {
    messages: Vec<Message>,
    info: Info,
}

#[derive(Debug, Deserialize)]
struct Message {
    code: String,
    message: String,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Info {
    total_vertex_count: u32,
    total_triangle_count: u32,
}

/// No error, no warning, not even a hint; of two extensions the validator says that it does not know
/// them yet.
#[test]
fn khronos_validator_has_nothing_to_say() {
    let Some(python) = python() else { return };
    // Not the file that the interpreter in a virtual environment is a link to.
    let modules = python.ancestors().nth(2).unwrap_or(Path::new("")).join("node_modules");
    let there = modules.join("gltf-validator").is_dir();
    if !there || Command::new("node").arg("--version").output().is_err() {
        println!("SKIPPED: no Node.js, or no gltf-validator in {}", modules.display());
        return;
    }
    for names in [&["R", "G", "B"][..], &["Y"]] {
        let (_folder, path) = written(Format::Gltf, names);
        let mut node = Command::new("node");
        let text = output(node.arg(script("gltf.js")).arg(&path).env("NODE_PATH", &modules));
        let verdict: Verdict = serde_json::from_slice(&text).unwrap();
        let unknown = ["KHR_materials_diffuse_transmission", "KHR_materials_volume_scatter"];
        for Message { code, message } in &verdict.messages {
            let expected = unknown.iter().any(|name| message.contains(name));
            assert!(code == "UNSUPPORTED_EXTENSION" && expected, "{verdict:?}");
        }
        // Six faces, with corners of their own.
        let Info { total_vertex_count, total_triangle_count } = verdict.info;
        assert_eq!((total_vertex_count, total_triangle_count), (24, 12));
    }
}

#[derive(Debug, Deserialize)]
struct Seen {
    valid: bool,
    message: String,
    material: String,
    /// Whether OpenPBR has an input of that name and type.
    inputs: BTreeMap<String, bool>,
    /// The numbers in the shader, rounded to six digits after the point.
    uniforms: BTreeMap<String, Vec<f64>>,
}

/// MaterialX's own definition of OpenPBR knows every input, and its shader has their numbers.
#[test]
fn materialx_makes_a_shader_of_it() {
    let Some(python) = python() else { return };
    let there = Command::new(&python).args(["-c", "import MaterialX"]).output();
    if !there.is_ok_and(|out| out.status.success()) {
        println!("SKIPPED: {} has no MaterialX (cargo xtask peers)", python.display());
        return;
    }
    let (_folder, path) = written(Format::OpenPbr, &["R", "G", "B"]);
    let mut command = Command::new(&python);
    let text = output(command.arg(script("materialx.py")).arg(&path));
    let seen: Seen = serde_json::from_slice(&text).unwrap();
    assert!(seen.valid && seen.message.is_empty(), "{seen:?}");
    assert_eq!(seen.material, "block");
    assert!(seen.inputs.len() == 7 && seen.inputs.values().all(|known| *known), "{seen:?}");

    // The mean of 1/(3κ) over 60 voxels, κ = 0.1 + 0.001 i + 0.1 c.
    let path_length = |c: f64| {
        let extinction = |i| 1.0 / (3.0 * (0.1 + 0.001 * f64::from(i) + 0.1 * c));
        60.0 / (0..60).map(extinction).sum::<f64>()
    };
    let longest = path_length(2.0);
    let scale = [0.0, 1.0, 2.0].map(|c| path_length(c) / longest);
    let expected: [(&str, &[f64]); 4] = [
        ("subsurface_weight", &[1.0]),
        ("subsurface_radius", &[longest]),
        ("subsurface_radius_scale", &scale),
        ("specular_ior", &[1.0 / 0.7]),
    ];
    for (name, expected) in expected {
        let found = &seen.uniforms[name];
        assert_eq!(found.len(), expected.len(), "{name}");
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{name}: {found} {expected}");
        }
    }
}
