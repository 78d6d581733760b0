//! Files that are whole, and files that are not.

use std::io::Write;

use calibration::{
    CalibrationError, ExposureTable, HdrImage, Photo, exif_exposure_s, list_pictures,
    parse_seconds, read_exr, write_exr,
};
use image::{ImageBuffer, Luma, Rgb};
use material::Overwrite;

fn image(channels: usize) -> HdrImage {
    let samples = 7 * 5 * channels;
    let mut variance: Vec<f32> = (0..samples).map(|i| 1e-3 * (i + 1) as f32).collect();
    variance[3] = f32::INFINITY;
    HdrImage {
        width: 7,
        height: 5,
        channels,
        radiance: (0..samples).map(|i| (i as f32 * 0.37).exp() * 1e-4).collect(),
        variance,
        variance_known: true,
        clipped_shortest: 3,
        lost_longest: 2,
    }
}

#[test]
fn exr_keeps_every_bit() {
    let dir = tempfile::tempdir().unwrap();
    for channels in [1, 3] {
        let path = dir.path().join(format!("{channels}.exr"));
        write_exr(&path, &image(channels), Overwrite::Refuse).unwrap();
        assert_eq!(read_exr(&path).unwrap(), image(channels));
        let again = write_exr(&path, &image(channels), Overwrite::Refuse);
        assert!(matches!(again, Err(CalibrationError::File(_))), "{again:?}");
    }
}

/// Blocks are compressed on all processors, and the crate keeps attributes of the header in no order.
#[test]
fn exr_of_the_same_picture_is_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let samples = 40 * 300 * 3;
    let image = HdrImage {
        width: 40,
        height: 300,
        radiance: (0..samples).map(|i| (i as f32 * 0.37).sin().abs()).collect(),
        variance: (0..samples).map(|i| 1e-6 * (i + 1) as f32).collect(),
        ..image(3)
    };
    let written = |i: usize| {
        let path = dir.path().join(format!("{i}.exr"));
        write_exr(&path, &image, Overwrite::Refuse).unwrap();
        std::fs::read(path).unwrap()
    };
    let first = written(0);
    // Two attributes in either order: 19 times the same by chance once in half a million.
    for i in 1..20 {
        assert!(written(i) == first, "writing it for the {}th time", i + 1);
    }
}

/// Both counts were attributes of the layer once; the file does not tell, and any order will do.
#[test]
fn exr_counts_are_found_wherever_they_were_put() {
    use exr::prelude::*;
    let dir = tempfile::tempdir().unwrap();
    for in_layer in [["clippedShortest", "lostLongest"].as_slice(), &["lostLongest"], &[]] {
        let path = dir.path().join(format!("{}.exr", in_layer.len()));
        let plane = AnyChannel::new("Y", FlatSamples::F32(vec![0.5; 6]));
        let channels = AnyChannels::sort(std::iter::once(plane).collect());
        let mut file = Image::from_encoded_channels((3, 2), Encoding::SMALL_LOSSLESS, channels);
        for (name, count) in [("clippedShortest", 7), ("lostLongest", 5)] {
            let attributes = match in_layer.contains(&name) {
                true => &mut file.layer_data.attributes.other,
                false => &mut file.attributes.other,
            };
            attributes.insert(Text::from(name), AttributeValue::I32(count));
        }
        file.write().to_file(&path).unwrap();
        let read = read_exr(&path).unwrap();
        assert_eq!((read.clipped_shortest, read.lost_longest), (7, 5), "{in_layer:?}");
    }
}

