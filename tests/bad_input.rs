//! What people get wrong ends in a clear error: exit code 2, the file's name, the way out, and
//! nothing overwritten.

mod common;

use common::{Run, diaphane};
use std::path::Path;
use tempfile::{TempDir, tempdir};

/// A refusal: exit code 2, with an error that tells all of `told`.
#[track_caller]
fn refused(run: &Run, told: &[&str]) {
    assert_eq!(run.code, 2, "{}", run.stderr);
    let error = run.json["error"].as_str().expect("a key `error`");
    assert!(run.json.get("hint").is_some(), "a key `hint`: {}", run.json);
    for word in told {
        assert!(error.contains(word), "{error:?} does not tell {word:?}");
    }
}

/// As [`refused`], with a way out.
#[track_caller]
fn refused_with_hint(run: &Run, told: &[&str], hint: &str) {
    refused(run, told);
    let found = run.json["hint"].as_str().unwrap_or_default();
    assert!(found.contains(hint), "hint {found:?} does not tell {hint:?}");
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A session without pictures.
fn fresh() -> (TempDir, String) {
    let folder = tempdir().unwrap();
    let session = text(&folder.path().join("wax")).to_owned();
    assert_eq!(diaphane(["init", &session]).code, 0);
    (folder, session)
}

fn flat_png(path: &Path, level: u8) {
    image::GrayImage::from_pixel(64, 48, image::Luma([level])).save(path).unwrap();
}

#[test]
fn wrong_usage() {
    refused_with_hint(&diaphane(["solvee"]), &["solvee"], "--help");
    refused_with_hint(&diaphane(["solve"]), &["SESSION"], "--help");
    refused_with_hint(&diaphane(["solve", "a", "--lambda", "many"]), &["many"], "--help");
    refused_with_hint(&diaphane(["merge", "a", "--images", "b"]), &["--images"], "--help");
    let (_folder, session) = fresh();
    refused(
        &diaphane(["calibrate", "camera", "--images", &session, "--board", "9", "--square", "25"]),
        &["9"],
    );
    refused(
        &diaphane([
            "calibrate",
            "camera",
            "--images",
            &session,
            "--board",
            "9x6",
            "--square",
            "-1",
        ]),
        &["-1"],
    );
}

#[test]
fn folders_that_are_empty_or_not_there() {
    let folder = tempdir().unwrap();
    let empty = text(folder.path());
    let camera = |images: &str| {
        diaphane(["calibrate", "camera", "--images", images, "--board", "9x6", "--square", "25"])
    };
    refused(&camera(empty), &[empty]);
    refused(&diaphane(["merge", "--images", empty]), &[empty]);
    let none = text(&folder.path().join("none")).to_owned();
    refused(&camera(&none), &["none"]);
    for command in ["status", "plan", "capture", "solve", "verify", "export", "report", "doctor"] {
        refused_with_hint(&diaphane([command, &none]), &["session.toml"], "diaphane init");
    }
}

#[test]
fn pictures_that_are_damaged() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("cut.png");
    flat_png(&path, 100);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let images = text(folder.path());
    refused(
        &diaphane(["calibrate", "camera", "--images", images, "--board", "9x6", "--square", "25"]),
        &["cut.png"],
    );
    let table = folder.path().join("times.txt");
    std::fs::write(&table, "cut.png 0.5\n").unwrap();
    refused(&diaphane(["merge", "--images", images, "--exposures", text(&table)]), &["cut.png"]);
}

#[test]
fn boards_that_nobody_sees() {
    let folder = tempdir().unwrap();
    for i in 0..4 {
        flat_png(&folder.path().join(format!("{i}.png")), 100 + i);
    }
    let run = diaphane([
        "calibrate",
        "camera",
        "--images",
        text(folder.path()),
        "--board",
        "9x6",
        "--square",
        "25",
    ]);
    refused(&run, &["3", "0"]);
    assert!(run.stderr.contains("0.png"), "each picture without a board is named: {}", run.stderr);
}

