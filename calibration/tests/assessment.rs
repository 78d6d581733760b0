//! What is said about a calibration, held against simulated rigs whose truth is known.

mod rig;

use calibration::{
    Assessment, Device, Geometry, Grade, Pose, RayUncertainty, RigView, calibrate_geometry,
    ray_difference,
};
use rayon::prelude::*;
use rig::{CAMERA_PX, CHOICE, Light, Noise, PROJECTOR_PX, camera, observe, projector, rig};

/// Over 200 repeats with other noise (seeds 0, 1, 2 …) one sigma of the field must cover the
/// difference to the true device, the best turn taken off, 68.3 % of the time. At one place of the
/// picture the share scatters by √(0.683 · 0.317 / 200) = 3.3 %; over the picture neighbours go
/// together and a handful of parameters move all of it, so that the mean of all places scatters by
/// about a half of that: 3 of these each, 4 for any single place, of which there are a few dozen
/// independent ones.
#[test]
fn the_field_covers_the_true_devices() {
    let repeats = 200u32;
    let scatter = (0.683 * 0.317 / f64::from(repeats)).sqrt();
    let hits: Vec<[Vec<[bool; 2]>; 2]> = (0..u64::from(repeats))
        .into_par_iter()
        .map(|seed| {
            let views = rig(9, Light::Coded, &mut Noise::new(seed));
            let found = calibrate_geometry(&views, CAMERA_PX, Some(PROJECTOR_PX), CHOICE).unwrap();
            let covered = |device: &Device, name, truth| {
                let field = RayUncertainty::of(device, name, &found.covariance).unwrap();
                let apart = ray_difference(&device.model, &truth).unwrap();
                assert_eq!(apart.len(), field.pixels.len());
                let axes = |(d, c): (&[f64; 2], &[[f64; 2]; 2])| {
                    [0, 1].map(|a| d[a].abs() <= c[a][a].sqrt())
                };
                apart.iter().zip(&field.covariance_px).map(axes).collect()
            };
            let lit = &found.projector.as_ref().unwrap().device;
            [covered(&found.camera, "camera", camera()), covered(lit, "projector", projector())]
        })
        .collect();
    for (device, name) in ["camera", "projector"].iter().enumerate() {
        let points = hits[0][device].len();
        let (mut sum, mut farthest) = (0.0, 0.0_f64);
        for point in 0..points {
            for axis in 0..2 {
                let count = hits.iter().filter(|h| h[device][point][axis]).count();
                let share = count as f64 / f64::from(repeats);
                sum += share;
                farthest = farthest.max((share - 0.683).abs());
            }
        }
        let mean = sum / (2 * points) as f64;
        eprintln!(
            "{name}: {:.1} % on average, {:.1} % off at most",
            100.0 * mean,
            100.0 * farthest
        );
        assert!((mean - 0.683).abs() < 1.5 * scatter, "{name}: {mean}");
        assert!(farthest < 4.0 * scatter, "{name}: {farthest}");
    }
}

/// Middles of boards all over the camera's picture, pixels: corners, edges, middle.
const PLACES: [[f64; 2]; 9] = [
    [275.0, 205.0],
    [640.0, 205.0],
    [1005.0, 205.0],
    [275.0, 512.0],
    [640.0, 512.0],
    [1005.0, 512.0],
    [275.0, 815.0],
    [640.0, 815.0],
    [1005.0, 815.0],
];

/// A board of 200 x 150 mm with its middle seen at each place, tilted by `tilt` radians about
/// another axis each time.
fn boards(places: &[[f64; 2]], tilt: f64) -> Vec<Pose> {
    let truth = camera();
    let place = |(i, p): (usize, &[f64; 2])| {
        let turn = 2.4 * i as f64;
        let z = 720.0 + 40.0 * turn.sin();
        let x = (p[0] - truth.cx) / truth.fx * z;
        let y = (p[1] - truth.cy) / truth.fy * z;
        let tilted =
            Pose::from_rotation_vector([tilt * turn.cos(), tilt * turn.sin(), 0.0], [x, y, z]);
        Pose::from_rotation_vector([0.0; 3], [-100.0, -75.0, 0.0]).then(&tilted)
    };
    places.iter().enumerate().map(place).collect()
}

