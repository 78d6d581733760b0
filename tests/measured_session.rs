//! What a session measures of its projector's light and its camera's noise, and makes use of.

mod common;

use common::{diaphane, tiny_session};
use serde_json::Value;
use std::path::Path;

/// One turn of the simulated wheel: no whole number of them is a thirtieth of a second.
const TURN_S: f64 = 0.0111;

/// A run that has to go well.
fn step(arguments: &[&str]) -> (Value, String) {
    let run = diaphane(arguments);
    assert_eq!(run.code, 0, "{arguments:?}: {}", run.stderr);
    (run.json, run.stderr)
}

/// A session with a colour wheel, a linear camera, and no more pictures than this needs.
fn init(session: &str) {
    let imperfections = format!(
        "\n[rig.imperfections]\ncamera_response = \"linear\"\nwheel = {{ turn_s = {TURN_S} }}\n"
    );
    tiny_session(session, &[], &imperfections);
}

fn exposures(plan: &Value, part: usize) -> Vec<f64> {
    let shots = plan["parts"][part]["exposures_s"].as_array().unwrap();
    shots.iter().flat_map(|s| s.as_array().unwrap()).map(|t| t.as_f64().unwrap()).collect()
}

fn partial_turns(plan: &Value, part: usize) -> usize {
    let warnings = plan["parts"][part]["warnings"].as_array().unwrap();
    warnings.iter().filter(|w| w.as_str().unwrap().contains("whole number")).count()
}

#[test]
fn a_session_uses_the_wheel_the_noise_and_the_dark_frames_that_it_measured() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("wheel");
    let session = session.to_str().unwrap();
    init(session);
    let (before, _) = step(&["plan", session]);
    assert_eq!(&exposures(&before, 1)[..3], [0.05, 0.4, 3.0]);
    step(&["calibrate", "all", session]);
    let none = diaphane(["calibrate", "light", session]);
    assert!(none.code == 2 && none.json["hint"].as_str().unwrap().contains("--light"));
    step(&["capture", session, "--light"]);
    let (light, _) = step(&["calibrate", "light", session]);
    let turn = light["wheel_turn_s"].as_f64().unwrap();
    // calibration/tests has the measurement; four of the sigmas that it states.
    let sigma = light["wheel_turn_sigma_s"].as_f64().unwrap();
    assert!((turn - TURN_S).abs() < 4.0 * sigma, "{light}");

    let (plan, _) = step(&["plan", session]);
    for (told, asked) in exposures(&plan, 1).iter().zip([0.05, 0.4, 3.0]) {
        let turns = told / turn;
        // Rounding of one product.
        assert!((turns - turns.round()).abs() < 1e-9 && *told >= 1.0 / 30.0, "{told}");
        assert!((told - asked).abs() <= 0.5 * turn, "{told} for {asked}");
    }
    assert_eq!(partial_turns(&plan, 1), 0, "{plan}");
    // The boards were taken at 1/30 s before the wheel was known.
    assert!(partial_turns(&plan, 0) > 0, "{plan}");

    // The next session on this rig knows it from the start.
    let next = folder.path().join("next");
    let next = next.to_str().unwrap();
    step(&["init", next, "--light", session]);
    let (plan, _) = step(&["plan", next]);
    for told in exposures(&plan, 0).into_iter().chain(exposures(&plan, 1)) {
        let turns = told / turn;
        assert!((turns - turns.round()).abs() < 1e-9 && told >= 1.0 / 30.0, "{told}");
    }
    let empty = diaphane(["init", folder.path().join("x").to_str().unwrap(), "--light", next]);
    assert!(empty.code == 2 && empty.stderr.contains("light.json"), "{}", empty.stderr);

    step(&["capture", session]);
    let (merged, said) = step(&["merge", session]);
    assert!(merged["noise_measured"] == false && merged["dark_frames_s"] == serde_json::json!([]));
    assert!(said.contains("as session.toml says; no dark frames"), "{said}");
    // A frame that was exposed for another time than the plan's is not merged in silence.
    let light = Path::new(session).join("calibration/light.json");
    let kept = std::fs::read(&light).unwrap();
    std::fs::remove_file(&light).unwrap();
    let other = diaphane(["merge", session, "--force"]);
    assert!(other.code == 2 && other.stderr.contains("frames/black/black-e0"), "{}", other.stderr);
    std::fs::write(&light, kept).unwrap();

    step(&["capture", session, "--noise"]);
    let (noise, _) = step(&["calibrate", "noise", session]);
    // A linear camera's points lie on a line: 1, with the scatter of some ten of them.
    assert!(noise["reduced_chi2"].as_f64().unwrap() < 3.0, "{noise}");
    let (merged, said) = step(&["merge", session, "--force"]);
    assert!(said.contains("measured in this session; dark frames of 3"), "{said}");
    assert_eq!(merged["noise_measured"], true);
    assert_eq!(merged["dark_frames_s"].as_array().unwrap().len(), 3, "{merged}");
    // They make a difference: the same merge without them is another.
    let arrays = || std::fs::read(Path::new(session).join("measurement/measurement.npz")).unwrap();
    let with_darks = arrays();
    let frames = Path::new(session).join("frames");
    std::fs::rename(frames.join("noise-dark"), folder.path().join("away")).unwrap();
    let (merged, said) = step(&["merge", session, "--force"]);
    assert!(said.contains("measured in this session; no dark frames"), "{said}");
    assert_eq!(merged["dark_frames_s"], serde_json::json!([]));
    assert!(arrays() != with_darks, "dark frames changed nothing");
}
