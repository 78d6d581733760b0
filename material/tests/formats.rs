//! Every format that is read: round trips, what is lost on the way, files that are something else.

mod common;

use std::path::{Path, PathBuf};

use common::{sample, surfaced};
use material::{
    Conversion, FileError, Format, Impossible, Material, Overwrite, Reading, SceneUnit, write_all,
};

fn written(format: Format, material: &Material, unit: SceneUnit) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m").with_extension(format.ending());
    let conversion = Conversion { unit, impossible: Impossible::Refuse };
    let written = format.write(&path, material, conversion, Overwrite::Refuse).unwrap();
    assert_eq!((&written.files[0], written.clamped), (&path, 0));
    assert!(written.files.iter().all(|file| file.is_file()), "{written:?}");
    let again = format.write(&path, material, conversion, Overwrite::Refuse);
    assert!(matches!(again, Err(FileError::Exists { .. })), "{format:?}");
    (folder, path)
}

/// Formats that keep κ and μ keep everything.
#[test]
fn a_material_round_trips() {
    for names in [&["R", "G", "B"][..], &["Y"]] {
        let material = sample(names);
        for format in [Format::Native, Format::Npz, Format::Vdb, Format::Nrrd, Format::Exr] {
            let (_folder, path) = written(format, &material, SceneUnit::Centimetre);
            assert_eq!(Format::to_read(&path).unwrap(), format);
            assert_eq!(Format::to_write(&path).unwrap(), format);
            let Reading { material: found, assumed } = Format::read(&path).unwrap();
            assert_eq!(found, material, "{format:?}");
            assert!(assumed.is_empty(), "{assumed:?}");
        }
    }
    // Any number of channels of any name, where no renderer has to know them.
    let material = sample(&["480 nm", "UV"]);
    for format in [Format::Native, Format::Npz, Format::Nrrd, Format::Exr] {
        let (_folder, path) = written(format, &material, SceneUnit::Millimetre);
        assert_eq!(Format::read(&path).unwrap().material, material, "{format:?}");
    }
}

/// Who keeps the surface keeps it exactly; the others drop it and nothing else.
#[test]
fn a_surface_is_kept_or_left_out() {
    for names in [&["R", "G", "B"][..], &["Y"]] {
        let material = surfaced(names);
        for format in [Format::Native, Format::Npz, Format::Vdb, Format::Nrrd, Format::Exr] {
            let (_folder, path) = written(format, &material, SceneUnit::Millimetre);
            let found = Format::read(&path).unwrap().material;
            if matches!(format, Format::Vdb | Format::Nrrd) {
                assert!(found.surface().is_none());
                let surface = material.surface().unwrap().to_vec();
                assert_eq!(found.with_surface(surface).unwrap(), material, "{format:?}");
            } else {
                assert_eq!(found, material, "{format:?}");
            }
        }
    }
}

#[test]
fn names_that_a_format_has_no_letters_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.exr");
    let conversion = Conversion::default();
    let error = Format::Exr.write(&path, &sample(&["λ1"]), conversion, Overwrite::Refuse);
    assert!(matches!(error, Err(FileError::CannotHold { .. })));
    assert!(!path.exists());
}

fn close(found: &Material, expected: &Material, roundings: f32) {
    assert_eq!(found.grid().cells(), expected.grid().cells());
    for (found, expected) in found.channels().iter().zip(expected.channels()) {
        let pairs = found.kappa_mm.iter().zip(&expected.kappa_mm);
        for (a, b) in pairs.chain(found.mu_per_mm.iter().zip(&expected.mu_per_mm)) {
            assert!((a / b - 1.0).abs() < roundings * f32::EPSILON, "{a} {b}");
        }
    }
}