fn views(poses: &[Pose], seed: u64) -> Vec<RigView> {
    let mut noise = Noise::new(seed);
    let see = |(i, pose)| {
        RigView::camera_only(observe(pose, format!("view{i}"), Light::Coded, &mut noise).board)
    };
    poses.iter().enumerate().map(see).collect()
}

fn twice(places: &[[f64; 2]]) -> Vec<[f64; 2]> {
    [places, places].concat()
}

fn solve(views: &[RigView]) -> Geometry {
    calibrate_geometry(views, CAMERA_PX, None, CHOICE).unwrap()
}

fn assess(views: &[RigView], missed: &[String]) -> Assessment {
    let out = Assessment::of(&solve(views), missed).unwrap();
    eprintln!("{}", serde_json::to_string_pretty(&out.verdict).unwrap());
    out
}

/// Whether some reason of this grade says so.
fn says(assessment: &Assessment, grade: Grade, words: &str) -> bool {
    assessment.verdict.reasons.iter().any(|r| r.grade == grade && r.text.contains(words))
}

fn advises(assessment: &Assessment, words: &str) -> bool {
    assessment.verdict.advice.iter().any(|a| a.contains(words))
}

#[test]
fn a_good_set_is_good_and_leaves_nothing_to_do() {
    let found = assess(&views(&boards(&twice(&PLACES), 0.5), 1), &[]);
    assert_eq!(found.verdict.grade, Grade::Good);
    assert!(found.verdict.advice.is_empty());
    assert!(found.camera.coverage.empty.is_empty());
    let halves = found.halves.unwrap().camera;
    // Halves that differ by noise alone: see UNEXPECTED in the crate.
    assert!(halves.rms_px < 3.0 * halves.predicted_px && halves.max_px > halves.rms_px);
}

#[test]
fn an_empty_corner_is_named_with_what_to_do() {
    let places: Vec<[f64; 2]> =
        PLACES.into_iter().filter(|p| !(p[0] < 300.0 && p[1] > 800.0)).collect();
    let found = assess(&views(&boards(&twice(&places), 0.5), 2), &[]);
    assert_eq!(found.verdict.grade, Grade::Usable);
    assert!(advises(&found, "no board in the lower left corner; add two views there"));
    // And nothing else is wrong with it.
    assert_eq!(found.verdict.advice.len(), 1);
}

#[test]
fn boards_in_the_middle_alone_are_not_enough() {
    let found = assess(&views(&boards(&[PLACES[4]; 12], 0.5), 3), &[]);
    assert!(found.verdict.grade >= Grade::Usable);
    assert!(says(&found, Grade::Usable, "no board in the upper left corner, upper edge"));
    assert!(advises(&found, "move the board into every corner and along every edge"));
    // The rim is extrapolated, and its sigma says so.
    let field = &found.camera.uncertainty;
    assert!(field.worst_px > 3.0 * field.sigma_px[field.sigma_px.len() / 2]);
}

#[test]
fn boards_that_are_hardly_tilted_are_to_be_tilted() {
    let found = assess(&views(&boards(&twice(&PLACES), 0.1), 4), &[]);
    assert!(found.verdict.grade >= Grade::Usable);
    assert!(says(&found, Grade::Usable, "they say little about the focal length"));
    assert!(advises(&found, "tilt the board by 20–40°"));
}

#[test]
fn a_view_that_fits_worse_is_named() {
    // Corners off by 0.35 px instead of 0.1, and by 1 px, which are outliers, most of them.
    for (sigma, words) in [(0.35, "times worse than the others"), (1.5, "do not go with the")] {
        let poses = boards(&twice(&PLACES), 0.5);
        let mut spoilt = views(&poses, 5);
        let mut noise = Noise { camera_px: sigma, ..Noise::new(99) };
        spoilt[4].board = observe(&poses[4], "view4".into(), Light::Coded, &mut noise).board;
        let found = assess(&spoilt, &[]);
        assert!(says(&found, Grade::Usable, "view view4") && says(&found, Grade::Usable, words));
        assert!(advises(&found, "view view4: blurred, or board or camera moved?"));
        assert!(!advises(&found, "view view5"));
    }
}