#[test]
fn brackets_that_cannot_be_merged() {
    let folder = tempdir().unwrap();
    flat_png(&folder.path().join("a.png"), 100);
    let images = text(folder.path()).to_owned();
    let output = tempdir().unwrap();
    let exr = output.path().join("out.exr");
    let table = output.path().join("times.txt");
    let merge = || {
        diaphane([
            "merge",
            "--images",
            &images,
            "--exposures",
            text(&table),
            "--output",
            text(&exr),
        ])
    };
    // PNG has no EXIF: the way out is a table.
    refused_with_hint(&diaphane(["merge", "--images", &images]), &["a.png"], "--exposures");
    std::fs::write(&table, "a.png 0.5\n").unwrap();
    refused(&merge(), &["two", "1"]);
    flat_png(&folder.path().join("b.png"), 200);
    refused_with_hint(&merge(), &["b.png"], "b.png SECONDS");
    std::fs::write(&table, "a.png 0.5\nb.png 0.5\n").unwrap();
    refused(&merge(), &["0.5"]);
    std::fs::write(&table, "a.png 0.5\nb.png soon\n").unwrap();
    refused(&merge(), &["times.txt", "line 2", "soon"]);
    assert!(!exr.exists());
}

#[test]
fn sessions_of_another_time() {
    let (_folder, session) = fresh();
    let path = Path::new(&session).join("session.toml");
    let good = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, good.replacen("version = 1", "version = 99\nmood = \"new\"", 1)).unwrap();
    refused_with_hint(&diaphane(["status", &session]), &["session.toml", "99", "newer"], "update");
    std::fs::write(&path, good.replacen("eta = ", "etta = ", 1)).unwrap();
    refused(&diaphane(["status", &session]), &["session.toml", "etta"]);
    std::fs::write(&path, &good[..good.len() / 2]).unwrap();
    refused(&diaphane(["status", &session]), &["session.toml"]);
}

#[test]
fn steps_that_were_left_out() {
    let (_folder, session) = fresh();
    let told = |run: Run, file: &str, command: &str| {
        refused_with_hint(&run, &[file, "not there yet"], &format!("{command} {session}"));
    };
    told(diaphane(["merge", &session]), "calibration.json", "diaphane calibrate all");
    told(diaphane(["solve", &session]), "measurement.npz", "diaphane merge");
    told(diaphane(["export", &session]), "material.diaphane", "diaphane solve");
    let status = diaphane(["status", &session]);
    assert_eq!(status.json["next"]["command"], format!("diaphane calibrate all {session}"));
    // A report tells what there is.
    let report = diaphane(["report", &session]);
    assert_eq!(report.code, 0, "{}", report.stderr);
    assert!(report.json["missing"].as_array().unwrap().len() > 3);
    let page = std::fs::read_to_string(Path::new(&session).join("report/report.html")).unwrap();
    assert!(page.contains("not finished") && page.contains("diaphane calibrate all"));
}

#[test]
fn damaged_materials() {
    let (_folder, session) = fresh();
    let material = Path::new(&session).join("material/material.diaphane");
    std::fs::create_dir_all(material.parent().unwrap()).unwrap();
    for content in [&b""[..], b"no material", &[0; 4096]] {
        std::fs::write(&material, content).unwrap();
        refused(&diaphane(["export", &session]), &["material.diaphane"]);
        refused(&diaphane(["report", &session]), &["material.diaphane"]);
        let doctor = diaphane(["doctor", &session]);
        assert_eq!((doctor.code, &doctor.json["ready"]), (1, &false.into()), "{}", doctor.stderr);
        assert!(doctor.json["error"].as_str().unwrap().contains("material.diaphane"));
        assert!(doctor.json["hint"].as_str().unwrap().contains("diaphane solve"));
    }
}

#[test]
fn nothing_finished_is_overwritten() {
    let (_folder, session) = fresh();
    let path = Path::new(&session).join("session.toml");
    let before = std::fs::read(&path).unwrap();
    let again = ["init", &session, "--sample", "stone"];
    refused_with_hint(&diaphane(again), &["session.toml"], "--force");
    assert_eq!(std::fs::read(&path).unwrap(), before);
    assert_eq!(diaphane(again.into_iter().chain(["--force"])).code, 0);
    assert_ne!(std::fs::read(&path).unwrap(), before);

    let page = Path::new(&session).join("report/report.html");
    assert_eq!(diaphane(["report", &session]).code, 0);
    std::fs::write(&page, "mine").unwrap();
    refused_with_hint(&diaphane(["report", &session]), &["report.html"], "--force");
    assert_eq!(std::fs::read(&page).unwrap(), b"mine");
    assert_eq!(diaphane(["report", &session, "--force"]).code, 0);
    assert_ne!(std::fs::read(&page).unwrap(), b"mine");
    refused_with_hint(&diaphane(["demo", "--out", &session]), &["another session"], "--out");
}