/// σa and σs' come back as κ and μ but for rounding. From σt and the albedo μ = σt (1 − albedo)
/// loses as many digits as the albedo has nines.
#[test]
fn volumes_of_mitsuba_come_back() {
    let material = sample(&["R", "G", "B"]);
    for unit in SceneUnit::ALL {
        let (folder, path) = written(Format::Mitsuba, &material, unit);
        let error = Format::read(&path).unwrap_err();
        assert!(matches!(error, FileError::OtherFormat { .. }), "{error}");
        let reading = Format::read(&folder.path().join("sigma_s.vol")).unwrap();
        assert!(reading.assumed.is_empty());
        assert_eq!(reading.material.optics(), material.optics());
        assert_eq!(reading.material.provenance(), material.provenance());
        close(&reading.material, &material, 4.0);
        let reading = Format::read(&folder.path().join("albedo.vol")).unwrap();
        // The largest albedo is 1 - 3 · 0.1 · 1e-3.
        close(&reading.material, &material, 4.0 / 3e-4);

        std::fs::remove_file(folder.path().join("about.json")).unwrap();
        let reading = Format::read(&folder.path().join("sigma_a.vol")).unwrap();
        assert_eq!(reading.assumed.len(), 3, "{:?}", reading.assumed);
        let larger = unit.millimetres();
        let spacing = reading.material.grid().spacing_mm()[0] * larger;
        // The bounds are f32.
        assert!((spacing / 0.1 - 1.0).abs() < 1e-6);

        std::fs::remove_file(folder.path().join("sigma_s.vol")).unwrap();
        let error = Format::read(&folder.path().join("sigma_a.vol")).unwrap_err();
        assert!(error.to_string().contains("sigma_s.vol"), "{error}");
    }
}

#[test]
fn renderers_formats_tell_where_they_come_from() {
    let material = sample(&["R", "G", "B"]);
    for format in [Format::Mitsuba, Format::Pbrt, Format::Gltf, Format::OpenPbr] {
        let (_folder, path) = written(format, &material, SceneUnit::Millimetre);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("measurement/radiance.exr"), "{text}");
        assert!(text.contains("boundary_constant"), "{text}");
        // Nothing was left to be filled in.
        assert!(!text.contains("{SIZE") && !text.contains("{X}") && !text.contains("{LIT}"));
    }
}

/// The numbers of pbrt's scene are σa and σs' of the block and one voxel around it.
#[test]
fn pbrts_grid_is_one_voxel_wider() {
    let material = sample(&["Y"]);
    let (_folder, path) = written(Format::Pbrt, &material, SceneUnit::Millimetre);
    let text = std::fs::read_to_string(path).unwrap();
    let list = |name: &str| -> Vec<f32> {
        let start = text.find(&format!("\"{name}\" [")).unwrap() + name.len() + 4;
        let inside = &text[start..start + text[start..].find(']').unwrap()];
        inside.split_whitespace().map(|n| n.parse().unwrap()).collect()
    };
    let sigma_a = list("rgb sigma_a");
    assert_eq!(sigma_a.len(), 3 * 7 * 6 * 5);
    assert_eq!(list("rgb sigma_s").len(), sigma_a.len());
    // Cell (4, 0, 2) of the grid: (3, 0, 2) of the sample's, which is turned.
    let cell = (3 * 6 + 4) * 7 + 4;
    let mu = material.channels()[0].mu_per_mm[material.grid().index(3, 0, 0)];
    assert_eq!(sigma_a[3 * cell..3 * cell + 3], [mu; 3]);
    assert_eq!(list("point3 p0"), [-0.1, -0.25, -1.0 / 3.0]);
    assert_eq!(list("point3 p1"), [0.6, 1.25, 4.0 / 3.0]);
}

/// The homogeneous average, as glTF and OpenPBR state it: σt = −ln(colour) / distance.
#[test]
fn the_average_is_in_metres() {
    let material = sample(&["R", "G", "B"]);
    let read = |format, unit| {
        let (_folder, path) = written(format, &material, unit);
        std::fs::read_to_string(path).unwrap()
    };
    let gltf =
        |unit| -> serde_json::Value { serde_json::from_str(&read(Format::Gltf, unit)).unwrap() };
    let document = gltf(SceneUnit::Millimetre);
    let volume = &document["materials"][0]["extensions"]["KHR_materials_volume"];
    let distance = volume["attenuationDistance"].as_f64().unwrap();
    for (c, channel) in material.channels().iter().enumerate() {
        let mean = channel.kappa_mm.iter().map(|k| 1.0 / (3.0 * f64::from(*k))).sum::<f64>() / 60.0;
        let colour = volume["attenuationColor"][c].as_f64().unwrap();
        let found = -colour.ln() / distance;
        assert!((found / (1000.0 * mean) - 1.0).abs() < 1e-12, "{found} {mean}");
    }
    assert_eq!(volume["thicknessFactor"], 1e-3);
    // The scene's own unit plays no part, but for rounding.
    let metres = gltf(SceneUnit::Metre);
    let other = &metres["materials"][0]["extensions"]["KHR_materials_volume"];
    assert!((other["attenuationDistance"].as_f64().unwrap() / distance - 1.0).abs() < 1e-12);
    assert_eq!(document["accessors"][0]["max"][2], 0.5e-3_f32 as f64);

    let (millimetres, metres) =
        (read(Format::OpenPbr, SceneUnit::Millimetre), read(Format::OpenPbr, SceneUnit::Metre));
    let input = |text: &str, name: &str| -> Vec<f64> {
        let line = text.lines().find(|line| line.contains(&format!("\"{name}\""))).unwrap();
        let value = line.split("value=\"").nth(1).unwrap().split('"').next().unwrap();
        value.split(", ").map(|n| n.parse().unwrap()).collect()
    };
    let radius = |text: &str| input(text, "subsurface_radius")[0];
    assert!((radius(&millimetres) / radius(&metres) / 1000.0 - 1.0).abs() < 1e-12);
    let scale = input(&metres, "subsurface_radius_scale");
    assert!(scale.contains(&1.0) && scale.iter().all(|s| (0.3..=1.0).contains(s)), "{scale:?}");
}

