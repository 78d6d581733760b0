//! Adaptive and multiplexed plans in sessions, and the study that measures them.

mod common;

use common::diaphane;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// A run that has to go well.
fn step(arguments: &[&str]) -> (Value, String) {
    let run = diaphane(arguments);
    assert_eq!(run.code, 0, "{arguments:?}: {}", run.stderr);
    (run.json, run.stderr)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
        let (path, place) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &place);
        } else {
            std::fs::copy(path, place).unwrap();
        }
    }
}

/// Gives one line of `[plan]` another value.
fn set(session: &Path, key: &str, value: &str) {
    let file = session.join("session.toml");
    let mut table: toml::Table = std::fs::read_to_string(&file).unwrap().parse().unwrap();
    let value: toml::Table = format!("v = {value}").parse().unwrap();
    let plan = table["plan"].as_table_mut().unwrap();
    assert!(plan.insert(key.into(), value["v"].clone()).is_some(), "{key} was there");
    std::fs::write(file, toml::to_string(&table).unwrap()).unwrap();
}

fn session_with(base: &Path, name: &str, settings: &[(&str, &str)]) -> PathBuf {
    let session = base.with_file_name(name);
    copy(base, &session);
    settings.iter().for_each(|(key, value)| set(&session, key, value));
    session
}

fn choice(session: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(session.join("exposures.json")).unwrap()).unwrap()
}

/// All frames of the sample: names and bytes, those set aside left out.
fn frames(session: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut out = Vec::new();
    for shot in std::fs::read_dir(session.join("frames")).unwrap().map(|e| e.unwrap().path()) {
        for frame in std::fs::read_dir(&shot).unwrap().map(|e| e.unwrap().path()) {
            if frame.extension().is_some_and(|e| e == "png") {
                let name = frame.strip_prefix(session).unwrap().to_owned();
                out.push((name, std::fs::read(frame).unwrap()));
            }
        }
    }
    out.sort();
    out
}

