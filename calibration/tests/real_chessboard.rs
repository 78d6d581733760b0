//! Real boards: thirteen views of a 9x6 board of 25 mm squares (Debian's opencv-doc), and Zhang's
//! own five views with the numbers that he published.

mod common;

use calibration::{
    Board, CalibrationError, Choice, Distortion, Geometry, NoBoard, Photo, RigView, View,
    calibrate_geometry, detect_board, find_views, list_pictures,
};

fn camera_of(views: Vec<View>, size: [usize; 2], choice: Choice) -> Geometry {
    let views: Vec<RigView> = views.into_iter().map(RigView::camera_only).collect();
    calibrate_geometry(&views, size, None, choice).unwrap()
}

#[test]
fn thirteen_real_views_calibrate_better_than_the_best_peer() {
    let Some(dir) = common::data("chessboard/opencv_stereo") else { return };
    let board = Board::parse("9x6", 25.0).unwrap();
    let found = find_views(&list_pictures(dir).unwrap(), &board).unwrap();
    assert_eq!((found.views.len(), found.missed.len(), found.size), (13, 0, [640, 480]));
    let result = camera_of(found.views, found.size, Choice::default());
    eprintln!("{:?}", result.camera);
    for view in &result.views {
        eprintln!("  {} {:.3}", view.name, view.camera_rms_px);
    }
    for outlier in &result.outliers {
        eprintln!("  {outlier:?}");
    }
    // mrcal with a warped board reaches 0.1875 px on these pictures, the largest view 0.26.
    let worst = result.views.iter().map(|v| v.camera_rms_px).fold(0.0, f64::max);
    assert!(result.rms_px <= 0.1875, "rms {:.4} px", result.rms_px);
    assert!(worst <= 0.26, "worst view {worst:.4} px");
    assert!(result.outliers.len() <= 7, "one in a hundred at most: {:?}", result.outliers);
}

fn numbers(path: &std::path::Path) -> Vec<[f64; 2]> {
    let text = std::fs::read_to_string(path).unwrap();
    let all: Vec<f64> = text.split_whitespace().map(|v| v.parse().unwrap()).collect();
    all.chunks_exact(2).map(|p| [p[0], p[1]]).collect()
}

/// Zhang's 1998 web page and imagingbook-calibrate: full least squares with skew, k1 and k2.
#[test]
fn zhangs_own_views_give_his_digits() {
    let Some(dir) = common::data("chessboard/zhang1998") else { return };
    let inch = 25.4;
    let object_points: Vec<[f64; 3]> =
        numbers(&dir.join("Model.txt")).iter().map(|p| [p[0] * inch, p[1] * inch, 0.0]).collect();
    let views = (1..=5).map(|i| View {
        name: format!("data{i}.txt"),
        image_points: numbers(&dir.join(format!("data{i}.txt"))),
        object_points: object_points.clone(),
    });
    let choice = Choice { camera: Some(Distortion::K1K2), skew: true, ..Choice::default() };
    let result = camera_of(views.collect(), [640, 480], choice);
    let [fx, fy, cx, cy, skew, k1, k2, ..] = result.camera.model.parameters();
    let found = [fx, skew, fy, cx, cy, k1, k2];
    let spread = result.camera.standard_deviations;
    eprintln!(
        "{found:?} rms {:.6} {spread:?} {:?} {}",
        result.rms_px, result.outliers, result.camera.noise_px
    );
    // His values to the digits that do not depend on where a solver stops: his k2 of .190353 and
    // skew of .204494 are a few 1e-5 sigmas from the minimum.
    let published = [
        (832.5, 5e-3),
        (0.2045, 5e-5),
        (832.53, 5e-3),
        (303.96, 5e-3),
        (206.585, 5e-4),
        (-0.228601, 5e-7),
        (0.19035, 5e-6),
    ];
    for (value, (known, half)) in found.iter().zip(published) {
        assert!((value - known).abs() <= 1.01 * half, "{value} for {known}");
    }
    assert!((result.rms_px - 0.336434).abs() < 5e-6, "{}", result.rms_px);
    let sigmas =
        [(0, 1.407), (4, 0.0783), (1, 1.386), (2, 0.712), (3, 0.659), (5, 0.00414), (6, 0.0249)];
    for (at, known) in sigmas {
        // Given to three or four digits, computed with another count of the redundancy.
        assert!((spread[at] / known - 1.0).abs() < 0.01, "{at}: {} for {known}", spread[at]);
    }
}

