//! Cameras, projectors and faces whose truth is known, seen in rendered pictures.

use calibration::{
    Board, CalibrationError, CameraModel, FacePlane, HdrImage, Photo, Pose, ProjectedBoard, View,
    calibrate_camera, calibrate_projector, find_board, observe_projected_board, rectify,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn camera() -> CameraModel {
    CameraModel {
        width: 640,
        height: 480,
        fx: 800.0,
        fy: 805.0,
        cx: 312.0,
        cy: 246.0,
        distortion: [-0.12, 0.05, 0.0008, -0.0005, 0.0],
    }
}

fn projector() -> CameraModel {
    // Lens-shifted: the principal point lies below the picture.
    CameraModel {
        width: 400,
        height: 300,
        fx: 600.0,
        fy: 598.0,
        cx: 205.0,
        cy: 330.0,
        distortion: [0.01, 0.0, 0.0, 0.0, 0.0],
    }
}

/// Camera frame to projector frame: 150 mm to the right, turned inwards, tilted for the shift.
fn camera_to_projector() -> Pose {
    Pose::from_rotation_vector([0.22, 0.22, 0.01], [-150.0, 40.0, 20.0])
}

/// A picture of a plane whose light at (x, y) mm is `light`, with a little noise.
fn render(pose: &Pose, seed: u64, light: impl Fn(f64, f64) -> f64 + Sync) -> Photo {
    let device = camera();
    let plane = FacePlane { device, pose: *pose, z_mm: 0.0 };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let data = plane
        .paint(light)
        .into_iter()
        .map(|v| {
            let noise: f32 = (0..4).map(|_| rng.random::<f32>() - 0.5).sum();
            (20.0 + 200.0 * v + noise).clamp(0.0, 255.0) as u16
        })
        .collect();
    Photo {
        width: 640,
        height: 480,
        channels: 1,
        data,
        max_value: 255,
        name: format!("pose{seed}"),
    }
}

/// Light reflected by a printed board on white paper, first inner corner at the origin.
fn print(board: &Board, x: f64, y: f64) -> f64 {
    let (c, r) = ((x / board.square_mm).floor() + 1.0, (y / board.square_mm).floor() + 1.0);
    let on = (0.0..=board.columns as f64).contains(&c) && (0.0..=board.rows as f64).contains(&r);
    if on && (c + r) % 2.0 == 0.0 { 0.05 } else { 0.9 }
}

fn poses() -> Vec<Pose> {
    [
        ([0.0, 0.0, 0.0], [-165.0, -60.0, 620.0]),
        ([0.35, 0.1, 0.02], [-165.0, -65.0, 600.0]),
        ([-0.35, 0.15, -0.05], [-160.0, -60.0, 610.0]),
        ([0.1, 0.4, 0.04], [-165.0, -60.0, 640.0]),
        ([0.05, -0.4, 0.0], [-160.0, -60.0, 580.0]),
        ([0.3, -0.3, 0.1], [-160.0, -70.0, 590.0]),
    ]
    .map(|(r, t)| Pose::from_rotation_vector(r, t))
    .to_vec()
}

#[test]
fn projection_and_its_inverse_agree() {
    let camera = camera();
    for i in 0..400 {
        let pixel = [f64::from(i % 20) * 33.0, f64::from(i / 20) * 25.0];
        let [x, y] = camera.undistort(pixel).unwrap();
        let back = camera.project([3.0 * x, 3.0 * y, 3.0]);
        // Newton stops at 1e-13 of the ray: times the focal length, 1e-10 px.
        assert!((back[0] - pixel[0]).hypot(back[1] - pixel[1]) < 1e-9, "{pixel:?} {back:?}");
    }
    assert!(camera.is_invertible());
    let folded = CameraModel { distortion: [-2.0, 0.0, 0.0, 0.0, 0.0], ..camera };
    assert!(!folded.is_invertible());
}

#[test]
fn a_known_camera_is_recovered_from_exact_points() {
    let board = Board::parse("9x6", 10.0).unwrap();
    let truth = camera();
    let views: Vec<View> = poses()
        .iter()
        .enumerate()
        .map(|(i, pose)| View {
            name: format!("pose{i}"),
            image_points: board
                .object_points()
                .iter()
                .map(|&p| truth.project(pose.apply([1.8 * p[0], 1.8 * p[1], 0.0])))
                .collect(),
            object_points: board
                .object_points()
                .iter()
                .map(|p| [1.8 * p[0], 1.8 * p[1], 0.0])
                .collect(),
        })
        .collect();
    let found = calibrate_camera(&views, [640, 480]).unwrap();
    // Points travel in single precision: 3e-5 px of rounding, some hundredfold in the focal length.
    assert!(found.rms_px < 1e-4, "{}", found.rms_px);
    assert!((found.model.fx - truth.fx).abs() < 0.01, "{:?}", found.model);
    assert!((found.model.cy - truth.cy).abs() < 0.01, "{:?}", found.model);
    assert!((found.model.distortion[0] - truth.distortion[0]).abs() < 1e-3, "{:?}", found.model);
    for (fit, pose) in found.views.iter().zip(poses()) {
        assert!((fit.pose.translation_mm[2] - pose.translation_mm[2]).abs() < 0.02);
    }
    let few = calibrate_camera(&views[..2], [640, 480]);
    assert!(matches!(few, Err(CalibrationError::TooFewViews { found: 2, .. })), "{few:?}");
    let small = calibrate_camera(&views, [320, 240]);
    assert!(matches!(small, Err(CalibrationError::Mismatch { .. })), "{small:?}");
}

#[test]
fn camera_and_projector_are_recovered_from_pictures() {
    let board = Board::parse("7x6", 20.0).unwrap();
    let shown =
        ProjectedBoard { columns: 6, rows: 5, square_px: 28.0, first_corner_px: [215.0, 95.0] };
    let to_projector = camera_to_projector();
    let truth = projector();
    let mut whites = Vec::new();
    let mut patterns = Vec::new();
    for (i, pose) in poses().iter().enumerate() {
        whites.push(render(pose, i as u64, |x, y| print(&board, x, y)));
        let plane = FacePlane { device: truth, pose: pose.then(&to_projector), z_mm: 0.0 };
        patterns.push(render(pose, 100 + i as u64, |x, y| {
            let light = plane.face_to_pixel([x, y]).map_or(0.0, |px| shown.light_at(px));
            print(&board, x, y) * (0.1 + 0.9 * light)
        }));
    }
    // The board beside the pattern leaves half of the picture to further views.
    let more = [
        ([0.3, 0.2, 0.0], [30.0, -120.0, 600.0]),
        ([-0.3, -0.3, 0.1], [20.0, 10.0, 560.0]),
        ([0.2, -0.4, 1.5], [200.0, -80.0, 620.0]),
    ]
    .map(|(r, t)| render(&Pose::from_rotation_vector(r, t), 50, |x, y| print(&board, x, y)));
    let views: Vec<View> =
        whites.iter().chain(&more).map(|photo| board.view(photo).unwrap()).collect();
    let camera_found = calibrate_camera(&views, [640, 480]).unwrap();
    eprintln!("camera {:?} rms {:.4}", camera_found.model, camera_found.rms_px);
    // Rendered corners are found to some hundredths of a pixel.
    assert!(camera_found.rms_px < 0.08, "{}", camera_found.rms_px);
    assert!((camera_found.model.fx / camera().fx - 1.0).abs() < 5e-3, "{:?}", camera_found.model);
    let seen: Vec<_> = whites
        .iter()
        .zip(&patterns)
        .map(|(white, pattern)| {
            observe_projected_board(&camera_found.model, &board, &shown, white, pattern).unwrap()
        })
        .collect();
    let found = calibrate_projector(&seen, [400, 300]).unwrap();
    eprintln!("projector {:?} ± {:?}", found.model, found.standard_deviations);
    eprintln!("rms {:.4} baseline {:.2} {:?}", found.rms_px, found.baseline_mm, found.pose);
    assert!(found.rms_px < 0.1, "{}", found.rms_px);
    assert!((found.model.fx / truth.fx - 1.0).abs() < 0.01, "{:?}", found.model);
    assert!((found.model.cy - truth.cy).abs() < 6.0, "{:?}", found.model);
    let centre = to_projector.inverse().translation_mm;
    let baseline = centre.iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!((found.baseline_mm / baseline - 1.0).abs() < 0.01, "{}", found.baseline_mm);
    // What counts in the end: a place on the plane is lit where it should be.
    // (Each in its own camera frame: a shifted principal point turns the found one a little.)
    let ours =
        FacePlane { device: found.model, pose: seen[0].board_pose.then(&found.pose), z_mm: 0.0 };
    let true_plane = FacePlane { device: truth, pose: poses()[0].then(&to_projector), z_mm: 0.0 };
    let mut worst = 0.0_f64;
    for corner in shown.corner_pixels() {
        let [a, b] = [&ours, &true_plane].map(|plane| plane.pixel_to_face(corner).unwrap());
        let miss = (a[0] - b[0]).hypot(a[1] - b[1]);
        worst = worst.max(miss);
        assert!(miss < 0.2, "{miss} mm at {corner:?}");
    }
    eprintln!("worst miss on the plane {worst:.4} mm");
    let text = serde_json::to_string(&found).unwrap();
    let read: calibration::ProjectorCalibration = serde_json::from_str(&text).unwrap();
    assert_eq!(read.observations.len(), found.observations.len());
}

#[test]
fn a_dark_16_bit_picture_keeps_its_board() {
    let board = Board::parse("7x6", 20.0).unwrap();
    let mut photo = render(&poses()[1], 9, |x, y| print(&board, x, y));
    let bright = find_board(&photo, &board).unwrap();
    // The same light at a tenth of full scale, in 16 bits.
    photo.data.iter_mut().for_each(|v| *v *= 26);
    photo.max_value = 65535;
    let dark = find_board(&photo, &board).unwrap();
    for (a, b) in bright.iter().zip(&dark) {
        // Another quantisation of the same picture.
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 0.05, "{a:?} {b:?}");
    }
}

