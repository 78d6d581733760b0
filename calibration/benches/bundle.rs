//! A camera from 186 views with 100 corners each, on one core.

use calibration::{CameraModel, Choice, Distortion, Pose, RigView, View, calibrate_geometry};
use criterion::{Criterion, criterion_group, criterion_main};

fn views() -> Vec<RigView> {
    let mut camera = CameraModel::pinhole([4000, 2200], [1900.0, 1905.0], [2010.0, 1080.0]);
    camera.distortion = [-0.12, 0.03, 5e-4, -3e-4, 0.0, 0.0, 0.0, 0.0];
    let object_points: Vec<[f64; 3]> =
        (0..100).map(|i| [58.8 * f64::from(i % 10), 58.8 * f64::from(i / 10), 0.0]).collect();
    let view = |i: i32| {
        let turn = 2.4 * f64::from(i);
        let tilt = 0.45 + 0.3 * (1.7 * f64::from(i)).sin();
        let middle = Pose::from_rotation_vector(
            [tilt * turn.cos(), tilt * turn.sin(), (0.9 * f64::from(i)).cos()],
            [500.0 * (3.1 * turn).sin(), 150.0 * (2.3 * turn).cos(), 1500.0 + 200.0 * turn.sin()],
        );
        let pose = Pose::from_rotation_vector([0.0; 3], [-265.0, -265.0, 0.0]).then(&middle);
        // Deterministic errors of about 0.3 px.
        let off = |j: usize, p: [f64; 2]| {
            let phase = (13 * j) as f64 + 0.7 * f64::from(i);
            [p[0] + 0.4 * phase.sin(), p[1] + 0.4 * (1.3 * phase).cos()]
        };
        let seen = object_points.iter().enumerate();
        let image_points = seen.map(|(j, &p)| off(j, camera.project(pose.apply(p)))).collect();
        let object_points = object_points.clone();
        RigView::camera_only(View { name: format!("view{i}"), image_points, object_points })
    };
    (0..186).map(view).collect()
}

fn bundle(c: &mut Criterion) {
    let views = views();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut group = c.benchmark_group("186 poses, 18600 corners, one core");
    group.sample_size(10);
    for distortion in [Distortion::K1K2P1P2, Distortion::Five] {
        let choice = Choice { camera: Some(distortion), ..Choice::default() };
        group.bench_function(distortion.name(), |b| {
            b.iter(|| {
                one.install(|| calibrate_geometry(&views, [4000, 2200], None, choice).unwrap())
            });
        });
    }
    group.finish();
}

criterion_group!(benches, bundle);
criterion_main!(benches);