#[test]
fn pictures_of_mixed_sizes_and_without_boards_are_told_apart() {
    let dir = tempfile::tempdir().unwrap();
    let board = Board::parse("9x6", 25.0).unwrap();
    for (name, width) in [("a.png", 160), ("b.png", 160), ("c.png", 200)] {
        image::GrayImage::from_pixel(width, 120, image::Luma([128]))
            .save(dir.path().join(name))
            .unwrap();
    }
    let pictures = list_pictures(dir.path()).unwrap();
    let mixed = find_views(&pictures, &board);
    let message = mixed.unwrap_err().to_string();
    assert!(message.contains("c.png") && message.contains("160x120"), "{message}");
    let empty = find_views(&pictures[..2], &board).unwrap();
    assert_eq!((empty.views.len(), empty.missed.len()), (0, 2));
    let few = calibrate_geometry(&[], empty.size, None, Choice::default());
    assert!(matches!(few, Err(CalibrationError::TooFewViews { found: 0, .. })), "{few:?}");
}

/// A copy of a picture with other grey levels or another size.
fn changed(picture: &image::GrayImage, name: &str) -> Photo {
    Photo {
        width: picture.width() as usize,
        height: picture.height() as usize,
        channels: 1,
        data: picture.iter().map(|&v| u16::from(v)).collect(),
        max_value: 255,
        name: name.into(),
    }
}

fn reason(photo: &Photo, board: &str) -> NoBoard {
    match detect_board(photo, &Board::parse(board, 25.0).unwrap()) {
        Err(CalibrationError::BoardNotFound { reason, picture, .. }) => {
            assert_eq!(picture, photo.name);
            eprintln!("{picture}: {reason}");
            reason
        }
        other => panic!("{}: {:?}", photo.name, other.map(|b| b.quality)),
    }
}

#[test]
fn what_is_wrong_with_a_spoiled_picture_is_told() {
    let Some(dir) = common::data("chessboard/opencv_stereo") else { return };
    for name in ["left01.jpg", "left09.jpg"] {
        let real = image::open(dir.join(name)).unwrap().to_luma8();
        let (width, height) = real.dimensions();
        let gain = |factor: f32| {
            let code = |x, y| (f32::from(real.get_pixel(x, y)[0]) * factor).round() as u8;
            image::GrayImage::from_fn(width, height, |x, y| image::Luma([code(x, y)]))
        };
        // A fiftieth of the light leaves five codes.
        let dark = reason(&changed(&gain(0.02), "dark"), "9x6");
        assert!(matches!(dark, NoBoard::TooDark { .. } | NoBoard::TooFaint { .. }), "{dark:?}");
        // Sixteen times the light lifts the dark squares to full scale as well.
        let clipped = reason(&changed(&gain(16.0), "clipped"), "9x6");
        assert!(matches!(clipped, NoBoard::Clipped { .. }), "{clipped:?}");
        // Squares of 22 to 40 pixels under blurs of 20 to 77 px from 10 to 90 %.
        for sigma in [8.0, 20.0, 30.0] {
            let soft = image::imageops::blur(&real, sigma);
            let blurred = reason(&changed(&soft, &format!("blurred by {sigma}")), "9x6");
            assert!(matches!(blurred, NoBoard::Blurred { .. }), "{blurred:?}");
        }
        // Squares of 3 to 6 pixels.
        for factor in [6, 8] {
            let filter = image::imageops::FilterType::Triangle;
            let little = image::imageops::resize(&real, width / factor, height / factor, filter);
            let small = reason(&changed(&little, &format!("1/{factor}")), "9x6");
            assert!(matches!(small, NoBoard::TooSmall { .. }), "{small:?}");
        }
    }
    // The right columns out of the frame.
    let real = image::open(dir.join("left01.jpg")).unwrap().to_luma8();
    let part = image::imageops::crop_imm(&real, 0, 0, 448, 480).to_image();
    let cut = reason(&changed(&part, "cut"), "9x6");
    assert!(matches!(cut, NoBoard::PartlyOutside { .. }), "{cut:?}");
}

#[test]
fn a_board_of_another_size_is_told_by_its_own() {
    let Some(dir) = common::data("chessboard/opencv_stereo") else { return };
    for name in ["left05.jpg", "left11.jpg"] {
        let photo = Photo::load(dir.join(name)).unwrap();
        // Larger, smaller (of which many are to be seen in it), and in between.
        for board in ["9x7", "6x4", "8x5"] {
            let other = reason(&photo, board);
            assert!(
                matches!(other, NoBoard::OtherBoard { seen: Some([9, 6]), .. }),
                "{name} as {board}: {other:?}"
            );
        }
        // Rows and columns may change names.
        assert!(detect_board(&photo, &Board::parse("6x9", 25.0).unwrap()).is_ok());
    }
}

#[test]
fn real_boards_of_a_projector_rig_are_found() {
    let Some(dir) = common::data("procam/kamino410") else { return };
    let board = Board::parse("9x7", 75.0).unwrap();
    for pose in 0..5 {
        let photo = Photo::load(dir.join(format!("capture_{pose}/graycode_40.png"))).unwrap();
        let found = detect_board(&photo, &board).unwrap();
        assert_eq!((found.corners.len(), found.dropped.len()), (63, 0), "pose {pose}");
    }
}
