//! Mitsuba's volumes: layout, frame, the mapping to absorption and scattering.

mod common;

use std::path::Path;

use common::{sample, surfaced};
use material::mitsuba::{GridVolume, export};
use material::{
    Channel, Face, FileError, Grid, Impossible, Material, Optics, Overwrite, Provenance,
    ScatteringMedium, SceneUnit, absorption_and_scattering,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn medium(material: &Material, impossible: Impossible) -> Result<ScatteringMedium<'_>, FileError> {
    ScatteringMedium::of(material, SceneUnit::Millimetre, impossible, Path::new("here"))
}

/// sigma_t, albedo, sigma_a and sigma_s.
fn exported(folder: &Path, medium: &ScatteringMedium<'_>) -> [GridVolume; 4] {
    let files = export(&folder.join("scene.xml"), medium, Overwrite::Refuse).unwrap();
    let read = |name: &str| {
        GridVolume::read(files.iter().find(|file| file.ends_with(name)).unwrap()).unwrap()
    };
    ["sigma_t.vol", "albedo.vol", "sigma_a.vol", "sigma_s.vol"].map(read)
}

#[test]
fn every_voxel_arrives_where_it_belongs() {
    let folder = tempfile::tempdir().unwrap();
    let material = sample(&["R", "G", "B"]);
    let [sigma_t, albedo, sigma_a, sigma_s] =
        exported(folder.path(), &medium(&material, Impossible::Refuse).unwrap());
    assert_eq!(sigma_t.cells, [5, 4, 3]);
    // 5 · 0.1, 4 · 0.25 and 3 · 1/3 mm.
    assert_eq!(sigma_t.bounds, [[0.0; 3], [0.5, 1.0, 1.0]]);
    let grid = material.grid();
    for (c, channel) in material.channels().iter().enumerate() {
        for z in 0..3 {
            for y in 0..4 {
                for x in 0..5 {
                    let i = grid.index(x, y, z);
                    let (a, s) =
                        absorption_and_scattering(channel.kappa_mm[i], channel.mu_per_mm[i]);
                    let at = |volume: &GridVolume| volume.at_sample([x, y, z], c).unwrap();
                    // Each value is rounded to f32 once.
                    let close = |found: f32, expected: f64| {
                        (f64::from(found) / expected - 1.0).abs() < f64::from(f32::EPSILON)
                    };
                    assert!(close(at(&sigma_a), a) && close(at(&sigma_s), s));
                    assert!(close(at(&sigma_t), a + s) && close(at(&albedo), s / (a + s)));
                }
            }
        }
    }
    // In Mitsuba's own order: the first cell is the back face's (z = 0 there) lower left
    // corner, as the camera sees it; channels are fastest.
    let back_lower_left = grid.index(0, 3, 2);
    assert_eq!(sigma_a.data[1], material.channels()[1].mu_per_mm[back_lower_left]);
    assert_eq!(sigma_a.data[3], material.channels()[0].mu_per_mm[back_lower_left + 1]);
}

/// A surface lies beside the scene as a picture, one pixel a cell, row 0 on top, and is only then.
#[test]
fn a_surface_is_a_picture_beside_the_scene() {
    for names in [&["R", "G", "B"][..], &["Y"]] {
        let folder = tempfile::tempdir().unwrap();
        let material = surfaced(names);
        let files = export(
            &folder.path().join("scene.xml"),
            &medium(&material, Impossible::Refuse).unwrap(),
            Overwrite::Refuse,
        )
        .unwrap();
        let picture = folder.path().join("surface_reflectance.exr");
        assert!(files.len() == 8 && files.contains(&picture), "{files:?}");
        let image = exr::prelude::read_first_flat_layer_from_file(&picture).unwrap();
        assert_eq!((image.layer_data.size.0, image.layer_data.size.1), (5, 4));
        for (name, surface) in names.iter().zip(material.surface().unwrap()) {
            let list = &image.layer_data.channel_data.list;
            let found = list.iter().find(|channel| channel.name.to_string() == *name).unwrap();
            let values: Vec<f32> = found.sample_data.values_as_f32().collect();
            assert_eq!(values, surface.reflectance);
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let plain = sample(&["Y"]);
    let plain = medium(&plain, Impossible::Refuse).unwrap();
    let files = export(&folder.path().join("scene.xml"), &plain, Overwrite::Refuse).unwrap();
    assert!(files.len() == 7 && !folder.path().join("surface_reflectance.exr").exists());
}

#[test]
fn impossible_voxels_are_counted_and_clamped_only_when_told() {
    let folder = tempfile::tempdir().unwrap();
    let grid = Grid::new([2, 2, 2], [1.0; 3]).unwrap();
    let mut mu_per_mm = vec![0.01; 8];
    mu_per_mm[3] = 2.0;
    let channel = Channel { name: "Y".into(), kappa_mm: vec![0.3; 8], mu_per_mm, gain: 1.0 };
    let optics = Optics::from_eta(1.3);
    let material =
        Material::new(grid, vec![channel], optics, Face::Back, Provenance::default()).unwrap();

    let error = medium(&material, Impossible::Refuse).unwrap_err();
    assert!(error.to_string().contains("1 of 8"), "{error}");

    let medium = medium(&material, Impossible::Clamp).unwrap();
    assert_eq!(medium.clamped(), 1);
    let [sigma_t, albedo, ..] = exported(folder.path(), &medium);
    assert_eq!(sigma_t.at_sample([1, 1, 0], 0), Some(2.0));
    assert_eq!(albedo.at_sample([1, 1, 0], 0), Some(0.0));
    assert_eq!(albedo.at_sample([2, 0, 0], 0), None);

    let again = export(&folder.path().join("scene.xml"), &medium, Overwrite::Refuse);
    assert!(matches!(again, Err(FileError::Exists { .. })));
}

#[test]
fn two_channels_do_not_fit() {
    let folder = tempfile::tempdir().unwrap();
    let material = sample(&["R", "G"]);
    let medium = medium(&material, Impossible::Refuse).unwrap();
    let error = export(&folder.path().join("scene.xml"), &medium, Overwrite::Refuse).unwrap_err();
    assert!(error.to_string().contains("1 or 3 channels, found 2"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn damaged_volumes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.vol");
    let material = sample(&["R"]);
    let medium = medium(&material, Impossible::Refuse).unwrap();
    let volume = GridVolume::of(&medium, 1, |_, i| i as f32);
    volume.write(&path, Overwrite::Refuse).unwrap();
    assert_eq!(GridVolume::read(&path).unwrap(), volume);
    let bytes = std::fs::read(&path).unwrap();
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        GridVolume::read(&path)
    };
    for cut in 0..bytes.len() {
        assert!(read(&bytes[..cut]).is_err(), "cut at {cut}");
    }
    let changed = |at: usize, value: i32| {
        let mut bytes = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        bytes
    };
    for (at, value) in [(4, 2), (8, -1), (8, i32::MAX), (12, 0), (20, 3)] {
        assert!(read(&changed(at, value)).is_err(), "{value} at {at}");
    }
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..500 {
        let mut noise = vec![0; random.random_range(4..200)];
        random.fill(&mut noise[..]);
        noise[..4].copy_from_slice(b"VOL\x03");
        assert!(read(&noise).is_err());
    }
}