#[test]
fn other_files_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let cases: [(&str, &[u8], &str); 4] = [
        ("a.vdb", b"", "an empty file"),
        ("a.npz", b"\x89PNG\r\n\x1a\n", "PNG"),
        ("a.vol", b"VOL\x03", "sigma_a.vol"),
        ("sigma_a.vol", b"VOL\x03", "sigma_a.vol"),
    ];
    for (name, bytes, told) in cases {
        std::fs::write(path(name), bytes).unwrap();
        let error = Format::read(&path(name)).unwrap_err().to_string();
        assert!(error.contains(told) && error.contains(name), "{error}");
    }
    let error = Format::read(&path("none.vdb")).unwrap_err();
    assert!(matches!(error, FileError::Io { .. }), "{error}");
    for name in ["a.png", "a", "a.vol"] {
        let error = Format::to_write(Path::new(name)).unwrap_err().to_string();
        assert!(error.contains(".vdb") && error.contains(name), "{error}");
    }
    assert_eq!(Format::to_write(Path::new("A.VDB")).unwrap(), Format::Vdb);
}

/// What lies in a file beside κ and μ is left alone.
#[test]
fn more_volumes_than_two_do_no_harm() {
    let material = sample(&["Y"]);
    let (_folder, path) = written(Format::Nrrd, &material, SceneUnit::Millimetre);
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(2).position(|w| w == b"\n\n").unwrap() + 2;
    let head = String::from_utf8_lossy(&bytes[..end])
        .replace("sizes: 2 ", "sizes: 3 ")
        .replace("kappa Y,mu Y", "resolution,mu Y,kappa Y");
    let mut more = head.into_bytes();
    for pair in bytes[end..].as_chunks::<8>().0 {
        more.extend(1_f32.to_le_bytes());
        more.extend(&pair[4..]);
        more.extend(&pair[..4]);
    }
    let found = material::nrrd::read(&more, Path::new("m.nrrd")).unwrap();
    assert_eq!(found.material, material);
}

/// Several at once: what was written comes in the order that was asked for, and so does what failed.
#[test]
fn all_at_once_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let names = ["m.vdb", "m.xml", "m.nrrd", "m.mtlx"];
    let paths = names.map(|name| folder.path().join(name));
    let (conversion, refuse) = (Conversion::default(), Overwrite::Refuse);
    let material = sample(&["R", "G", "B"]);
    let written = write_all(&paths, &material, conversion, refuse).unwrap();
    let first: Vec<_> = written.iter().map(|written| &written.files[0]).collect();
    assert_eq!(first, paths.iter().collect::<Vec<_>>());
    // The scene, its script, what it is about and four volumes.
    assert_eq!(written.iter().map(|w| w.files.len()).collect::<Vec<_>>(), [1, 7, 1, 1]);
    assert_eq!(Format::read(&paths[0]).unwrap().material, material);

    std::fs::remove_file(&paths[0]).unwrap();
    let error = write_all(&paths, &material, conversion, refuse).unwrap_err();
    assert!(matches!(error, FileError::Exists { path } if path == paths[1]));
    assert!(paths[0].is_file());
    let unknown = [folder.path().join("n.vdb"), folder.path().join("n.png")];
    let error = write_all(&unknown, &material, conversion, refuse).unwrap_err();
    assert!(error.to_string().contains(".png") && !unknown[0].exists(), "{error}");
}