#[test]
fn what_is_given_is_judged_before_the_work_and_told_as_it_is() {
    let folder = tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    // Nothing to read a colour from; a place left of the picture.
    refused_with_hint(&diaphane(["calibrate", "colour"]), &["ColorChecker"], "--image");
    flat_png(&folder.path().join("chart.png"), 90);
    let chart = at("chart.png");
    let outside =
        ["calibrate", "colour", "--image", &chart, "--chart", "-10,5", "5,6", "7,8", "9,10"];
    refused(&diaphane(outside), &["chart.png"]);
    // A result that could not be written.
    let response = ["calibrate", "response", "--images", &at("none"), "--output", &at("no/r.json")];
    refused_with_hint(&diaphane(response), &["r.json", "folder"], "mkdir");
    // Files that are there, and folders, are told before pictures that are not.
    let onto = |file: &str| {
        let images = at("none");
        diaphane(["calibrate", "response", "--images", &images, "--output", file])
    };
    refused_with_hint(&onto(&chart), &["chart.png"], "--force");
    refused_with_hint(&onto(text(folder.path())), &[text(folder.path())], "--force");
    let forced = ["calibrate", "response", "--images", &at("none"), "--force", "--output"];
    let run = diaphane(forced.into_iter().chain([text(folder.path())]));
    refused_with_hint(&run, &["expected a file", "folder"], "name a file");
    // One exposure time under several names.
    let bracket = folder.path().join("bracket");
    std::fs::create_dir(&bracket).unwrap();
    for (name, level) in [("a.png", 40), ("b.png", 80)] {
        flat_png(&bracket.join(name), level);
    }
    std::fs::write(at("times.txt"), "a.png 0.1\nb.png 0.1\n").unwrap();
    for command in [&["calibrate", "response"][..], &["merge"]] {
        let rest = ["--images", text(&bracket), "--exposures", &at("times.txt")];
        let run = diaphane(command.iter().copied().chain(rest));
        refused_with_hint(&run, &["a.png", "b.png", "0.1"], "--exposures");
    }
    // A view whose points are in another order than the board's.
    let place = |i: usize| [(i % 7) as f64, (i / 7) as f64];
    let line = |[x, y]: [f64; 2]| format!("{x} {y}\n");
    let list = |order: &dyn Fn(usize) -> usize, slant: f64| -> String {
        let seen = |i: usize| {
            let [x, y] = place(order(i)).map(|v| 30.0 * v);
            let below = 1.0 + slant * x;
            line([100.0 + x / below, 80.0 + y / below])
        };
        (0..35).map(seen).collect()
    };
    std::fs::write(at("plane.txt"), (0..35).map(|i| line(place(i))).collect::<String>()).unwrap();
    for (i, slant) in [1e-3, -1e-3, 5e-4].into_iter().enumerate() {
        std::fs::write(at(&format!("v{i}.txt")), list(&|i| i, slant)).unwrap();
    }
    // 35 and 11 have no factor in common: every point once.
    std::fs::write(at("v1.txt"), list(&|i| 11 * i % 35, 1e-3)).unwrap();
    let (plane, views) = (at("plane.txt"), [0, 1, 2].map(|i| at(&format!("v{i}.txt"))));
    let points = ["calibrate", "camera", "--points", &views[0], &views[1], &views[2]];
    let run = diaphane(points.into_iter().chain(["--plane", &plane, "--size", "640x480"]));
    refused(&run, &["v1.txt", "order"]);
}

