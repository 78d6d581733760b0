//! Boards in rendered pictures whose truth is known: ChArUco boards, hidden corners, quality.

use calibration::{
    Board, CalibrationError, CameraModel, FacePlane, NoBoard, Photo, Pose, detect_board, find_board,
};
use opencv::aruco;
use opencv::core::{Mat, Size};
use opencv::prelude::*;

fn camera() -> CameraModel {
    CameraModel {
        width: 800,
        height: 600,
        fx: 900.0,
        fy: 905.0,
        cx: 392.0,
        cy: 306.0,
        skew: 0.0,
        distortion: [-0.12, 0.05, 0.0008, -0.0005, 0.0, 0.0, 0.0, 0.0],
    }
}

fn render(pose: Pose, light: impl Fn(f64, f64) -> f64) -> Photo {
    let plane = FacePlane { device: camera(), pose, z_mm: 0.0 };
    // Edges are averaged over 4 x 4 rays a pixel.
    let offset = |i: usize| (i as f64 + 0.5) / 4.0 - 0.5;
    let pixel = |i: usize| {
        let (u, v) = ((i % 800) as f64, (i / 800) as f64);
        let rays = (0..16).map(|ray| {
            let place = plane.pixel_to_face([u + offset(ray % 4), v + offset(ray / 4)]);
            place.map_or(0.0, |[x, y]| light(x, y))
        });
        (15.0 + 200.0 * rays.sum::<f64>() / 16.0).round() as u16
    };
    let data = (0..800 * 600).map(pixel).collect();
    let name = "board.png".into();
    Photo { width: 800, height: 600, channels: 1, data, max_value: 255, name }
}

const CHARUCO: &str = "charuco:9x7:4x4_50:18";
const SQUARE_MM: f64 = 25.0;

/// OpenCV's own drawing of a board, 10 pixels a millimetre, laid down with corner 0 at the origin.
struct Drawn(Mat);

impl Drawn {
    fn new(across: i32, down: i32) -> Self {
        let set = aruco::get_predefined_dictionary_i32(0).unwrap();
        let mut board =
            aruco::CharucoBoard::create(across, down, SQUARE_MM as f32, 18.0, &set).unwrap();
        let mut picture = Mat::default();
        board.draw(Size::new(across * 250, down * 250), &mut picture, 0, 1).unwrap();
        Self(picture)
    }

    fn light(&self, x: f64, y: f64) -> f64 {
        let [u, v] = [x, y].map(|mm| (10.0 * (mm + SQUARE_MM)).floor() as i32);
        let inside = u >= 0 && v >= 0 && u < self.0.cols() && v < self.0.rows();
        if inside { f64::from(*self.0.at_2d::<u8>(v, u).unwrap()) / 255.0 } else { 1.0 }
    }
}

fn near(seen: [f64; 2], truth: [f64; 2]) -> f64 {
    (seen[0] - truth[0]).hypot(seen[1] - truth[1])
}

#[test]
fn a_charuco_board_is_found_whole_and_in_part() {
    let board = Board::parse(CHARUCO, SQUARE_MM).unwrap();
    let drawn = Drawn::new(9, 7);
    // Whole; half outside; turned by 2 rad, so that nothing but the markers says where up is.
    let whole = Pose::from_rotation_vector([0.2, 0.3, 0.05], [-85.0, -60.0, 480.0]);
    let part = Pose::from_rotation_vector([-0.2, 0.3, 0.1], [60.0, -100.0, 430.0]);
    let turned = Pose::from_rotation_vector([0.1, -0.1, 2.0], [100.0, -60.0, 480.0]);
    for (pose, least, most) in [(whole, 48, 48), (part, 15, 40), (turned, 48, 48)] {
        let photo = render(pose, |x, y| drawn.light(x, y));
        let found = detect_board(&photo, &board).unwrap();
        let plane = FacePlane { device: camera(), pose, z_mm: 0.0 };
        let (mut squares, mut worst) = (0.0, 0.0_f64);
        for corner in &found.corners {
            let [x, y, _] = board.object_point(corner.index);
            let miss = near(corner.pixel, plane.face_to_pixel([x, y]).unwrap());
            squares += miss * miss;
            worst = worst.max(miss);
        }
        let rms = (squares / found.corners.len() as f64).sqrt();
        eprintln!("{} corners, rms {rms:.3} px, worst {worst:.3} px", found.corners.len());
        assert!((least..=most).contains(&found.corners.len()), "{}", found.corners.len());
        assert!(found.dropped.is_empty(), "{:?}", found.dropped);
        // Windows end before the markers, 5 px from the corner: few pixels, hence the noise of
        // rendering without a lens' blur (a plain board of this size: 0.07 px).
        assert!(rms < 0.12 && worst < 0.5, "rms {rms}, worst {worst}");
        let view = found.view(&board);
        assert_eq!(view.object_points.len(), view.image_points.len());
        // All corners or none: what a caller that needs the whole board gets.
        assert_eq!(find_board(&photo, &board).is_ok(), found.corners.len() == 48);
    }
}

