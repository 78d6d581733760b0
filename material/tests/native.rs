//! The native form: what is written comes back, and nothing damaged gets through.

mod common;

use std::path::{Path, PathBuf};

use common::{resolved, sample, surfaced};
use material::{FileError, Material, Overwrite};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn written() -> (tempfile::TempDir, PathBuf, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slab.diaphane");
    sample(&["R", "G", "B"]).save(&path, Overwrite::Refuse).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    (folder, path, bytes)
}

fn load(path: &Path, bytes: &[u8]) -> Result<Material, FileError> {
    std::fs::write(path, bytes).unwrap();
    Material::load(path)
}

/// The file with its hash made right again after a change.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.truncate(bytes.len() - 32);
    let hash = blake3::hash(&bytes);
    bytes.extend(hash.as_bytes());
    bytes
}

#[test]
fn what_is_written_comes_back() {
    let (_folder, path, _) = written();
    assert_eq!(Material::load(&path).unwrap(), sample(&["R", "G", "B"]));
}

/// With a resolution the arrays that every reader knows stand where they stood, and their list is as
/// it was: a reader of before skips what it does not know.
#[test]
fn a_resolution_goes_along_and_disturbs_nobody() {
    let (_folder, path, plain) = written();
    let material = resolved(&["R", "G", "B"]);
    material.save(&path, Overwrite::Replace).unwrap();
    assert_eq!(Material::load(&path).unwrap(), material);
    let bytes = std::fs::read(&path).unwrap();
    let open = |bytes: &[u8]| {
        let header = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let json: serde_json::Value = serde_json::from_slice(&bytes[16..16 + header]).unwrap();
        (json, bytes[16 + header..bytes.len() - 32].to_vec())
    };
    let ((before, old), (after, new)) = (open(&plain), open(&bytes));
    assert_eq!((&after["arrays"], before.get("resolution")), (&before["arrays"], None));
    assert_eq!(old, new[..old.len()]);
    assert_eq!(new.len(), 2 * old.len());
    let last = &after["resolution"][5];
    assert_eq!((&last["coefficient"], &last["channel"]), (&"mu-resolution".into(), &2.into()));
    let error = load(&path, &bytes[..bytes.len() - 100]).unwrap_err();
    assert!(matches!(error, FileError::WrongSize { .. }), "{error}");
    // A list that lacks an array is a damaged file, not a material without: the second entry says
    // that it is μ's own, not μ's resolution.
    let name = b"\"mu-resolution\"";
    let at = bytes.windows(name.len()).position(|w| w == name).unwrap();
    let mut other = bytes.clone();
    other[at..at + name.len()].copy_from_slice(b"\"mu\"           ");
    let error = load(&path, &sealed(other)).unwrap_err();
    assert!(error.to_string().contains("resolution of mu"), "{error}");
}

/// So does a surface, whose arrays are as long as the front face; one that is cut short, is not there
/// or belongs to a material that is lit from the back is refused.
#[test]
fn a_surface_goes_along_and_disturbs_nobody() {
    let (_folder, path, _) = written();
    let material = surfaced(&["R", "G", "B"]);
    material.save(&path, Overwrite::Replace).unwrap();
    assert_eq!(Material::load(&path).unwrap(), material);
    let bytes = std::fs::read(&path).unwrap();
    let header = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[16..16 + header]).unwrap();
    assert_eq!(json["arrays"].as_array().unwrap().len(), 6);
    let last = &json["surface"][2];
    assert_eq!(last["coefficient"], "surface-reflectance");
    // Behind six arrays of 60 values and two of 20.
    assert_eq!((&last["offset"], &last["length"]), (&1600.into(), &20.into()));
    assert_eq!(bytes.len(), 16 + header + 1680 + 32);

    let lie = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let at = bytes.windows(from.len()).rposition(|w| w == from.as_bytes()).unwrap();
        let mut other = bytes.clone();
        other[at..at + to.len()].copy_from_slice(to.as_bytes());
        load(&path, &sealed(other)).unwrap_err().to_string()
    };
    let told = lie("\"length\":20", "\"length\":19");
    assert!(
        told.contains(
            "B: surface reflectance needs one value a cell of the front face (20), found 19"
        ),
        "{told}"
    );
    let told = lie("\"offset\":1600", "\"offset\":1604");
    assert!(told.contains("1684") && told.contains("1680"), "{told}");
    let told =
        lie("\"channel\":2,\"coefficient\":\"surface", "\"channel\":9,\"coefficient\":\"surface");
    assert!(told.contains("surface reflectance of channel 2"), "{told}");
    let told = lie("\"lit_face\":\"front\"", "\"lit_face\":\"back\" ");
    assert!(told.contains("lit on the front face"), "{told}");
    // A value that no surface has: the last before the hash.
    let mut bad = bytes.clone();
    let at = bytes.len() - 36;
    bad[at..at + 4].copy_from_slice(&(-0.5_f32).to_le_bytes());
    let told = load(&path, &sealed(bad)).unwrap_err().to_string();
    assert!(told.contains("at least 0, found -0.5 in voxel (4, 3, 0)"), "{told}");
}

#[test]
fn nothing_is_overwritten_unless_told() {
    let (_folder, path, bytes) = written();
    let other = sample(&["Y"]);
    assert!(matches!(other.save(&path, Overwrite::Refuse), Err(FileError::Exists { .. })));
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
    other.save(&path, Overwrite::Replace).unwrap();
    assert_eq!(Material::load(&path).unwrap(), other);
}