/// Starts a capture and kills it once `file` is there; false if it was over before.
fn kill_when_there(session: &Path, file: &str) -> bool {
    let mut running = Command::new(env!("CARGO_BIN_EXE_diaphane"))
        .args(["capture", text(session)])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    loop {
        if session.join(file).exists() {
            running.kill().unwrap();
            return !running.wait().unwrap().success();
        }
        if running.try_wait().unwrap().is_some() {
            return false;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

const ADAPTIVE: (&str, &str) = ("brackets", "\"adaptive\"");
const REGIONS: (&str, &str) = ("regions", "[3, 1]");
const MULTIPLEXED: (&str, &str) = ("scheme", "\"multiplexed\"");
const BRACKET: (&str, &str) = ("bracket_s", "[0.0333334, 0.1, 0.3, 0.9, 2.7]");

#[test]
fn sessions_with_other_plans() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("base");
    step(&["init", text(&base), "--seed", "3"]);
    set(&base, "board_poses", "6");
    step(&["calibrate", "all", text(&base)]);
    adaptive_exposures_are_chosen_once(&base);
    a_brighter_pattern_gets_shorter_exposures(&base);
}

/// Killed before the choice and after it, a capture arrives at the same bytes as an undisturbed
/// one, and goes by the file that is there, whatever the pictures would say.
fn adaptive_exposures_are_chosen_once(base: &Path) {
    let calm = session_with(base, "calm", &[ADAPTIVE, REGIONS, MULTIPLEXED, BRACKET]);
    let (plan, told) = step(&["plan", text(&calm)]);
    assert!(told.contains("the most that it can come to"), "{told}");
    assert_eq!(plan["parts"][1]["frames"], 5 * 9);
    let (_, status) = step(&["status", text(&calm)]);
    assert!(status.contains("0 of 45 pictures"), "{status}");

    let (captured, told) = step(&["capture", text(&calm)]);
    assert!(told.contains("do for every pattern"), "{told}");
    let chosen = choice(&calm);
    let times = chosen["choice"]["exposures_s"].as_array().unwrap().len();
    assert!((2..5).contains(&times), "{chosen}");
    let wanted = 2 * 5 + 7 * times;
    assert_eq!(captured["taken"].as_u64().unwrap() as usize, wanted, "{captured}");
    assert_eq!(chosen["extended_s"], serde_json::json!({}), "{chosen}");
    let worst = chosen["choice"]["worst"].as_f64().unwrap();
    assert!(worst <= 1.05, "{chosen}");
    let (plan, told) = step(&["plan", text(&calm)]);
    assert!(!told.contains("the most"), "{told}");
    assert_eq!(plan["parts"][1]["frames"].as_u64().unwrap() as usize, wanted);
    let (status, _) = step(&["status", text(&calm)]);
    assert_eq!(status["next"]["step"], "measurement", "{status}");
    // Nothing is taken twice.
    assert_eq!(step(&["capture", text(&calm)]).0["taken"], 0);

    let killed = session_with(base, "killed", &[ADAPTIVE, REGIONS, MULTIPLEXED, BRACKET]);
    let mut kills = 0;
    for file in
        ["frames/multiplexed-01/multiplexed-01-e2-r0.png", "exposures.json", "frames/held-full"]
    {
        kills += usize::from(kill_when_there(&killed, file));
    }
    println!("{kills} of 3 kills met a capture at work");
    assert!(kills > 0, "a capture was over before anybody could kill it");
    step(&["capture", text(&killed)]);
    assert_eq!(choice(&killed), chosen);
    assert!(frames(&killed) == frames(&calm), "other frames than without kills");

    // A choice that the pictures would not lead to is kept to.
    let told = session_with(&calm, "told", &[]);
    std::fs::remove_dir_all(told.join("frames/held-full")).unwrap();
    let other = serde_json::json!([0.0333334, 2.7]);
    assert_ne!(chosen["choice"]["exposures_s"], other);
    let mut file = chosen.clone();
    file["choice"]["exposures_s"] = other;
    std::fs::write(told.join("exposures.json"), file.to_string()).unwrap();
    let refused = diaphane(["capture", text(&told)]);
    // Frames of the other patterns are there, at the exposures that were chosen first.
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.stderr.contains("multiplexed-02"), "{}", refused.stderr);

    let (merged, _) = step(&["merge", text(&calm)]);
    assert_eq!(merged["patterns"], 8);
    mixtures_come_to_the_whole(&calm);

    // What was changed by hand, or damaged, is named.
    set(&told, "bracket_s", "[0.0333334, 0.9, 2.7]");
    let refused = diaphane(["status", text(&told)]);
    assert!(refused.code == 2 && refused.stderr.contains("exposures.json"), "{}", refused.stderr);
    set(&told, BRACKET.0, BRACKET.1);
    set(&told, "regions", "[2, 1]");
    let refused = diaphane(["plan", text(&told)]);
    assert!(refused.code == 2 && refused.stderr.contains("first pattern"), "{}", refused.stderr);
    std::fs::write(told.join("exposures.json"), "{").unwrap();
    let refused = diaphane(["merge", text(&told)]);
    assert!(refused.code == 2 && refused.stderr.contains("exposures.json"), "{}", refused.stderr);
}

/// A narrow stripe at the face's edge comes first; where all of the face is lit it is several
/// times as bright, more than the head-room.
fn a_brighter_pattern_gets_shorter_exposures(base: &Path) {
    let settings = [ADAPTIVE, ("regions", "[10, 1]"), ("bracket_s", "[0.05, 0.45, 2.0]")];
    let session = session_with(base, "brighter", &settings);
    let (_, told) = step(&["capture", text(&session)]);
    assert!(told.contains("held-full") && told.contains("are clipped at"), "{told}");
    let chosen = choice(&session);
    assert_eq!(chosen["choice"]["exposures_s"], serde_json::json!([0.45, 2.0]), "{chosen}");
    assert_eq!(chosen["extended_s"]["held-full"], serde_json::json!([0.05]), "{chosen}");
    assert!(chosen["extended_s"].get("region-02").is_none(), "{chosen}");
    assert!(session.join("frames/held-full/held-full-e2-r0.png").is_file());
    assert!(!session.join("frames/region-02/region-02-e2-r0.png").exists());
    assert_eq!(step(&["capture", text(&session)]).0["taken"], 0);
    // No cell of any pattern is masked: each has an exposure that fits it.
    step(&["merge", text(&session)]);
    let mut arrays =
        material::npz::NpzReader::open(&session.join("measurement/measurement.npz")).unwrap();
    let variance = arrays.shaped("variance", &[15, 3, 40, 40]).unwrap();
    let masked = variance.iter().filter(|v| !v.is_finite()).count();
    assert_eq!(masked, 0);
}

/// Light adds up: of three regions each is in two of three mixtures, so these come to twice the
/// face lit as a whole.
fn mixtures_come_to_the_whole(session: &Path) {
    let mut arrays =
        material::npz::NpzReader::open(&session.join("measurement/measurement.npz")).unwrap();
    let mut maps = |name: &str| -> Vec<Vec<f64>> {
        let values = arrays.shaped(name, &[8, 3, 40, 40]).unwrap();
        values.chunks(3 * 1600).map(<[f64]>::to_vec).collect()
    };
    let (radiance, variance) = (maps("radiance"), maps("variance"));
    let found =
        rig::SMatrix::for_regions(3).demultiplex(&radiance[..3], &variance[..3], 3).unwrap();
    let whole = &radiance[3];
    let peak = whole.iter().copied().fold(0.0, f64::max);
    for (i, whole) in whole.iter().enumerate() {
        let sum: f64 = found.values.iter().map(|region| region[i]).sum();
        // The noise of 3 regions and of the whole; and what a projector pixel on an edge of a
        // region is rounded by, 1/255 of a pixel that is a hundredth of a region's width.
        let noise = (3.0 * found.variance[i] + variance[3][i]).sqrt();
        let bound = 5.0 * noise + 1e-3 * peak;
        assert!((sum - whole).abs() < bound, "cell {i}: {sum}, {whole} of {peak}, noise {noise}");
    }
}

#[test]
fn impossible_plans_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("front");
    let run = diaphane(["init", text(&session), "--lit", "front", "--scheme", "multiplexed"]);
    assert_eq!(run.code, 2);
    assert!(run.stderr.contains("lit from the back"), "{}", run.stderr);
    assert!(!session.exists());
    let run = diaphane(["init", text(&session), "--brackets", "clever"]);
    let error = run.json["error"].as_str().unwrap();
    assert!(run.code == 2 && error.contains("adaptive"), "{error}");
}