#[test]
fn an_unseen_board_is_reported_with_a_reason() {
    let board = Board::parse("9x6", 25.0).unwrap();
    let flat = |value: u16| Photo {
        width: 320,
        height: 240,
        channels: 1,
        data: vec![value; 320 * 240],
        max_value: 255,
        name: "flat.png".into(),
    };
    for (value, word) in [(3, "dark"), (255, "clipped"), (128, "not seen")] {
        let message = find_board(&flat(value), &board).unwrap_err().to_string();
        assert!(message.contains("flat.png") && message.contains(word), "{message}");
    }
    // However small, a picture is answered, not choked on.
    for (width, height) in [(1, 1), (4, 3), (1, 300), (20, 16)] {
        let tiny = Photo { width, height, data: vec![90; width * height], ..flat(90) };
        assert!(find_board(&tiny, &board).is_err());
    }
    for text in ["9", "9x", "1x6", "9x6x3", "x"] {
        assert!(Board::parse(text, 25.0).is_err(), "{text}");
    }
    assert!(Board::parse("9x6", 0.0).is_err());
}

#[test]
fn a_gradient_comes_back_on_the_face() {
    let device = camera();
    let pose = Pose::from_rotation_vector([0.1, -0.15, 0.02], [-60.0, -45.0, 400.0]);
    let face = FacePlane { device, pose, z_mm: 0.0 };
    let light = |x: f64, y: f64| 1.0 + 0.01 * x + 0.02 * y;
    let data: Vec<f32> = (0..480 * 640)
        .map(|i| {
            let place = face.pixel_to_face([f64::from(i % 640), f64::from(i / 640)]);
            place.map_or(0.0, |[x, y]| light(x, y) as f32)
        })
        .collect();
    let mut image = HdrImage {
        width: 640,
        height: 480,
        channels: 1,
        variance: vec![0.04; data.len()],
        radiance: data,
        variance_known: true,
        clipped_shortest: 0,
        lost_longest: 0,
    };
    let map = rectify(&image, &face, [60, 40], [2.0, 2.0]).unwrap();
    for (i, (&value, &variance)) in map.radiance.iter().zip(&map.variance).enumerate() {
        let (x, y) = (2.0 * (i % 60) as f64 + 1.0, 2.0 * (i / 60) as f64 + 1.0);
        // The light is linear over the face and all but linear over a pixel.
        assert!((f64::from(value) - light(x, y)).abs() < 1e-4, "cell {i}: {value}");
        // About 4 x 4 pixels a cell, of which bilinear interpolation mixes in some neighbours.
        assert!((0.04 / 32.0..0.04 / 8.0).contains(&variance), "cell {i}: {variance}");
    }
    // One clipped pixel masks the cells that it touches, and no others.
    let [u, v] = face.face_to_pixel([51.0, 31.0]).unwrap();
    image.variance[v.round() as usize * 640 + u.round() as usize] = f32::INFINITY;
    let masked = rectify(&image, &face, [60, 40], [2.0, 2.0]).unwrap();
    assert!(masked.variance[15 * 60 + 25].is_infinite());
    assert_eq!(masked.variance.iter().filter(|v| v.is_infinite()).count(), 1);
    // Cells beyond the picture are masked.
    let wide = rectify(&image, &face, [4, 4], [100.0, 100.0]).unwrap();
    assert!(wide.variance[15].is_infinite());
}