#[test]
fn both_layouts_of_even_charuco_boards_are_read() {
    // With an even number of rows of squares programs disagree on the first square's colour; the
    // installed OpenCV draws one of the two, its mirror image in the rows has the other.
    let board = Board::parse("charuco:9x6:4x4_50:18", SQUARE_MM).unwrap();
    let set = aruco::get_predefined_dictionary_i32(0).unwrap();
    let marker: Vec<Mat> = (0..27)
        .map(|id| {
            let mut picture = Mat::default();
            aruco::draw_marker(&set, id, 180, &mut picture, 1).unwrap();
            picture
        })
        .collect();
    let pose = Pose::from_rotation_vector([0.2, 0.3, 0.05], [-85.0, -50.0, 480.0]);
    for parity in [0, 1] {
        let light = |x: f64, y: f64| {
            let [c, r] = [x, y].map(|v| (v / SQUARE_MM).floor() as i32 + 1);
            if !((0..9).contains(&c) && (0..6).contains(&r)) {
                return 1.0;
            }
            if (c + r) % 2 != parity {
                return 0.0;
            }
            let number = (0..r * 9 + c).filter(|i| (i % 9 + i / 9) % 2 == parity).count();
            // The marker has 3.5 mm of white around it.
            let place = [(x, c), (y, r)]
                .map(|(v, i)| ((v - f64::from(i - 1) * SQUARE_MM - 3.5) * 10.0).floor() as i32);
            if place.iter().all(|v| (0..180).contains(v)) {
                f64::from(*marker[number].at_2d::<u8>(place[1], place[0]).unwrap()) / 255.0
            } else {
                1.0
            }
        };
        let found = detect_board(&render(pose, light), &board).unwrap();
        assert_eq!(found.corners.len(), 40);
        let plane = FacePlane { device: camera(), pose, z_mm: 0.0 };
        for corner in &found.corners {
            let [x, y, _] = board.object_point(corner.index);
            let miss = near(corner.pixel, plane.face_to_pixel([x, y]).unwrap());
            // A wrong layout would be a square, 45 px, off.
            assert!(miss < 0.5, "corner {}: {miss}", corner.index);
        }
    }
}

#[test]
fn another_charuco_board_is_told() {
    let drawn = Drawn::new(9, 7);
    let pose = Pose::from_rotation_vector([0.2, 0.3, 0.05], [-85.0, -60.0, 480.0]);
    let photo = render(pose, |x, y| drawn.light(x, y));
    let other = Board::parse("charuco:11x8:4x4_50:18", SQUARE_MM).unwrap();
    let error = detect_board(&photo, &other).unwrap_err();
    assert!(
        matches!(
            &error,
            CalibrationError::BoardNotFound { reason: NoBoard::OtherMarkers { .. }, .. }
        ),
        "{error}"
    );
    let nothing = Board::parse("charuco:9x7:7x7_50:18", SQUARE_MM).unwrap();
    assert!(detect_board(&photo, &nothing).is_err());
}

/// A plain board of dark and light squares with a margin, corner 0 at the origin.
fn print(board: &Board, x: f64, y: f64) -> f64 {
    let (c, r) = ((x / board.square_mm).floor() + 1.0, (y / board.square_mm).floor() + 1.0);
    let on = (0.0..=board.columns as f64).contains(&c) && (0.0..=board.rows as f64).contains(&r);
    if on && (c + r) % 2.0 == 0.0 { 0.05 } else { 0.9 }
}

#[test]
fn a_corner_under_a_sticker_is_left_out_and_named() {
    let board = Board::parse("9x6", 20.0).unwrap();
    let pose = Pose::from_rotation_vector([0.1, 0.2, 0.03], [-80.0, -50.0, 420.0]);
    // A sticker over corner 21, (column 3, row 2): its own corner is 3 mm beside the board's.
    let light = |x: f64, y: f64| {
        let (dx, dy) = (x - 60.0, y - 40.0);
        if dx.abs() < 9.0 && dy.abs() < 9.0 {
            return print(&board, x - 3.0, y + 3.0);
        }
        print(&board, x, y)
    };
    let clean = detect_board(&render(pose, |x, y| print(&board, x, y)), &board).unwrap();
    assert_eq!((clean.corners.len(), clean.dropped.len()), (54, 0));
    let found = detect_board(&render(pose, light), &board).unwrap();
    assert_eq!(found.dropped.len(), 1, "{:?}", found.dropped);
    let dropped = found.dropped[0];
    assert_eq!(dropped.index, 21);
    // 3 mm each way are 9 px.
    assert!((5.0..15.0).contains(&dropped.residual_px), "{dropped:?}");
    assert!(found.corners.iter().all(|c| c.index != 21) && found.corners.len() == 53);
}

