//! What `status`, `doctor`, `report` and the steps say of results that do not go together any more.

mod common;

use calibration::{HdrImage, write_exr};
use common::{Run, diaphane, tiny_session};
use material::Overwrite;
use serde_json::Value;
use std::path::Path;

#[track_caller]
fn well(args: &[&str]) -> Run {
    let run = diaphane(args);
    assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
    run
}

/// The state of a step and the remark on it.
#[track_caller]
fn step(session: &str, name: &str) -> (String, String) {
    let status = well(&["status", session]).json;
    let steps = status["steps"].as_array().unwrap();
    let step = steps.iter().find(|s| s["name"] == name).unwrap();
    assert_eq!(step["done"], step["state"] == "done", "{step}");
    let text = |key: &str| step[key].as_str().unwrap_or_default().to_owned();
    (text("state"), text("remark"))
}

#[track_caller]
fn expect(session: &str, name: &str, state: &str, remark: &str) {
    let (found, told) = step(session, name);
    assert!(found == state && told.contains(remark), "{name}: {found}, {told:?}");
}

/// The command that `status` says comes next, as arguments.
fn next(session: &str) -> Vec<String> {
    let status = well(&["status", session]).json;
    let command = status["next"]["command"].as_str().unwrap_or_default();
    command.split(' ').skip(1).map(str::to_owned).collect()
}

/// Gives what comes next until nothing does.
fn catch_up(session: &str) {
    for _ in 0..8 {
        let next = next(session);
        if next.is_empty() {
            return;
        }
        let run = diaphane(&next);
        assert_eq!(run.code, 0, "{next:?}: {}", run.stderr);
    }
    panic!("there is always something next: {:?}", next(session));
}

fn edit(file: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{from:?} in {text}");
    std::fs::write(file, text.replacen(from, to, 1)).unwrap();
}

/// Pictures that a block of 8 × 8 × 3 cells might have under four regions and all of its face; the
/// solve gets as far with them as this needs.
fn pictures(folder: &Path, brightness: f64) {
    let mut manifest = String::from(
        "[sample]\nname = \"small\"\nsize_mm = [4.0, 4.0, 1.5]\ncells = [8, 8, 3]\nlit_face = \"back\"\neta = 1.4\n",
    );
    for m in 0..5_u8 {
        let spot = |x: f64, y: f64, i: u8| {
            let [cx, cy] = [f64::from(i % 2) * 4.0 + 1.5, f64::from(i / 2) * 4.0 + 1.5];
            0.05 * brightness * (-((x - cx).powi(2) + (y - cy).powi(2)) / 12.0).exp()
        };
        let value = |i: usize| {
            let (x, y) = ((i % 8) as f64, (i / 8) as f64);
            let lit = if m < 4 { m..m + 1 } else { 0..4 };
            lit.map(|region| spot(x, y, region)).sum::<f64>() as f32
        };
        let image = HdrImage {
            width: 8,
            height: 8,
            channels: 1,
            radiance: (0..64).map(value).collect(),
            variance: vec![1e-8; 64],
            variance_known: true,
            clipped_shortest: 0,
            lost_longest: 0,
        };
        write_exr(folder.join(format!("{m}.exr")), &image, Overwrite::Replace).unwrap();
        let light = match m {
            4 => "held_out = true\nrectangles = [{ x0 = 0.0, y0 = 0.0, x1 = 1.0, y1 = 1.0, level = 1.0 }]".into(),
            m => format!("region = {{ columns = 2, rows = 2, index = {m} }}"),
        };
        manifest += &format!("[[pattern]]\nname = \"p{m}\"\nimage = \"{m}.exr\"\n{light}\n");
    }
    std::fs::write(folder.join("m.toml"), manifest).unwrap();
}

const SOLVE: [&str; 4] = ["--max-evaluations", "4", "--device", "cpu"];

