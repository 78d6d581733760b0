//! What a calibration's page must show, on a simulated camera and projector.

use super::calibration_page;
use crate::report::html::escape;
use ::calibration::{
    Assessment, CameraModel, CodedCorner, Geometry, Pose, RigView, View, calibrate_geometry,
};

/// Six views of a board of 8 x 6 corners, exact but for a ripple of about 0.05 px that stands for
/// noise; the third has one corner in a wrong place.
fn geometry(lit: bool) -> Geometry {
    let mut camera = CameraModel::pinhole([640, 480], [700.0; 2], [320.0, 240.0]);
    camera.distortion[0] = -0.1;
    let projector = CameraModel::pinhole([800, 600], [1200.0; 2], [400.0, 300.0]);
    let to_projector = Pose::from_rotation_vector([0.0, 0.2, 0.0], [-150.0, 0.0, 20.0]);
    let views: Vec<RigView> = (0..6)
        .map(|i| {
            let turn = f64::from(i);
            let pose = Pose::from_rotation_vector(
                [0.5 * turn.cos(), 0.5 * turn.sin(), 0.1 * turn],
                [-70.0 + 30.0 * (2.0 * turn).cos(), -50.0 + 20.0 * turn.sin(), 420.0],
            );
            let object_points: Vec<[f64; 3]> =
                (0..48).map(|c| [20.0 * f64::from(c % 8), 20.0 * f64::from(c / 8), 0.0]).collect();
            let ripple = |k: f64| 0.07 * (k * 12.9898 + 78.233 * turn).sin();
            let mut image_points: Vec<[f64; 2]> = object_points
                .iter()
                .enumerate()
                .map(|(c, &p)| {
                    let [x, y] = camera.project(pose.apply(p));
                    [x + ripple(c as f64), y + ripple(c as f64 + 0.5)]
                })
                .collect();
            if i == 2 {
                image_points[10][0] += 6.0;
            }
            let code = |(corner, &p): (usize, &[f64; 3])| {
                let [x, y] = projector.project(to_projector.apply(pose.apply(p)));
                let projector_px = [x + ripple(corner as f64 + 0.2), y + ripple(corner as f64)];
                CodedCorner { corner, projector_px, slope: [[0.0; 2]; 2] }
            };
            let coded = object_points.iter().enumerate().map(code);
            let coded = if lit { coded.collect() } else { Vec::new() };
            let board = View { name: format!("<view {i}>"), image_points, object_points };
            RigView { board, coded, projected: Vec::new() }
        })
        .collect();
    let size = lit.then_some([800, 600]);
    calibrate_geometry(&views, [640, 480], size, Default::default()).unwrap()
}

fn page(lit: bool) -> (String, Assessment) {
    let geometry = geometry(lit);
    let missed = ["left99.jpg: no chessboard found: too dark".to_owned()];
    let assessment = Assessment::of(&geometry, &missed).unwrap();
    (calibration_page("A <rig>", &geometry, &assessment).unwrap(), assessment)
}

#[test]
fn everything_has_its_place_on_the_page() {
    for lit in [false, true] {
        let (page, assessment) = page(lit);
        let verdict = format!("<strong>{}</strong>", assessment.verdict.grade.word());
        let first = page.find("<section>").unwrap();
        assert!(page.find(&verdict).unwrap() < first, "the verdict stands first");
        for reason in &assessment.verdict.reasons {
            // The first letter is capital on the page.
            assert!(page.contains(&escape(&reason.text[1..])), "{}", reason.text);
        }
        for advice in &assessment.verdict.advice {
            assert!(page.contains(&escape(&advice[1..])), "{advice}");
        }
        for text in [
            "What was found",
            "Where the boards were",
            "How well each pixel is known",
            "What is left over",
            "View by view",
            "Half against half",
            "Which distortion",
            "left99.jpg: no chessboard found: too dark",
            "printed corner</td><td class=\"number\">11</td>",
        ] {
            assert!(page.contains(text), "{text}");
        }
        assert_eq!(page.contains("baseline"), lit);
        // One map of corners, one field and one of all arrows a device, and one a view.
        let maps = page.matches("<svg class=\"map\" viewBox=\"-").count();
        assert_eq!(maps, if lit { 12 } else { 9 });
        assert!(!page.contains("NaN") && !page.contains(">inf"), "a number that is none");
    }
}

/// Names come from files; the page must neither run them nor fetch anything.
#[test]
fn the_page_needs_nothing_else() {
    let (page, _) = page(true);
    assert!(page.contains("A &lt;rig&gt;") && !page.contains("A <rig>"));
    assert!(page.contains("&lt;view 2&gt;") && !page.contains("<view 2>"));
    for outside in ["http://", "https://", "src=\"/", "@import", "url(h", "<link rel=\"stylesheet"]
    {
        assert!(!page.contains(outside), "{outside}");
    }
    // With room to spare: 13 real views take about 0.12 MB.
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
}
