//! Materials from one format to another, and what is told of them.

mod common;

use common::diaphane;
use material::{Channel, Face, Grid, Material, Optics, Overwrite, Provenance, Surface};
use std::path::Path;

/// A block of wax, 20 × 20 × 12 mm, with one voxel that no medium has if `impossible`.
fn wax(path: &Path, impossible: bool) -> Material {
    let grid = Grid::new([40, 40, 24], [0.5; 3]).unwrap();
    let channel = |name: &str, mu: f32| Channel {
        name: name.into(),
        kappa_mm: (0..grid.len()).map(|i| 0.25 + 1e-6 * i as f32).collect(),
        mu_per_mm: (0..grid.len())
            .map(|i| if impossible && i == 77 { 9.0 } else { mu + 1e-8 * i as f32 })
            .collect(),
        gain: 1.0,
    };
    let channels = vec![channel("R", 0.001), channel("G", 0.002), channel("B", 0.004)];
    let provenance = Provenance { software: "diaphane".into(), ..Provenance::default() };
    let material =
        Material::new(grid, channels, Optics::from_eta(1.4), Face::Back, provenance).unwrap();
    material.save(path, Overwrite::Refuse).unwrap();
    material
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> =
        entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn a_chain_of_formats_ends_where_it_began() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let material = wax(&path("a.diaphane"), false);
    for pair in ["a.diaphane", "b.vdb", "c.nrrd", "d.exr", "e.npz", "f.diaphane"].windows(2) {
        let run = diaphane([Path::new("convert"), &path(pair[0]), &path(pair[1])]);
        assert_eq!(run.code, 0, "{}", run.stderr);
        assert_eq!(run.json["assumed"], serde_json::json!([]));
    }
    assert_eq!(Material::load(&path("f.diaphane")).unwrap(), material);
    let run = diaphane([Path::new("convert"), &path("b.vdb"), &path("scene.xml")]);
    assert_eq!(run.json["files"].as_array().unwrap().len(), 7, "{}", run.stderr);
    std::fs::remove_file(path("about.json")).unwrap();
    let run = diaphane([Path::new("convert"), &path("sigma_s.vol"), &path("g.npz")]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("does not tell") && run.stderr.contains("1 mm"), "{}", run.stderr);
}

/// A surface goes along where a format has a place for it, `info` tells its range, and a format that
/// loses it loses nothing else.
#[test]
fn a_surface_is_carried_and_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let plain = wax(&path("plain.diaphane"), false);
    let (channels, provenance) = (plain.channels().to_vec(), plain.provenance().clone());
    let lit = Material::new(*plain.grid(), channels, *plain.optics(), Face::Front, provenance);
    let reflectance: Vec<f32> = (0..1600).map(|i| 0.0625 * (i % 3) as f32).collect();
    let material = lit.unwrap().with_surface(vec![Surface { reflectance }; 3]).unwrap();
    material.save(&path("a.diaphane"), Overwrite::Refuse).unwrap();
    for pair in ["a.diaphane", "b.npz", "c.exr", "d.diaphane", "e.nrrd"].windows(2) {
        let run = diaphane([Path::new("convert"), &path(pair[0]), &path(pair[1])]);
        assert_eq!(run.code, 0, "{}", run.stderr);
    }
    assert_eq!(Material::load(&path("d.diaphane")).unwrap(), material);
    let run = diaphane([Path::new("info"), &path("b.npz")]);
    let told = &run.json["channels"][2]["surface_reflectance"];
    assert_eq!(*told, serde_json::json!({ "min": 0.0, "median": 0.0625, "max": 0.125 }));
    assert!(run.stderr.contains("surface reflectance 0 to 0.125, median 0.0625"), "{}", run.stderr);
    let run = diaphane([Path::new("info"), &path("e.nrrd")]);
    assert!(run.code == 0 && !run.stderr.contains("surface"), "{}", run.stderr);
}

#[test]
fn info_tells_what_a_material_is_like() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    wax(&path("a.diaphane"), true);
    let npz = [Path::new("convert"), &path("a.diaphane"), &path("a.npz")].map(Path::to_path_buf);
    assert_eq!(diaphane(npz).code, 0);
    for name in ["a.diaphane", "a.npz"] {
        let run = diaphane([Path::new("info"), &path(name)]);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let json = &run.json;
        assert_eq!(json["format"], name.split('.').nth(1).unwrap());
        assert_eq!(json["cells"], serde_json::json!([40, 40, 24]));
        let red = &json["channels"][0];
        assert_eq!(red["impossible_voxels"], 1);
        assert_eq!(red["impossible_share"].as_f64().unwrap(), 1.0 / 38400.0);
        // 3κ is 0.75 to 0.87 mm; 12 mm are 15 mean free paths; one voxel of 38,400 absorbs 9/mm.
        let number = |name: &str| red[name].as_f64().unwrap();
        assert!((number("mean_free_path_mm") - 0.8076).abs() < 1e-3, "{red}");
        assert!((red["mean_free_path_voxels"][2].as_f64().unwrap() - 1.6152).abs() < 1e-3);
        assert!((number("optical_thickness") - 14.9).abs() < 0.1, "{red}");
        assert!((number("albedo") - 0.99885).abs() < 2e-4, "{red}");
        assert_eq!(red["diffusion_holds"], true, "{red}");
        assert_eq!(red["mu_per_mm"]["max"], 9.0);
        for part in ["40 × 40 × 24 voxels", "▁", "3κμ > 1): 1 (", "transport", "model holds"]
        {
            assert!(run.stderr.contains(part), "{part}: {}", run.stderr);
        }
    }
    // Fewer voxels than mean free paths make a coarse grid: that is told.
    let grid = Grid::new([4, 4, 3], [4.0; 3]).unwrap();
    let channel =
        Channel { name: "Y".into(), kappa_mm: vec![0.3; 48], mu_per_mm: vec![0.3; 48], gain: 1.0 };
    let optics = Optics::from_eta(1.0);
    let coarse =
        Material::new(grid, vec![channel], optics, Face::Back, Provenance::default()).unwrap();
    coarse.save(&path("coarse.diaphane"), Overwrite::Refuse).unwrap();
    let run = diaphane([Path::new("info"), &path("coarse.diaphane")]);
    assert_eq!(run.json["channels"][0]["diffusion_holds"], false);
    assert!(run.stderr.contains("may be off by"), "{}", run.stderr);
}