/// From the measurement on: every result knows what it was made from.
#[test]
fn results_of_another_material_or_measurement_are_out_of_date() {
    let folder = tempfile::tempdir().unwrap();
    pictures(folder.path(), 1.0);
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (session, images, manifest) = (path("small"), path(""), path("m.toml"));
    let session = session.as_str();
    let import = ["import", session, "--images", &images, "--manifest", &manifest];
    well(&import);
    // A report of what there is so far does not stay the last word.
    well(&["report", session]);
    assert_eq!(step(session, "report").0, "done");
    let solved = well(&[&["solve", session][..], &SOLVE].concat());
    expect(session, "report", "out-of-date", "without the material");

    // The cut is told everywhere.
    assert_eq!(solved.json["converged"], false, "{}", solved.json);
    assert!(solved.stderr.contains("did not converge"), "{}", solved.stderr);
    expect(session, "material", "done", "did not converge: --max-evaluations cut off Y");
    let file = |name: &str| std::fs::read_to_string(Path::new(session).join(name)).unwrap();
    let convergence: Value = serde_json::from_str(&file("material/convergence.json")).unwrap();
    assert_eq!(convergence["channels"][0]["cut_off"], true);
    assert_eq!(next(session), ["verify", session]);
    well(&["verify", session]);
    well(&["export", session]);
    assert_eq!(next(session), ["report", session, "--force"]);
    catch_up(session);
    let page = || file("report/report.html");
    assert!(page().contains("did not converge") && page().contains("held-out error"));
    assert!(!page().contains("out of date"), "{}", page());
    assert!(diaphane(["doctor", session]).json["ready"] == true);
    let kept = std::fs::read(Path::new(session).join("material/material.diaphane")).unwrap();

    // Another material.
    let again = ["--max-evaluations", "2000", "--lambda", "0.01", "--device", "cpu", "--force"];
    let solved = well(&[&["solve", session][..], &again].concat());
    assert_eq!(solved.json["converged"], true, "{}", solved.json);
    assert!(solved.stderr.contains(&format!("next: diaphane verify {session} --force")));
    for name in ["verification", "export", "report"] {
        expect(session, name, "out-of-date", "another material");
    }
    for command in ["verify", "export", "report"] {
        let refused = diaphane([command, session]);
        let told = |key: &str| refused.json[key].as_str().unwrap_or_default().to_owned();
        assert_eq!(refused.code, 2, "{}", refused.stderr);
        assert!(told("error").contains("made from another material"), "{}", refused.json);
        assert!(told("hint").contains(&format!("diaphane {command} {session} --force")));
    }
    let report = well(&["report", session, "--force"]);
    assert_eq!(report.json["verdict"], Value::Null);
    assert_eq!(report.json["out_of_date"], serde_json::json!(["verification", "export"]));
    assert!(page().contains("made from another material") && !page().contains("held-out error"));
    let doctor = diaphane(["doctor", session]);
    assert!(doctor.code == 0 && doctor.stderr.contains("made from another material"));
    catch_up(session);
    assert!(page().contains("held-out error") && !page().contains("out of date"));
    // The same bytes as before are not another material, whenever they were written.
    let material = Path::new(session).join("material/material.diaphane");
    let now = std::fs::read(&material).unwrap();
    std::fs::write(&material, kept).unwrap();
    expect(session, "verification", "out-of-date", "another material");
    std::fs::write(&material, now).unwrap();
    assert_eq!(step(session, "verification").0, "done");

    // Another measurement: what rests on it, and what rests on that.
    pictures(folder.path(), 1.1);
    well(&[&import[..], &["--force"]].concat());
    expect(session, "measurement", "done", "");
    expect(session, "material", "out-of-date", "another measurement");
    expect(session, "export", "out-of-date", "the material is out of date");
    assert_eq!(next(session), ["solve", session, "--force"]);
    let verify = well(&["verify", session, "--force"]);
    assert!(verify.stderr.contains("warning: the material is out of date"), "{}", verify.stderr);
    well(&[&["solve", session, "--force"][..], &SOLVE].concat());
    catch_up(session);

    // Another block in session.toml; a name is no other block.
    let toml = Path::new(session).join("session.toml");
    edit(&toml, "eta = 1.4", "eta = 1.5");
    expect(session, "material", "out-of-date", "eta");
    edit(&toml, "eta = 1.5", "eta = 1.4");
    edit(&toml, "name = \"small\"", "name = \"tiny\"");
    assert_eq!(step(session, "material").0, "done");
    expect(session, "report", "out-of-date", "another sample");
    edit(&toml, "name = \"tiny\"", "name = \"small\"");
    assert_eq!(next(session), [""; 0]);

    damage(session);
}