#[test]
fn quality_says_how_sharp_how_tilted_and_where() {
    let board = Board::parse("9x6", 20.0).unwrap();
    // Tilted by 0.5 rad about x, its middle on the optical axis.
    let angle = 0.5_f64;
    let middle = [80.0, 50.0 * angle.cos(), 50.0 * angle.sin()];
    let pose =
        Pose::from_rotation_vector([angle, 0.0, 0.0], [-middle[0], -middle[1], 600.0 - middle[2]]);
    let sharp = render(pose, |x, y| print(&board, x, y));
    let quality = detect_board(&sharp, &board).unwrap().quality;
    eprintln!("{quality:?}");
    // The plane map's linear part over a board 0.27 of its distance wide is a little steeper.
    assert!((quality.tilt_rad - angle).abs() < 0.03, "{}", quality.tilt_rad);
    // An averaged pixel's edge is 0.8 px wide; reading between pixels adds some.
    assert!((0.7..1.8).contains(&quality.edge_width_px), "{}", quality.edge_width_px);
    // Reflectances .05 and .9 of 200 codes.
    assert!((quality.contrast - 0.85 * 200.0 / 255.0).abs() < 0.01, "{}", quality.contrast);
    assert_eq!(quality.clipped_share, 0.0);
    // 160 mm at 600 mm under 900 px are 240 px.
    let [left, _, right, _] = quality.bounds_px;
    assert!((right - left - 240.0).abs() < 12.0, "{:?}", quality.bounds_px);
    // A Gaussian blur of 3 px makes edges 2.56 · 3 px wide.
    let picture =
        image::GrayImage::from_raw(800, 600, sharp.data.iter().map(|&v| v as u8).collect());
    let soft = image::imageops::blur(&picture.unwrap(), 3.0);
    let blurred = Photo { data: soft.iter().map(|&v| u16::from(v)).collect(), ..sharp.clone() };
    let width = detect_board(&blurred, &board).unwrap().quality.edge_width_px;
    assert!((width / (2.56 * 3.0) - 1.0).abs() < 0.1, "{width}");
    let bright =
        Photo { data: sharp.data.iter().map(|&v| (v * 3 / 2).min(255)).collect(), ..sharp };
    let quality = detect_board(&bright, &board).unwrap().quality;
    assert!(quality.clipped_share > 0.95, "{}", quality.clipped_share);
}

#[test]
fn boards_are_described_in_words() {
    let board = Board::parse("charuco:11x8:DICT_5X5_100:11", 15.0).unwrap();
    assert_eq!((board.columns, board.rows, board.square_mm), (10, 7, 15.0));
    let text = serde_json::to_string(&board).unwrap();
    assert!(text.contains("\"5x5_100\""), "{text}");
    assert_eq!(serde_json::from_str::<Board>(&text).unwrap(), board);
    // Descriptions from before boards had markers.
    let old = r#"{"columns": 9, "rows": 6, "square_mm": 25.0}"#;
    assert_eq!(serde_json::from_str::<Board>(old).unwrap(), Board::chessboard(9, 6, 25.0));
    for (text, square, word) in [
        ("charuco:11x8:4x4_50", 15.0, "SQUARESxSQUARES"),
        ("charuco:11x8:4x5_50:11", 15.0, "BITSxBITS"),
        ("charuco:11x8:4x4_51:11", 15.0, "BITSxBITS"),
        ("charuco:11x8:4x4_50:15", 15.0, "less than the square"),
        ("charuco:11x8:4x4_50:nan", 15.0, "more than 0"),
        ("charuco:20x20:4x4_50:11", 15.0, "200 markers"),
        ("charuco:2x8:4x4_50:11", 15.0, "SQUARESxSQUARES"),
        ("9x6", f64::NAN, "millimetres"),
        ("9x2", 15.0, "9x6"),
    ] {
        let message = Board::parse(text, square).unwrap_err().to_string();
        assert!(message.contains(word), "{text}: {message}");
    }
}