/// Folders and sessions to read that are not there: nothing to make, but a name to mend.
#[test]
fn hints_lead_somewhere() {
    let folder = tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    let none = at("none");
    for command in [
        &["merge", "--images", &none][..],
        &["calibrate", "noise", "--flats", &none, "--darks", &none],
        &["calibrate", "response", "--images", &none],
    ] {
        let run = diaphane(command);
        refused_with_hint(&run, &["none", "no such folder"], "names the folder");
        assert!(!run.stderr.contains("mkdir"), "{}", run.stderr);
    }
    refused_with_hint(&diaphane(["merge"]), &["SESSION", "--images"], "diaphane merge my-wax");
    let run = diaphane(["calibrate", "noise"]);
    refused_with_hint(&run, &["SESSION", "--flats"], "diaphane calibrate noise my-wax");
    refused_with_hint(
        &diaphane(["init", &at("a"), "--light", &none]),
        &["--light", "none"],
        "name a",
    );
    assert!(!folder.path().join("a").exists());
    let (_other, session) = fresh();
    let past = diaphane(["plan", &session, "--past", &none]);
    refused_with_hint(&past, &["--past", "none"], "name sessions");

    // The session before the picture; and devices that a rig file does not have as `init` says it.
    let taken = at("taken.png");
    flat_png(Path::new(&taken), 1);
    let run = diaphane(["preview", &none, "--once", "--picture", &taken]);
    refused_with_hint(&run, &["none", "session"], "diaphane init");
    let bare = at("rig.toml");
    std::fs::write(&bare, "version = 1\n[projector.display]\ndriver = \"simulated\"\n").unwrap();
    let run = diaphane(["preview", &bare, "--once", "--picture", &at("b.png")]);
    refused_with_hint(&run, &["rig.toml", "[camera]"], "docs/devices.md");
    let run = diaphane(["preview", &session, "--once", "--picture", &at("b.jpg")]);
    refused_with_hint(&run, &["b.jpg", "PNG"], "b.png");
    assert!(!folder.path().join("b.jpg").exists());

    // Numbers may be negative, and what is wrong with them is told.
    refused(&diaphane(["preview", &session, "--exposure", "-1"]), &["positive", "-1"]);
    refused(&diaphane(["preview", &session, "--every", "-2"]), &["seconds", "-2"]);
    let manifest = at("m.toml");
    std::fs::write(&manifest, "[sample").unwrap();
    let import = ["import", &at("s"), "--images", text(folder.path()), "--manifest", &manifest];
    refused_with_hint(&diaphane(import), &["m.toml"], "import --help");

    let (plan, told) = {
        let run = diaphane(["plan", &session]);
        (run.json, run.stderr)
    };
    assert_eq!(plan["parts"][1]["placements"], 1);
    assert!(told.contains(", 1 placement,"), "{told}");
}

/// The simulated sample's photons: `init --transport` writes them down, and what nobody can follow
/// is refused by every command that opens the session.
#[test]
fn photons_in_session_toml() {
    let folder = tempdir().unwrap();
    let session = text(&folder.path().join("wax")).to_owned();
    assert_eq!(diaphane(["init", &session, "--transport", "monte-carlo"]).code, 0);
    let file = folder.path().join("wax/session.toml");
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written.contains("[rig.transport.monte-carlo]"), "{written}");
    assert_eq!(diaphane(["plan", &session]).code, 0);
    for (line, told) in [
        ("photons = 3", ["rig.transport", "at least 64", "3"]),
        ("photons = 900000000000", ["rig.transport", "at most", "900000000000"]),
        ("photons = -1", ["session.toml", "u64", "-1"]),
        ("photons = 1000\nanisotropy = 1.0", ["rig.transport", "-1 and 1", "found 1"]),
        ("colour = 1", ["session.toml", "colour", "photons"]),
    ] {
        let mut lines: Vec<&str> = Vec::new();
        for known in written.lines() {
            match known.split_once(" = ").map(|(key, _)| key) {
                Some("photons") => lines.push(line),
                Some("anisotropy") => {}
                _ => lines.push(known),
            }
        }
        std::fs::write(&file, lines.join("\n")).unwrap();
        refused(&diaphane(["plan", &session]), &told);
    }
    refused_with_hint(
        &diaphane(["init", &session, "--transport", "magic"]),
        &["magic", "monte-carlo"],
        "--help",
    );
}