#[test]
fn exr_of_other_software_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rgb.exr");
    exr::prelude::write_rgb_file(&path, 4, 3, |x, y| {
        (x as f32, y as f32, if x == 2 { f32::NAN } else { 0.5 })
    })
    .unwrap();
    let read = read_exr(&path).unwrap();
    assert_eq!((read.width, read.height, read.channels), (4, 3, 3));
    assert!(!read.variance_known);
    assert_eq!(read.radiance[3 * 5..3 * 6], [1.0, 1.0, 0.5]);
    // A NaN is masked, not passed on.
    assert_eq!((read.radiance[3 * 2 + 2], read.variance[3 * 2 + 2]), (0.0, f32::INFINITY));
    assert_eq!(read.finite_share(), 1.0);
}

#[test]
fn broken_exr_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("cut.exr");
    write_exr(&path, &image(3), Overwrite::Refuse).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    for length in [0, 10, bytes.len() / 2, bytes.len() - 3] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        let error = read_exr(&path).unwrap_err().to_string();
        assert!(error.contains("cut.exr"), "{error}");
    }
    assert!(matches!(read_exr(dir.path().join("no.exr")), Err(CalibrationError::Io { .. })));
}

#[test]
fn photographs_of_8_and_16_bits_are_read_as_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let deep = dir.path().join("deep.png");
    let codes = ImageBuffer::from_fn(6, 4, |x, y| Rgb([x as u16 * 9000, y as u16 * 777, 65535]));
    codes.save(&deep).unwrap();
    let photo = Photo::load(&deep).unwrap();
    assert_eq!((photo.width, photo.height, photo.channels), (6, 4, 3));
    assert_eq!((photo.max_value, photo.name.as_str()), (65535, "deep.png"));
    assert_eq!(photo.data, codes.into_raw());
    let shallow = dir.path().join("shallow.png");
    ImageBuffer::from_fn(6, 4, |x, _| Luma([x as u8 * 40])).save(&shallow).unwrap();
    let photo = Photo::load(&shallow).unwrap();
    assert_eq!((photo.channels, photo.max_value), (1, 255));
    assert_eq!(photo.grey_u8()[..6], [0, 40, 80, 120, 160, 200]);
    std::fs::write(dir.path().join("notes.txt"), "not a picture").unwrap();
    assert_eq!(list_pictures(dir.path()).unwrap(), [deep, shallow]);
}

#[test]
fn truncated_pictures_and_empty_folders_are_errors_that_name_them() {
    let dir = tempfile::tempdir().unwrap();
    assert!(matches!(list_pictures(dir.path()), Err(CalibrationError::NoPictures { .. })));
    assert!(matches!(list_pictures(dir.path().join("no")), Err(CalibrationError::Io { .. })));
    let grain = |x: u32, y: u32| Luma([(x * 37 + y * 91) as u8]);
    for name in ["cut.png", "cut.jpg", "cut.tif"] {
        let path = dir.path().join(name);
        ImageBuffer::from_fn(64, 64, grain).save(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(Photo::load(&path).is_ok(), "{name} is whole");
        std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
        let error = Photo::load(&path).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
        assert!(exif_exposure_s(&path).unwrap_err().to_string().contains(name));
    }
}

#[test]
fn exposure_tables_take_fractions_and_name_bad_lines() {
    assert_eq!(parse_seconds("1/8"), Some(0.125));
    assert_eq!(parse_seconds("2.5 s"), Some(2.5));
    for bad in ["0", "-1", "1/0", "fast", "", "nan"] {
        assert_eq!(parse_seconds(bad), None, "{bad}");
    }
    let mut file = tempfile::NamedTempFile::new().unwrap();
    writeln!(file, "# bracket\na.png 1/30\nmy scene.png\t0.5 # half\n").unwrap();
    let table = ExposureTable::load(file.path()).unwrap();
    assert_eq!(table.get("a.png"), Some(1.0 / 30.0));
    assert_eq!(table.get("my scene.png"), Some(0.5));
    assert_eq!(table.get("b.png"), None);
    writeln!(file, "c.png soon").unwrap();
    let error = ExposureTable::load(file.path()).unwrap_err().to_string();
    assert!(error.contains("line 5"), "{error}");
}