/// The figures that the plans are chosen by, on few cells: the gain of an S-matrix of order 19
/// where the camera's own noise rules, 2 √19/20, and what the merge tells of its noise.
#[test]
fn a_study_tells_time_and_noise_of_each_plan() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("study");
    let (study, _) = step(&["study", "plans", "--out", text(&out), "--step", "8"]);
    let rows = study["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 8 * 5);
    let find = |level: f64, camera: bool, plan: &str| {
        let same = |r: &&Value| {
            r["light"]["level"] == level
                && r["light"]["camera_noise"] == camera
                && r["plan"] == plan
        };
        rows.iter().find(same).unwrap()
    };
    let all = |row: &Value, key: &str| row[key][3].as_f64().unwrap();
    let dim = find(1e-6, true, "multiplexed");
    // 16 regions of 7500 samples tell each of two standard deviations to 0.2 %; 1.5 % is five.
    let expected = 2.0 * 19f64.sqrt() / 20.0;
    let gain = all(dim, "pixel_over_plain");
    assert!((gain / expected - 1.0).abs() < 0.015, "{gain}, expected {expected}");
    assert!(all(dim, "equal_time_over_plain") < 0.5, "{dim}");
    // Photons take it back, and most where it is dark.
    let bright = find(1.0, false, "multiplexed");
    assert!(all(bright, "pixel_over_plain") > 1.5, "{bright}");
    let dark = bright["pixel_over_plain"][2].as_f64().unwrap();
    assert!(dark > 5.0 * bright["pixel_over_plain"][0].as_f64().unwrap(), "{bright}");
    let adaptive = find(1.0, true, "adaptive");
    assert!(adaptive["time_over_plain"].as_f64().unwrap() < 1.0 / 3.0, "{adaptive}");
    for row in rows {
        // Right to a few hundredths; the merge's own tests have it closer. Where nothing is read
        // out with noise, dark pixels count single photons, far from the merge's normal law.
        let told = row["noise"]["told"].as_f64().unwrap();
        let bound = if row["light"]["camera_noise"] == true { 0.02 } else { 0.06 };
        assert!((told - 1.0).abs() < bound, "{row}");
        // What the choice promises, and the 0.5 % that a ratio of so few cells is known to.
        if row["plan"] == "adaptive" {
            let cells = row["cell_over_plain"].as_array().unwrap();
            let worst = cells.iter().map(|c| c.as_f64().unwrap()).fold(0.0, f64::max);
            assert!(worst < 1.07, "{row}");
        }
    }
    let csv = std::fs::read_to_string(out.join("plans.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + rows.len());
    let columns = csv.lines().next().unwrap().split(',').count();
    // The plan's name is quoted and may hold a comma.
    let counts = csv.lines().skip(1).map(|l| l.replace(", ", " ").split(',').count());
    assert!(counts.into_iter().all(|n| n == columns), "{csv}");
    let svg = std::fs::read_to_string(out.join("plans.svg")).unwrap();
    assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    let again = diaphane(["study", "plans", "--out", text(&out), "--step", "8"]);
    assert!(again.code == 2 && again.stderr.contains("--force"), "{}", again.stderr);
}