/// Files that are cut short or changed count as damaged, in `status` and in `doctor`.
fn damage(session: &str) {
    for (file, name) in [
        ("measurement/measurement.npz", "measurement"),
        ("measurement/measurement.json", "measurement"),
        ("material/material.diaphane", "material"),
        ("material/convergence.json", "material"),
        ("material/verification.json", "verification"),
        ("material/export/mitsuba/sigma_t.vol", "export"),
        ("report/report.html", "report"),
    ] {
        let path = Path::new(session).join(file);
        let good = std::fs::read(&path).unwrap();
        std::fs::write(&path, &good[..good.len() / 2]).unwrap();
        expect(session, name, "damaged", "");
        let command = next(session);
        assert_eq!(command.last().unwrap(), "--force", "{command:?}");
        let doctor = diaphane(["doctor", session]);
        assert_eq!(doctor.code, 1, "{file}: {}", doctor.stderr);
        assert!(doctor.json["error"].as_str().unwrap().starts_with(name), "{}", doctor.json);
        // What it would show is not shown; what is made from it is not made.
        let shown = !matches!(name, "export" | "report");
        let report = diaphane(["report", session, "--force"]);
        assert_eq!(report.code, if shown { 2 } else { 0 }, "{file}: {}", report.stderr);
        assert!(!shown || report.json["hint"].as_str().unwrap().contains("--force"));
        std::fs::write(&path, good).unwrap();
    }
    // A changed byte in an export: `doctor` reads all of it.
    let path = Path::new(session).join("material/export/mitsuba/sigma_t.vol");
    let good = std::fs::read(&path).unwrap();
    let mut bad = good.clone();
    *bad.last_mut().unwrap() ^= 1;
    std::fs::write(&path, &bad).unwrap();
    let doctor = diaphane(["doctor", session]);
    assert!(doctor.code == 1 && doctor.stderr.contains("sigma_t.vol"), "{}", doctor.stderr);
    std::fs::write(&path, good).unwrap();
    assert_eq!(next(session), [""; 0]);
}

