//! Camera raw files: DNGs made up here, so that every code, level and time is known.
#![cfg(feature = "raw")]

#[path = "../../raw/tests/common/dng.rs"]
mod dng;

use calibration::{
    Bayer, CalibrationError, Photo, exif_exposure_s, is_raw, list_pictures, merge_mosaic, read_raw,
};
use dng::Dng;
use std::path::{Path, PathBuf};
use tempfile::{TempDir, tempdir};

/// 12 × 10 pixels of which all see light, each with a code of its own.
fn whole() -> Dng {
    Dng {
        width: 12,
        height: 10,
        codes: (0..120).map(|i| 600 + 131 * i).collect(),
        filter: (2, vec![0, 1, 1, 2]),
        black: [512; 4],
        white: 16_383,
        active: [0, 0, 10, 12],
        exposure: (1, 30),
    }
}

fn written(bytes: &[u8], name: &str) -> (TempDir, PathBuf) {
    let folder = tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn refused(bytes: &[u8]) -> String {
    let (_folder, path) = written(bytes, "bad.dng");
    let error = read_raw(&path).unwrap_err();
    assert!(matches!(error, CalibrationError::BadFile { .. }), "{error}");
    let error = error.to_string();
    assert!(error.contains("bad.dng"), "{error}");
    error
}

#[test]
fn a_dng_gives_its_codes_levels_pattern_and_time() {
    for (colours, bayer) in [
        ([0, 1, 1, 2], Bayer::Rggb),
        ([2, 1, 1, 0], Bayer::Bggr),
        ([1, 0, 2, 1], Bayer::Grbg),
        ([1, 2, 0, 1], Bayer::Gbrg),
    ] {
        let dng = Dng { filter: (2, colours.to_vec()), ..whole() };
        let (_folder, path) = written(&dng.bytes(), "all.DNG");
        assert!(is_raw(&path));
        let raw = read_raw(&path).unwrap();
        assert_eq!((raw.photo.width, raw.photo.height, raw.photo.channels), (12, 10, 1));
        assert_eq!(raw.photo.data, dng.codes);
        assert_eq!(raw.photo.name, "all.DNG");
        assert_eq!(raw.bayer, bayer);
        assert_eq!(raw.black_levels, [512.0; 4]);
        assert_eq!(raw.white_level, 16_383);
        assert_eq!(raw.exposure_s, Some(1.0 / 30.0));
        assert_eq!(exif_exposure_s(&path).unwrap(), 1.0 / 30.0);
        assert_eq!(Photo::load_codes(&path).unwrap(), raw.photo);
        assert!(Photo::load(&path).unwrap_err().to_string().contains("raw file"));
    }
}

/// The sensor's rim is cut away; pattern and black levels are counted from what is left, which
/// is how the format has them.
#[test]
fn the_dark_rim_is_cut_away_and_the_pattern_stays_right() {
    for [top, left] in [[1, 3], [2, 1], [3, 2], [4, 4]] {
        let black = [510, 512, 513, 517];
        let dng = Dng { active: [top, left, 9, 11], black, ..whole() };
        let (_folder, path) = written(&dng.bytes(), "rim.dng");
        let raw = read_raw(&path).unwrap();
        let (width, height) = (11 - left as usize, 9 - top as usize);
        assert_eq!((raw.photo.width, raw.photo.height), (width, height));
        for y in 0..height {
            for x in 0..width {
                let code = dng.codes[(y + top as usize) * 12 + x + left as usize];
                assert_eq!(raw.photo.data[y * width + x], code, "({x}, {y})");
            }
        }
        assert_eq!(raw.bayer, Bayer::Rggb, "from ({left}, {top})");
        assert_eq!(raw.black_levels, black.map(f64::from));
        // Black of 513, the mean, at every site: 3 more, 1 more, none, 4 less.
        assert_eq!(raw.black_level(), 513.0);
        let first = raw.photo.data[0];
        let below = raw.photo.data[width + 1];
        let level = raw.levelled(513.0);
        assert_eq!((level.data[0], level.data[width + 1]), (first + 3, below - 4));
    }
}

/// Sites of radiance 2, 5 and 9 of red, green and blue in parts of 16 383 codes a second.
#[test]
fn a_bracket_of_dngs_merges_to_the_radiance_of_each_colour() {
    let radiance = [2_000.0, 5_000.0, 9_000.0];
    let folder = tempdir().unwrap();
    for (name, exposure) in [("a", (1, 8)), ("b", (1, 2)), ("c", (2, 1))] {
        let seconds = f64::from(exposure.0) / f64::from(exposure.1);
        let site = |i: usize| [0, 1, 1, 2][i / 12 % 2 * 2 + i % 12 % 2];
        let code = |i: usize| (512.0 + radiance[site(i)] * seconds).round().min(16_383.0) as u16;
        let dng = Dng { codes: (0..120).map(code).collect(), exposure, ..whole() };
        std::fs::write(folder.path().join(format!("{name}.dng")), dng.bytes()).unwrap();
    }
    let pictures = list_pictures(folder.path()).unwrap();
    assert_eq!(pictures.len(), 3);
    let first = read_raw(&pictures[0]).unwrap();
    let (noise, bayer) = (first.noise(), first.bayer);
    let frames = pictures.iter().map(|path| {
        let raw = read_raw(path)?;
        let seconds = raw.exposure_s.unwrap();
        Ok::<_, CalibrationError>((raw.levelled(noise.black_level), seconds))
    });
    let (image, report) = merge_mosaic(frames, Vec::new(), &noise, bayer).unwrap();
    assert_eq!((image.width, image.height, image.channels), (6, 5, 3));
    assert_eq!(report.moved_samples, 0);
    for pixel in image.radiance.chunks_exact(3) {
        for (found, made) in pixel.iter().zip(radiance) {
            let found = f64::from(*found) * 65_535.0;
            // Codes are whole: half a code in the 250 that the shortest exposure has of red, the
            // least of all, is 0.2 %; blue clips in the longest.
            assert!((found / made - 1.0).abs() < 0.002, "{found} instead of {made}");
        }
    }
}

#[test]
fn what_is_no_whole_raw_file_is_refused_by_name() {
    let good = whole().bytes();
    // Cut in the pixels, in the EXIF directory, in the main one, in the header.
    for length in [100, 8 + 240 + 5, good.len() - 30, 6, 0] {
        refused(&good[..length]);
    }
    refused(b"These are my notes about the raw files.\n");
    // A strip that the file does not hold, though the directory (before it) is whole.
    let strip_bytes = 240_u32.to_le_bytes();
    let mut long = good.clone();
    let at = long.windows(4).rposition(|w| w == strip_bytes).unwrap();
    long[at..at + 4].copy_from_slice(&1_000_000_u32.to_le_bytes());
    refused(&long);
    // A filter of 6 × 6 sites (X-Trans), colours that no one knows, white below black.
    let trans = (0..36).map(|i| [1, 2, 1, 0][i % 4]).collect();
    let error = refused(&Dng { filter: (6, trans), ..whole() }.bytes());
    assert!(error.contains("6x6"), "{error}");
    refused(&Dng { filter: (2, vec![0, 1, 1, 9]), ..whole() }.bytes());
    refused(&Dng { filter: (2, vec![0, 1, 1, 4]), ..whole() }.bytes());
    refused(&Dng { white: 500, ..whole() }.bytes());
    refused(&Dng { active: [0, 0, 11, 12], ..whole() }.bytes());
}

/// No single damaged byte takes the program down.
#[test]
fn damage_never_ends_in_a_panic() {
    let good = whole().bytes();
    let (_folder, path) = written(&good, "damaged.dng");
    for at in (0..8).chain(8 + 240..good.len()) {
        for value in [0x00, 0xff] {
            let mut bytes = good.clone();
            bytes[at] = value;
            std::fs::write(&path, bytes).unwrap();
            // Either is fine: not every byte matters.
            let _ = read_raw(&path);
        }
    }
}

#[test]
fn raw_files_beside_their_developed_twins_are_refused() {
    let (folder, _) = written(&whole().bytes(), "a.dng");
    std::fs::write(folder.path().join("a.jpg"), b"").unwrap();
    let error = list_pictures(folder.path()).unwrap_err().to_string();
    assert!(error.contains("a.dng") && error.contains("a.jpg"), "{error}");
    let missing = read_raw(Path::new("no/such.dng"));
    assert!(matches!(missing, Err(CalibrationError::Io { .. })));
}

/// Writes the DNG that another reader is to look at where `DIAPHANE_DNG` says, of a size that
/// other readers take for a picture.
#[test]
fn a_witness_may_look() {
    let Some(path) = std::env::var_os("DIAPHANE_DNG") else { return };
    let codes = (0..64 * 48).map(|i| 600 + 5 * i).collect();
    let dng = Dng { width: 64, height: 48, codes, active: [2, 1, 46, 63], ..whole() };
    std::fs::write(path, dng.bytes()).unwrap();
}