#[test]
fn the_layout_is_the_documented_one() {
    let (_folder, _, bytes) = written();
    assert_eq!(&bytes[..8], b"DIAPHANE");
    assert_eq!(bytes[8..12], 1_u32.to_le_bytes());
    let header = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    assert_eq!(header % 8, 0);
    let json: serde_json::Value = serde_json::from_slice(&bytes[16..16 + header]).unwrap();
    assert_eq!(json["grid"]["cells"], serde_json::json!([5, 4, 3]));
    // μ of G: the fourth array of 60 values.
    let entry = &json["arrays"][3];
    assert_eq!((entry["channel"].as_u64(), entry["coefficient"].as_str()), (Some(1), Some("mu")));
    let at = 16 + header + entry["offset"].as_u64().unwrap() as usize;
    let first = f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!(first, sample(&["R", "G"]).channels()[1].mu_per_mm[0]);
    assert_eq!(bytes.len(), 16 + header + 6 * 60 * 4 + 32);
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let (_folder, path, bytes) = written();
    for cut in 0..bytes.len() {
        let error = load(&path, &bytes[..cut]).unwrap_err();
        assert!(error.to_string().contains("slab.diaphane"), "cut at {cut}: {error}");
    }
    // With its header whole, it is known to be incomplete and by how much.
    let error = load(&path, &bytes[..bytes.len() - 100]).unwrap_err();
    let (full, cut) = (bytes.len() as u64, bytes.len() as u64 - 100);
    assert!(
        matches!(error, FileError::WrongSize { expected, found, .. } if expected == full && found == cut),
        "{error}"
    );
    let longer = [&bytes[..], &[0; 8]].concat();
    assert!(matches!(load(&path, &longer), Err(FileError::WrongSize { .. })));
}

#[test]
fn a_flipped_bit_anywhere_is_noticed() {
    let (_folder, path, bytes) = written();
    for at in 0..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << (at % 8);
        assert!(load(&path, &flipped).is_err(), "byte {at}");
    }
    let mut flipped = bytes.clone();
    flipped[bytes.len() - 500] ^= 4;
    assert!(matches!(load(&path, &flipped), Err(FileError::Damaged { .. })));
}

#[test]
fn other_files_and_newer_versions_are_told_apart() {
    let (_folder, path, mut bytes) = written();
    let error = load(&path, b"VOL\x03 and so on").unwrap_err();
    assert!(matches!(error, FileError::OtherFormat { .. }), "{error}");
    assert!(load(&path, b"").unwrap_err().to_string().contains("empty"));
    bytes[8] = 2;
    // Both with a hash that is right and with one that a later format may put elsewhere.
    for bytes in [bytes.clone(), sealed(bytes)] {
        let error = load(&path, &bytes).unwrap_err();
        assert!(matches!(error, FileError::NewerVersion { found: 2, supported: 1, .. }), "{error}");
        assert!(error.to_string().contains("newer version"));
    }
    std::fs::remove_file(&path).unwrap();
    assert!(matches!(Material::load(&path), Err(FileError::Io { .. })));
}

/// Files that are whole, but whose header lies.
#[test]
fn a_sealed_lie_is_refused() {
    let (_folder, path, bytes) = written();
    let header = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let text = std::str::from_utf8(&bytes[16..16 + header]).unwrap();
    let lie = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        let mut header = text.trim_end().replacen(from, to, 1).into_bytes();
        header.resize(header.len().next_multiple_of(8), b' ');
        let length = (header.len() as u32).to_le_bytes();
        let data = &bytes[16 + text.len()..];
        sealed([&bytes[..12], &length, &header, data].concat())
    };
    let cases = [
        ("\"cells\":[5,4,3]", "\"cells\":[5,4,4]"),
        ("\"cells\":[5,4,3]", "\"cells\":[4000000000,4000000000,3]"),
        ("\"cells\":[5,4,3]", "\"cells\":[-1,4,3]"),
        ("\"spacing_mm\":[0.1", "\"spacing_mm\":[-0.1"),
        ("\"offset\":0", "\"offset\":18446744073709551615"),
        ("\"length\":60", "\"length\":18446744073709551615"),
        ("\"length\":60", "\"length\":6000000000"),
        ("\"eta\":1.4", "\"eta\":0.4"),
        ("\"lit_face\":\"back\"", "\"lit_face\":\"side\""),
        ("\"coefficient\":\"mu\"", "\"coefficient\":\"kappa\""),
        ("\"name\":\"G\"", "\"name\":\"R\""),
        ("\"gain\":1.0", "\"gain\":null"),
    ];
    for (from, to) in cases {
        let error = load(&path, &lie(from, to)).expect_err(to);
        assert!(error.to_string().contains("slab.diaphane"), "{error}");
    }
    // The same without a lie: it is the lie that is refused.
    assert!(load(&path, &lie("diaphane", "Diaphane")).is_ok());
    let mut header_length = bytes.clone();
    header_length[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(load(&path, &sealed(header_length)).is_err());
}

#[test]
fn a_sealed_bad_value_is_named() {
    let (_folder, path, bytes) = written();
    // The last value before the hash: μ of B in the last voxel.
    let mut bad = bytes.clone();
    let at = bytes.len() - 36;
    bad[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let message = load(&path, &sealed(bad)).unwrap_err().to_string();
    for part in ["slab.diaphane", "channel B", "mu", "NaN", "(4, 3, 2)"] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn random_bytes_are_never_a_material() {
    let (_folder, path, bytes) = written();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    for round in 0..500 {
        let mut noise = vec![0; random.random_range(0..400)];
        random.fill(&mut noise[..]);
        // Half of them begin as ours do, so that they get past the door.
        if round % 2 == 0 {
            let keep = noise.len().min(random.random_range(8..60));
            noise[..keep].copy_from_slice(&bytes[..keep]);
            if noise.len() >= 48 {
                noise = sealed(noise);
            }
        }
        assert!(load(&path, &noise).is_err());
    }
}