/// Up to the measurement: frames that are retaken, changed, of another plan; captures that are cut
/// off.
#[test]
fn frames_of_another_time_and_another_plan_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("wax").display().to_string();
    let session = session.as_str();
    tiny_session(session, &[("bracket_s", "[0.05, 0.8]")], "");
    killed_capture(session);
    well(&["calibrate", "all", session]);
    let extra = well(&["capture", session, "--noise"]);
    let noise = format!("next: diaphane calibrate noise {session}");
    assert!(extra.stderr.contains(&noise), "{}", extra.stderr);
    // That says nothing of the sample's pictures.
    let told = well(&["status", session]).stderr;
    assert!(told.contains("last capture of noise pictures"), "{told}");
    let captured = well(&["capture", session]);
    assert!(captured.stderr.contains(&format!("next: diaphane merge {session}")));
    well(&["merge", session]);
    assert_eq!(step(session, "measurement").0, "done");

    // A frame that was changed is not merged; taken again as it was, nothing is out of date.
    let frame = Path::new(session).join("frames/region-01/region-01-e0-r0.png");
    let good = std::fs::read(&frame).unwrap();
    std::fs::write(&frame, &good[..good.len() / 2]).unwrap();
    let refused = diaphane(["merge", session, "--force"]);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(refused.json["error"].as_str().unwrap().contains("region-01-e0-r0.png"));
    assert!(refused.json["hint"].as_str().unwrap().contains("diaphane capture"));
    well(&["capture", session]);
    assert_eq!(step(session, "measurement").0, "done");
    // Taken again and another one now, as its journal says: this room was lit.
    let journal = Path::new(session).join("journal.jsonl");
    let before = std::fs::read(&journal).unwrap();
    journal_says(&journal, "frames/region-01/region-01-e0-r0.png");
    expect(session, "measurement", "out-of-date", "other pictures (frames/region-01/");
    let captured = diaphane(["merge", session]);
    assert!(captured.json["hint"].as_str().unwrap().contains("merge") && captured.code == 2);
    assert_eq!(next(session), ["merge", session, "--force"]);
    std::fs::write(&journal, before).unwrap();

    // The plan is another one now.
    let toml = Path::new(session).join("session.toml");
    edit(&toml, "bracket_s = [0.05, 0.8]", "bracket_s = [0.05, 0.9]");
    expect(session, "sample pictures", "out-of-date", "of another plan");
    expect(session, "measurement", "out-of-date", "the sample pictures are out of date");
    let branch = format!("{session}-2");
    assert_eq!(next(session), ["branch", session, &branch]);
    let doctor = diaphane(["doctor", session]);
    assert!(doctor.stderr.contains("of another plan"), "{}", doctor.stderr);
    for command in [&["capture", session][..], &["merge", session, "--force"]] {
        let refused = diaphane(command);
        let hint = refused.json["hint"].as_str().unwrap_or_default();
        assert!(refused.code == 2 && hint.contains("session.toml"), "{}", refused.stderr);
        assert!(hint.contains(&format!("diaphane branch {session} {branch}")), "{hint}");
    }
    let refused = diaphane(["branch", session, session]);
    let hint = refused.json["hint"].as_str().unwrap();
    assert!(refused.code == 2 && hint.contains(&branch) && !hint.contains("--force"), "{hint}");
    well(&["branch", session, &branch]);
    let told = well(&["status", &branch]);
    assert_eq!(told.json["capture_cut_off"], false, "{}", told.stderr);
    assert_eq!(next(&branch), ["capture", branch.as_str()]);

    // Another board, and more poses: the calibration is to be made anew, and everything after it.
    edit(&toml, "bracket_s = [0.05, 0.9]", "bracket_s = [0.05, 0.8]");
    edit(&toml, "square_mm = 1.4", "square_mm = 1.5");
    expect(session, "calibration", "out-of-date", "another board");
    expect(session, "measurement", "out-of-date", "the calibration is out of date");
    assert_eq!(next(session), ["calibrate", "all", session, "--force"]);
    edit(&toml, "square_mm = 1.5", "square_mm = 1.4");
    edit(&toml, "board_poses = 6", "board_poses = 7");
    assert_eq!(step(session, "calibration pictures").0, "missing");
    assert_eq!(next(session), ["calibrate", "all", session, "--force"]);
}

/// Adds a line to the journal: the frame was taken again, and has other content.
fn journal_says(path: &Path, frame: &str) {
    let (mut journal, recorded) = rig::Journal::open(path).unwrap();
    let last = recorded
        .entries
        .into_iter()
        .rev()
        .map(|entry| entry.event)
        .find(|event| matches!(event, rig::Event::FrameWritten { file, .. } if file == frame));
    let Some(rig::Event::FrameWritten {
        shot,
        exposure_index,
        repeat,
        file,
        settings,
        requested_s,
        exposure_s,
        device,
        stats,
        ..
    }) = last
    else {
        panic!("{frame} is not in the journal");
    };
    let blake3 = "0".repeat(64);
    let event = rig::Event::FrameWritten {
        shot,
        exposure_index,
        repeat,
        file,
        blake3,
        settings,
        requested_s,
        exposure_s,
        device,
        stats,
    };
    journal.append(event).unwrap();
}

/// Kills a capture at work: while it runs it is running, and after that it was cut off.
fn killed_capture(session: &str) {
    let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_diaphane"))
        .args(["capture", session])
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let journal = Path::new(session).join("journal.jsonl");
    let lines = || std::fs::read(&journal).map_or(0, |b| b.iter().filter(|&&b| b == b'\n').count());
    let began = std::time::Instant::now();
    while lines() < 3 {
        assert!(began.elapsed().as_secs() < 120, "no line in two minutes");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let running = well(&["status", session]);
    let other = diaphane(["capture", session]);
    let ended = child.try_wait().unwrap().is_some();
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!ended, "the capture was over before anybody could look at it");
    assert_eq!(running.json["capture_running"], true, "{}", running.stderr);
    assert!(running.stderr.contains("is running"), "{}", running.stderr);
    assert!(other.code == 2 && other.json["hint"].as_str().unwrap().contains("status"));
    let after = well(&["status", session]);
    assert_eq!(after.json["capture_cut_off"], true, "{}", after.stderr);
    assert!(after.stderr.contains("was cut off") && !after.stderr.contains("every frame"));
}
