//! What `session.toml` asks for and nobody can do is refused when it is read, by every command.

mod common;

use common::{SIMULATED_RIG, diaphane};
use std::path::Path;

/// The file with `key = …` of the table `[table]` replaced by another line.
fn with(text: &str, table: &str, key: &str, line: &str) -> String {
    let mut here = String::new();
    let mut found = false;
    let lines: Vec<String> = text
        .lines()
        .map(|known| {
            if known.starts_with('[') {
                here = known.trim_matches(['[', ']']).to_owned();
            }
            let is_it = here == table && known.split(" = ").next() == Some(key);
            found |= is_it;
            if is_it { line.to_owned() } else { known.to_owned() }
        })
        .collect();
    assert!(found, "no {key} in [{table}]: {text}");
    lines.join("\n")
}

#[test]
fn impossible_values_are_refused_by_their_key() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("wax").display().to_string();
    assert_eq!(diaphane(["init", &session]).code, 0);
    let file = Path::new(&session).join("session.toml");
    let good = std::fs::read_to_string(&file).unwrap();
    let (patch, projected) = ("plan.reference_patch.", "plan.projector_board");
    let patch_of = |which: &str| format!("{patch}{which}");
    let table = [
        ("sample", "eta", "eta = 0.5", "sample.eta"),
        ("sample", "eta", "eta = nan", "sample.eta"),
        ("sample", "eta", "eta = inf", "sample.eta"),
        ("sample", "eta", "eta = 1.4\nboundary_constant = -1.0", "sample.boundary_constant"),
        ("sample", "eta", "eta = 1.4\nboundary_constant = nan", "sample.boundary_constant"),
        ("sample.grid", "cells", "cells = [0, 40, 10]", "at least 2 cells"),
        ("sample.grid", "cells", "cells = [40, 40, 1]", "at least 2 cells"),
        ("sample.grid", "cells", "cells = [4000, 4000, 4000]", "sample.grid"),
        ("sample.grid", "cells", "cells = [3, 40, 10]", "plan.regions"),
        ("sample.grid", "spacing_mm", "spacing_mm = [0.0, 0.45, 0.45]", "positive"),
        ("sample.grid", "spacing_mm", "spacing_mm = [0.45, -0.45, 0.45]", "positive"),
        ("sample.grid", "spacing_mm", "spacing_mm = [0.45, nan, 0.45]", "positive"),
        ("rig.board", "columns", "columns = 1", "rig.board"),
        ("rig.board", "square_mm", "square_mm = 0.0", "square size"),
        ("rig.board", "square_mm", "square_mm = nan", "square size"),
        ("rig.noise", "gain", "gain = 0.0", "rig.noise"),
        ("rig.noise", "read_noise", "read_noise = -1.0", "rig.noise"),
        ("rig.noise", "full_scale", "full_scale = nan", "rig.noise"),
        ("rig.noise", "black_level", "black_level = 70000.0", "rig.noise"),
        ("plan", "regions", "regions = [0, 4]", "plan.regions"),
        ("plan", "regions", "regions = [65, 4]", "plan.regions"),
        ("plan", "regions", "regions = [41, 4]", "plan.regions"),
        ("plan", "bracket_s", "bracket_s = []", "plan.bracket_s"),
        ("plan", "bracket_s", "bracket_s = [0.1, -0.2]", "plan.bracket_s"),
        ("plan", "bracket_s", "bracket_s = [0.1, nan]", "plan.bracket_s"),
        ("plan", "reference_bracket_s", "reference_bracket_s = []", "plan.reference_bracket_s"),
        ("plan", "reference_bracket_s", "reference_bracket_s = [inf]", "plan.reference_bracket_s"),
        (
            "plan",
            "response_bracket_s",
            "response_bracket_s = [0.0, 1.0]",
            "plan.response_bracket_s",
        ),
        ("plan", "response_bracket_s", "response_bracket_s = [0.1]", "differ by 5 %"),
        ("plan", "response_bracket_s", "response_bracket_s = [0.1, 0.101]", "differ by 5 %"),
        ("plan", "board_exposure_s", "board_exposure_s = 0.0", "plan.board_exposure_s"),
        ("plan", "board_exposure_s", "board_exposure_s = nan", "plan.board_exposure_s"),
        ("plan", "board_poses", "board_poses = 2", "plan.board_poses"),
        ("plan", "board_poses", "board_poses = 0", "plan.board_poses"),
        ("plan", "board_poses", "board_poses = 1001", "plan.board_poses"),
        ("plan", "ramp_levels", "ramp_levels = 4", "plan.ramp_levels"),
        ("plan", "projector_px", "projector_px = [8, 8]", "plan.projector_px"),
        ("plan", "projector_px", "projector_px = [600, 700]", "plan.projector_board"),
        ("plan", "projector_px", "projector_px = [1024, 800]", "1024 x 768"),
        (projected, "columns", "columns = 1", projected),
        (projected, "columns", "columns = 9", projected),
        (projected, "square_px", "square_px = 0", projected),
        (projected, "x0", "x0 = 900", projected),
        (&patch_of("camera_px"), "x1", "x1 = 641", "plan.reference_patch.camera_px"),
        (&patch_of("camera_px"), "x1", "x1 = 0", "plan.reference_patch.camera_px"),
        (&patch_of("projector_px"), "y1", "y1 = 769", "plan.reference_patch.projector_px"),
    ];
    for (part, key, line, told) in table {
        std::fs::write(&file, with(&good, part, key, line)).unwrap();
        let run = diaphane(["status", &session]);
        let said = |key: &str| run.json[key].as_str().unwrap_or_default().to_owned();
        assert_eq!(run.code, 2, "{line}: {}", run.stderr);
        assert!(said("error").contains(told), "{line}: {}", run.stderr);
        assert!(said("error").contains("session.toml") && said("hint").contains("session.toml"));
    }
    std::fs::write(&file, good.replacen("version = 1", "version = 0", 1)).unwrap();
    assert_eq!(diaphane(["status", &session]).code, 2);
    // What is no TOML, with a hint too.
    std::fs::write(&file, good.replacen("[sample]", "[sample", 1)).unwrap();
    let run = diaphane(["status", &session]);
    assert!(run.code == 2 && run.json["hint"].as_str().unwrap().contains("session.toml"));
    std::fs::write(&file, good).unwrap();
    assert_eq!(diaphane(["plan", &session]).code, 0);
}