#[test]
fn impossible_voxels_are_clamped_only_when_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    wax(&path("a.diaphane"), true);
    for name in ["a.vdb", "scene.xml", "a.pbrt", "a.gltf", "a.mtlx"] {
        let args = [Path::new("convert"), &path("a.diaphane"), &path(name)].map(Path::to_path_buf);
        let run = diaphane(&args);
        assert_eq!(run.code, 2, "{}", run.stderr);
        assert!(
            run.stderr.contains("3 of 115200") && run.stderr.contains("--clamp"),
            "{}",
            run.stderr
        );
        assert_eq!(names(folder.path()), ["a.diaphane"]);
        let clamped = diaphane(args.iter().chain([&"--clamp".into()]));
        assert_eq!((clamped.code, &clamped.json["clamped"]), (0, &serde_json::json!(3)));
        assert!(clamped.stderr.contains("3 voxel values"), "{}", clamped.stderr);
        for name in names(folder.path()).iter().filter(|name| *name != "a.diaphane") {
            std::fs::remove_file(path(name)).unwrap();
        }
    }
}

#[test]
fn bad_input_is_told_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    wax(&path("a.diaphane"), false);
    let refused = |from: &str, to: &str, parts: &[&str]| {
        let run = diaphane([Path::new("convert"), &path(from), &path(to)]);
        assert_eq!(run.code, 2, "{}", run.stderr);
        for part in parts {
            assert!(run.stderr.contains(part), "{part}: {}", run.stderr);
        }
        assert!(!names(folder.path()).iter().any(|name| name.starts_with(".part")));
    };
    refused("a.diaphane", "a.png", &["a.png", ".vdb", ".nrrd"]);
    refused("a.diaphane", "none/a.vdb", &["mkdir -p"]);
    refused("none.vdb", "b.npz", &["none.vdb"]);
    std::fs::write(path("noise.vdb"), [7; 999]).unwrap();
    refused("noise.vdb", "b.npz", &["noise.vdb", "expected a material"]);
    std::fs::write(path("mine.vdb"), "mine").unwrap();
    refused("a.diaphane", "mine.vdb", &["mine.vdb", "--force"]);
    assert_eq!(std::fs::read(path("mine.vdb")).unwrap(), b"mine");

    // Every format, cut in the middle.
    for name in ["b.vdb", "b.nrrd", "b.exr", "b.npz"] {
        let run = diaphane([Path::new("convert"), &path("a.diaphane"), &path(name)]);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let whole = std::fs::read(path(name)).unwrap();
        std::fs::write(path(name), &whole[..whole.len() / 2]).unwrap();
        refused(name, "c.diaphane", &[name]);
        let run = diaphane([Path::new("info"), &path(name)]);
        assert_eq!(run.code, 2, "{}", run.stderr);
    }
    assert!(!path("c.diaphane").exists());

    // Volumes of something else.
    let whole = diaphane([Path::new("convert"), &path("a.diaphane"), &path("d.vdb")]);
    assert_eq!(whole.code, 0, "{}", whole.stderr);
    let mut bytes = std::fs::read(path("d.vdb")).unwrap();
    for at in 0..bytes.len() - 7 {
        for (from, to) in [(&b"kappa"[..], &b"smoke"[..]), (b"sigma_a", b"sparkle")] {
            if bytes[at..].starts_with(from) {
                bytes[at..at + from.len()].copy_from_slice(to);
            }
        }
    }
    std::fs::write(path("d.vdb"), bytes).unwrap();
    refused("d.vdb", "c.diaphane", &["d.vdb", "\"kappa\"", "smoke, mu"]);
}

/// Where nothing can be written that is told before the work; root may write everywhere.
#[cfg(unix)]
#[test]
fn folders_that_take_no_files() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let closed = folder.path().join("closed");
    wax(&folder.path().join("a.diaphane"), false);
    std::fs::create_dir(&closed).unwrap();
    std::fs::set_permissions(&closed, std::fs::Permissions::from_mode(0o555)).unwrap();
    if std::fs::write(closed.join("probe"), "").is_ok() {
        println!("SKIPPED: this user may write into any folder");
        return;
    }
    let from = folder.path().join("a.diaphane");
    let run = diaphane([Path::new("convert"), &from, &closed.join("a.vdb")]);
    assert_eq!(run.code, 2, "{}", run.stderr);
    assert!(run.stderr.contains("nothing can be written"), "{}", run.stderr);
}
