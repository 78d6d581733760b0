//! Bytes and files give the same mosaic; what is no raw file is refused by the name it was given.
#![cfg(feature = "decoders")]

#[path = "common/dng.rs"]
mod dng;

use dng::Dng;
use raw::{Bayer, RawError, RawMosaic, decode, exposure_s, is_raw, read};

fn sensor() -> Dng {
    Dng {
        width: 12,
        height: 10,
        codes: (0..120).map(|i| 600 + 131 * i).collect(),
        filter: (2, vec![0, 1, 1, 2]),
        black: [510, 512, 513, 517],
        white: 16_383,
        active: [1, 3, 9, 11],
        exposure: (1, 30),
    }
}

#[test]
fn bytes_without_a_file_are_the_mosaic_of_their_file() {
    let dng = sensor();
    let rows = dng.codes.chunks(12).skip(1).take(8);
    let expected = RawMosaic {
        width: 8,
        height: 8,
        codes: rows.flat_map(|row| &row[3..11]).copied().collect(),
        bayer: Bayer::Rggb,
        black_levels: [510.0, 512.0, 513.0, 517.0],
        white_level: 16_383,
        exposure_s: Some(1.0 / 30.0),
    };
    // Named as a camera may name it, whatever it holds.
    for name in ["nowhere/DSC_1.DNG", "capt0000.nef", "no name"] {
        assert_eq!(decode(name, dng.bytes()).unwrap(), expected, "{name}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dng");
    std::fs::write(&path, dng.bytes()).unwrap();
    assert!(is_raw(&path) && !is_raw("a.jpg") && !is_raw("dng"));
    assert_eq!(read(&path).unwrap(), expected);
    assert_eq!(exposure_s(&path).unwrap(), Some(1.0 / 30.0));
}

#[test]
fn a_time_of_nought_is_none() {
    let dng = Dng { exposure: (0, 1), ..sensor() };
    assert_eq!(decode("a.dng", dng.bytes()).unwrap().exposure_s, None);
}

#[test]
fn what_is_no_whole_raw_file_is_refused_by_name() {
    let whole = sensor().bytes();
    for length in [0, 6, 100, whole.len() - 30] {
        let error = decode("DSC_7.NEF", whole[..length].to_vec()).unwrap_err();
        assert!(matches!(error, RawError::BadFile { .. }), "{error}");
        assert!(error.to_string().starts_with("DSC_7.NEF: expected"), "{error}");
    }
    let missing = read("no/such.dng").unwrap_err();
    assert!(matches!(missing, RawError::Io { .. }), "{missing}");
}

#[test]
fn patterns_are_read_in_any_case_and_no_others() {
    assert_eq!(Bayer::parse("GbRg").unwrap(), Bayer::Gbrg);
    assert!(matches!(Bayer::parse("rgb"), Err(RawError::BadPattern { found }) if found == "rgb"));
}