#[test]
fn few_views_are_to_be_more() {
    let found = assess(&views(&boards(&[0, 2, 6, 8].map(|i| PLACES[i]), 0.5), 6), &[]);
    assert_eq!(found.halves, None);
    assert!(says(&found, Grade::Usable, "4 views do not make two calibrations"));
    assert!(advises(&found, "take at least 4 more views"));
}

/// A lens whose focus moves between the pictures: each half is fine by itself.
#[test]
fn halves_that_disagree_betray_a_change() {
    let poses = boards(&twice(&PLACES), 0.5);
    let mut changed = views(&poses, 7);
    let mut lens = camera();
    lens.fx *= 1.004;
    lens.fy *= 1.004;
    for (view, pose) in changed.iter_mut().zip(&poses).skip(1).step_by(2) {
        let pairs = view.board.image_points.iter_mut().zip(&view.board.object_points);
        for (seen, &p) in pairs {
            let (then, now) = (camera().project(pose.apply(p)), lens.project(pose.apply(p)));
            *seen = [seen[0] + now[0] - then[0], seen[1] + now[1] - then[1]];
        }
    }
    let found = assess(&changed, &[]);
    assert!(says(&found, Grade::Usable, "odd and even views differ"));
    assert!(advises(&found, "halves of the views differ by more than noise explains"));
}

#[test]
fn pictures_without_a_board_are_counted() {
    let missed = ["a.jpg: no board".to_owned(), "b.jpg: no board".to_owned()];
    let found = assess(&views(&boards(&twice(&PLACES), 0.5), 8), &missed);
    assert_eq!(found.verdict.grade, Grade::Good);
    assert!(says(&found, Grade::Good, "2 of 20 pictures without a board"));
    assert_eq!(found.missed, missed);
}

#[test]
fn a_projector_is_judged_beside_the_camera() {
    let views = rig(9, Light::Coded, &mut Noise::new(9));
    let geometry = calibrate_geometry(&views, CAMERA_PX, Some(PROJECTOR_PX), CHOICE).unwrap();
    let found = Assessment::of(&geometry, &[]).unwrap();
    eprintln!("{}", serde_json::to_string_pretty(&found.verdict).unwrap());
    assert!(found.projector.is_some() && found.halves.unwrap().projector.is_some());
    assert!(found.verdict.reasons.iter().any(|r| r.text.contains("baseline known to")));
    let again = serde_json::from_str(&serde_json::to_string(&found).unwrap());
    let again: Assessment = again.unwrap();
    assert_eq!(again.verdict, found.verdict);
}

#[test]
fn a_geometry_that_does_not_hang_together_is_refused() {
    let mut geometry = solve(&views(&boards(&PLACES, 0.5), 10));
    geometry.covariance.matrix.pop();
    assert!(Assessment::of(&geometry, &[]).is_err());
    let mut geometry = solve(&views(&boards(&PLACES, 0.5), 10));
    geometry.observations.pop();
    assert!(Assessment::of(&geometry, &[]).is_err());
}

/// A board whose first corners stand out of its plane, as a view sees it from two sides.
#[test]
fn a_board_that_is_bent_at_a_corner_is_told_from_stray_points() {
    let poses = boards(&twice(&PLACES), 0.5);
    let spoil = |same: bool| {
        let mut views = views(&poses, 11);
        for (i, view) in views.iter_mut().enumerate().take(6) {
            for k in 0..3 {
                let corner = if same { k } else { 7 * i + 2 * k };
                view.board.image_points[corner][0] += 3.0;
            }
        }
        assess(&views, &[])
    };
    assert!(advises(&spoil(true), "the same corners of the board are off"));
    assert!(advises(&spoil(false), "look at the points that were left out"));
}
