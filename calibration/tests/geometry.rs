//! Cameras, projectors and faces whose truth is known, seen in rendered pictures.

use calibration::{
    Board, CameraModel, Choice, Distortion, FacePlane, HdrImage, Photo, Pose, ProjectedPoint,
    RigView, calibrate_geometry, find_board, rectify,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn camera() -> CameraModel {
    let mut out = CameraModel::pinhole([640, 480], [800.0, 805.0], [312.0, 246.0]);
    out.distortion[..4].copy_from_slice(&[-0.12, 0.05, 0.0008, -0.0005]);
    out
}

/// Lens-shifted: the principal point lies below the picture.
fn projector() -> CameraModel {
    let mut out = CameraModel::pinhole([400, 300], [600.0, 598.0], [205.0, 330.0]);
    out.distortion[0] = 0.01;
    out
}

/// What the projector shows: dark squares on white, 6x5 inner corners.
const SHOWN: Shown = Shown { columns: 6, rows: 5, square_px: 28.0, first_corner_px: [215.0, 95.0] };

struct Shown {
    columns: usize,
    rows: usize,
    square_px: f64,
    first_corner_px: [f64; 2],
}

impl Shown {
    fn corner_pixels(&self) -> Vec<[f64; 2]> {
        let [u, v] = self.first_corner_px;
        let at = |i: usize| {
            let (x, y) = ((i % self.columns) as f64, (i / self.columns) as f64);
            [u + x * self.square_px, v + y * self.square_px]
        };
        (0..self.columns * self.rows).map(at).collect()
    }

    fn light_at(&self, pixel: [f64; 2]) -> f64 {
        let square =
            |a: usize| ((pixel[a] - self.first_corner_px[a]) / self.square_px).floor() + 1.0;
        let (column, row) = (square(0), square(1));
        let on_board = (0.0..=self.columns as f64).contains(&column)
            && (0.0..=self.rows as f64).contains(&row);
        if on_board && (column + row) % 2.0 == 0.0 { 0.0 } else { 1.0 }
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
    // Edges are averaged over 4 x 4 rays a pixel, as a lens would.
    let offset = |i: usize| (i as f64 + 0.5) / 4.0 - 0.5;
    let mut pixel = |i: usize| {
        let (u, v) = ((i % 640) as f64, (i / 640) as f64);
        let rays = (0..16).map(|ray| {
            plane
                .pixel_to_face([u + offset(ray % 4), v + offset(ray / 4)])
                .map_or(0.0, |[x, y]| light(x, y))
        });
        let value = rays.sum::<f64>() / 16.0;
        let noise: f64 = (0..4).map(|_| rng.random::<f64>() - 0.5).sum();
        (20.0 + 200.0 * value + noise).clamp(0.0, 255.0) as u16
    };
    let data = (0..640 * 480).map(&mut pixel).collect();
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
}

/// Pixels that mrcal 2.2 (Debian) gives for the same coefficients: LENSMODEL_OPENCV5 and 8.
#[test]
fn projection_agrees_with_mrcal() {
    let mut camera = CameraModel::pinhole([640, 480], [533.1, 533.4], [342.2, 233.5]);
    camera.distortion = [-0.29, 0.11, 0.001, -0.0005, 0.02, 0.0, 0.0, 0.0];
    let mut rational = camera;
    rational.distortion[5..].copy_from_slice(&[0.03, -0.01, 0.004]);
    let known = [
        (camera, [0.31, -0.17, 1.0], [501.6200482015625, 146.075298278125]),
        (camera, [-0.42, 0.33, 1.1], [151.00998553745933, 383.8816208042759]),
        (rational, [0.31, -0.17, 1.0], [501.0474423318953, 146.38948465633695]),
    ];
    for (model, point, [x, y]) in known {
        let [u, v] = model.project(point);
        // Both compute in double precision.
        assert!((u - x).hypot(v - y) < 1e-9, "{u} {v} for {x} {y}");
        let [a, b] = model.undistort([u, v]).unwrap();
        assert!((a - point[0] / point[2]).hypot(b - point[1] / point[2]) < 1e-12, "{a} {b}");
    }
}

#[test]
fn camera_and_projector_are_recovered_from_pictures() {
    let board = Board::parse("7x6", 20.0).unwrap();
    let shown = Board::parse("6x5", 1.0).unwrap();
    let (to_projector, truth) = (camera_to_projector(), projector());
    let mut views = Vec::new();
    for (i, pose) in poses().iter().enumerate() {
        let photo = render(pose, i as u64, |x, y| print(&board, x, y));
        let plane = FacePlane { device: truth, pose: pose.then(&to_projector), z_mm: 0.0 };
        // A blank sheet lies over the board while the pattern is shown.
        let pattern = render(pose, 100 + i as u64, |x, y| {
            0.1 + 0.8 * plane.face_to_pixel([x, y]).map_or(0.0, |px| SHOWN.light_at(px))
        });
        let corners = find_board(&pattern, &shown).unwrap().into_iter();
        let point = |(camera_px, projector_px)| ProjectedPoint { camera_px, projector_px };
        let projected = corners.zip(SHOWN.corner_pixels()).map(point).collect();
        views.push(RigView { board: board.view(&photo).unwrap(), coded: Vec::new(), projected });
    }
    // The board beside the pattern leaves half of the picture to further views.
    let more = [
        ([0.3, 0.2, 0.0], [30.0, -120.0, 600.0]),
        ([-0.3, -0.3, 0.1], [20.0, 10.0, 560.0]),
        ([0.2, -0.4, 1.5], [200.0, -80.0, 620.0]),
    ];
    for (r, t) in more {
        let pose = Pose::from_rotation_vector(r, t);
        let photo = render(&pose, 50, |x, y| print(&board, x, y));
        views.push(RigView::camera_only(board.view(&photo).unwrap()));
    }
    // The distortions are named: one that leaves out what is there shifts the rest by more than
    // the stated uncertainty, which supposes that the model is right.
    let choice = Choice {
        camera: Some(Distortion::K1K2P1P2),
        projector: Some(Distortion::K1),
        ..Choice::default()
    };
    let found = calibrate_geometry(&views, [640, 480], Some([400, 300]), choice).unwrap();
    let lit = found.projector.as_ref().unwrap();
    eprintln!("camera {:?}", found.camera);
    eprintln!("projector {:?}, baseline {:.2}, {:?}", lit.device, lit.baseline_mm, lit.pose);
    // Rendered corners are found to some hundredths of a pixel.
    assert!(found.camera.rms_px < 0.08, "{}", found.camera.rms_px);
    assert!(lit.device.rms_px < 0.1, "{}", lit.device.rms_px);
    // Parameters are off by what their stated uncertainty allows; corner errors of rendered
    // pictures are not quite independent, hence 4 sigmas.
    for (device, truth) in [(&found.camera, camera()), (&lit.device, projector())] {
        let (value, truth) = (device.model.parameters(), truth.parameters());
        for k in 0..4 {
            let off = (value[k] - truth[k]).abs() / device.standard_deviations[k];
            assert!(off < 4.0, "parameter {k}: {} for {}, {off:.1} sigmas", value[k], truth[k]);
        }
    }
    // What counts in the end: a place on the plane is lit where it should be.
    // (Each in its own camera frame: a shifted principal point turns the found one a little.)
    let ours = FacePlane {
        device: lit.device.model,
        pose: found.views[0].pose.then(&lit.pose),
        z_mm: 0.0,
    };
    let true_plane = FacePlane { device: truth, pose: poses()[0].then(&to_projector), z_mm: 0.0 };
    for corner in SHOWN.corner_pixels() {
        let [a, b] = [&ours, &true_plane].map(|plane| plane.pixel_to_face(corner).unwrap());
        let miss = (a[0] - b[0]).hypot(a[1] - b[1]);
        // Corners are off by 0.05 px, which is 0.04 mm on the plane, with errors that rendering
        // makes alike for neighbours; at the rim those of pose and distortion add up to some more.
        assert!(miss < 0.2, "{miss} mm at {corner:?}");
    }
    let text = serde_json::to_string(&found).unwrap();
    let read: calibration::Geometry = serde_json::from_str(&text).unwrap();
    assert_eq!(read.observations, found.observations);
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