/// The same from the command line, before anything is written.
#[test]
fn impossible_values_are_refused_by_init() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let rig = path("rig.toml");
    std::fs::write(&rig, SIMULATED_RIG).unwrap();
    let session = path("block");
    for (key, value, told) in [
        ("--eta", "0.9", "sample.eta"),
        ("--eta", "-1", "sample.eta"),
        ("--size", "-8x8x1", "positive"),
        ("--size", "8x0x1", "positive"),
        ("--cells", "1x8x4", "at least 2"),
        ("--cells", "3x8x4", "plan.regions"),
        ("--square", "-2", "-2"),
        ("--square", "nan", "square"),
    ] {
        let flags = [
            ("--rig", rig.as_str()),
            ("--size", "8x8x2"),
            ("--cells", "8x8x4"),
            ("--board", "9x6"),
            ("--square", "2"),
            ("--eta", "1.5"),
        ];
        let flags = flags.map(|(name, plain)| [name, if name == key { value } else { plain }]);
        let run =
            diaphane(["init", session.as_str()].into_iter().chain(flags.into_iter().flatten()));
        assert_eq!(run.code, 2, "{key} {value}: {}", run.stderr);
        assert!(run.stderr.contains(told), "{key} {value}: {}", run.stderr);
        assert!(!Path::new(&session).join("session.toml").exists());
    }
}
