//! The studies that make the paper's figures again, on a few cells.

mod common;

use common::{Run, diaphane};
use serde_json::Value;
use std::path::Path;

/// On the CPU, so that the same command gives the same bytes.
fn study(out: &Path, arguments: &[&str]) -> Run {
    let fixed = ["--device", "cpu", "--out", out.to_str().unwrap()];
    diaphane([&["study"], arguments, &fixed].concat())
}

/// A run that has to go well: table and drawing are there and whole, nothing else.
fn done(out: &Path, arguments: &[&str]) -> Value {
    let run = study(out, arguments);
    assert_eq!(run.code, 0, "{arguments:?}: {}", run.stderr);
    let name = arguments[0];
    let csv = std::fs::read_to_string(out.join(name).with_extension("csv")).unwrap();
    let columns = csv.lines().next().unwrap().split(',').count();
    assert!(csv.lines().all(|line| line.split(',').count() == columns), "{csv}");
    assert_eq!(csv.lines().count(), 1 + run.json["rows"].as_array().unwrap().len(), "{csv}");
    let svg = std::fs::read_to_string(out.join(name).with_extension("svg")).unwrap();
    // Pictures are base64, in which any word may stand.
    let drawn: String = svg.split("base64,").map(|s| s.split_once('"').unwrap().1).collect();
    assert!(svg.ends_with("</svg>\n") && !drawn.contains("NaN") && !drawn.contains("inf"), "{svg}");
    assert!(!out.join(format!("{name}.partial.jsonl")).exists());
    run.json
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key}: {row}"))
}

const CELLS: [&str; 2] = ["--cells", "12x12x4"];

#[test]
fn more_pictures_make_a_better_material() {
    let folder = tempfile::tempdir().unwrap();
    let command = [&["figure11", "--most", "4"], &CELLS[..]].concat();
    let json = done(folder.path(), &command);
    let rows = json["rows"].as_array().unwrap();
    // Lit from the front, one region alone would leave nothing to look at.
    let expected = (1..=4).map(|n| ("back", n)).chain((2..=4).map(|n| ("front", n)));
    let found = rows.iter().map(|r| (r["lit"].as_str().unwrap(), r["n"].as_u64().unwrap()));
    assert!(found.eq(expected), "{json}");
    let e = |row: usize| number(&rows[row], "e");
    // With one picture nothing tells κ from μ, with 16 all does; without their effect both would
    // have the same E, to a third at most by noise.
    assert!(e(3) < 0.5 * e(0), "{json}");
    // Nor is it better than the true material by more than noise can make it.
    assert!(rows.iter().all(|r| number(r, "e") > 0.1 * number(r, "grid_e")), "{json}");

    let again = study(folder.path(), &command);
    assert!(again.code == 2 && again.stderr.contains("--force"), "{}", again.stderr);
}

#[test]
fn smoothness_is_best_where_the_noise_puts_it() {
    let folder = tempfile::tempdir().unwrap();
    let json = done(folder.path(), &[&["figure13"], &CELLS[..]].concat());
    let rows = json["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 7);
    let lambda = |row: usize| number(&rows[row], "lambda");
    // What is asked for is what is solved with: rounding of one product.
    assert!((lambda(0) / (1e-3 * lambda(3)) - 1.0).abs() < 1e-12, "{json}");
    // A thousand times stronger it explains the pictures worse, a thousand times weaker it follows
    // the noise into κ.
    assert!(number(&rows[6], "fit") > 1.5 * number(&rows[3], "fit"), "{json}");
    assert!(number(&rows[0], "fit") < number(&rows[3], "fit"), "{json}");
    assert!(number(&rows[0], "log_kappa") > 1.2 * number(&rows[3], "log_kappa"), "{json}");
}

#[test]
fn layers_are_compared_and_the_same_seed_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let files = |name: &str, seed: &str| {
        let out = folder.path().join(name);
        let json = done(&out, &[&["figure14", "--seed", seed], &CELLS[..]].concat());
        assert_eq!(json["rows"].as_array().unwrap().len(), 4);
        ["csv", "svg"].map(|e| std::fs::read(out.join("figure14").with_extension(e)).unwrap())
    };
    let first = files("first", "1");
    assert_eq!(first, files("second", "1"));
    assert_ne!(first, files("third", "2"));
}

#[test]
fn the_table_has_the_samples_that_were_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let small = ["table2", "--scale", "10", "--channels", "2", "--samples", "wax-2,wax-1"];
    let json = done(folder.path(), &small);
    let rows = json["rows"].as_array().unwrap();
    let cells = |row: usize| rows[row]["cells"].clone();
    assert_eq!(
        (cells(0), cells(1)),
        (serde_json::json!([13, 5, 4]), serde_json::json!([14, 8, 5]))
    );
    assert_eq!((&rows[0]["lit"], &rows[1]["lit"]), (&"back".into(), &"front".into()));
    let channels = json["channels"].as_array().unwrap();
    let solves = channels.iter().filter(|c| c["sample"] == "wax-1");
    let solves: u64 = solves.map(|c| c["linear_solves"].as_u64().unwrap()).sum();
    assert_eq!(rows[0]["linear_solves"].as_u64().unwrap(), solves);
    assert!(rows.iter().all(|r| r["channels"] == 2 && number(r, "seconds") > 0.0), "{json}");
}

#[test]
fn both_methods_are_followed_to_epsilon_and_on() {
    let folder = tempfile::tempdir().unwrap();
    let json = done(folder.path(), &[&["methods", "--seeds", "2,1,2"], &CELLS[..]].concat());
    let rows = json["rows"].as_array().unwrap();
    let names: Vec<_> =
        rows.iter().map(|r| (r["seed"].as_u64().unwrap(), r["method"].as_str().unwrap())).collect();
    assert_eq!(names, [(1, "paper"), (1, "default"), (2, "paper"), (2, "default")]);
    for row in rows {
        let all = number(row, "fine_solves");
        // Noise of 0.5 % makes 2.5e-5 of it; the grid, whose cells are as wide as the veins, has the
        // rest, a few percent in radiance, squared.
        let true_fit = number(row, "true_fit");
        assert!(2.2e-5 < true_fit && true_fit < 3e-3, "{row}");
        match row["to_epsilon"]["fine_solves"].as_f64() {
            Some(there) => assert!(0.0 < there && there <= all, "{row}"),
            None => assert!(number(row, "fit") > 1e-4, "{row}"),
        }
        if row["method"] == "paper" {
            // It stops as soon as it is there.
            assert!(number(row, "fit") <= 1e-4, "{row}");
            assert_eq!(number(&row["to_epsilon"], "fine_solves"), all);
        }
    }
}

#[test]
fn nonsense_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, told) in [
        (&["figure11", "--cells", "1x4x4"][..], "at least 2 cells"),
        (&["figure11", "--cells", "12x12"], "expected three numbers"),
        (&["figure11", "--cells", "12x12x4", "--most", "13"], "--most: expected at most 12"),
        (&["figure11", "--cells", "200x200x4"], "--cells: expected at most 16000 in a layer"),
        (&["figure14", "--cells", "9999999999999999999x2x2"], "--cells: expected at most 60000000"),
        (&["figure14", "--cells", "99999999999999999999x2x2"], "expected three numbers"),
        (&["figure13", "--cells", "100x100x99999"], "--cells: expected at most 60000000"),
        (&["table2", "--scale", "0"], "--scale: expected 1 to 10"),
        (&["table2", "--scale", "NaN"], "--scale: expected 1 to 10"),
        (&["table2", "--samples", "jade"], "jade"),
        (&["methods", "--noise", "-1"], "--noise: expected 0 to 0.5"),
        (&["methods", "--seeds", ""], "--seeds"),
    ] {
        let run = study(folder.path(), arguments);
        assert_eq!(run.code, 2, "{arguments:?}: {}", run.stderr);
        let error = run.json["error"].as_str().unwrap();
        assert!(error.contains(told), "{arguments:?}: {error}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Interrupted after its first row, a study leaves that row and no table, goes on from there, and
/// ends with the figures of an undisturbed one.
#[cfg(unix)]
#[test]
fn an_interrupted_study_goes_on_where_it_was() {
    use std::process::{Command, Stdio};
    let folder = tempfile::tempdir().unwrap();
    let [out, calm] = ["out", "calm"].map(|name| folder.path().join(name));
    // Rows that take long enough to be caught at.
    let command = ["figure11", "--most", "6", "--cells", "16x16x6"];
    let child = Command::new(env!("CARGO_BIN_EXE_diaphane"))
        .arg("study")
        .args(command)
        .args(["--device", "cpu", "--out", out.to_str().unwrap()])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let partial = out.join("figure11.partial.jsonl");
    while !partial.exists() {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
    let ended = child.wait_with_output().unwrap();
    let told = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(1), "{told}");
    assert!(told.contains("interrupted") && told.contains("kept in"), "{told}");
    let left: Vec<_> = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left, ["figure11.partial.jsonl"]);
    let kept = std::fs::read_to_string(&partial).unwrap();
    let first: Value = serde_json::from_str(kept.lines().nth(1).unwrap()).unwrap();

    let other = study(&out, &["figure11", "--cells", "16x16x6", "--seed", "2"]);
    assert!(other.code == 2 && other.stderr.contains("other settings"), "{}", other.stderr);

    let rows = |out: &Path| done(out, &command)["rows"].as_array().unwrap().clone();
    let (resumed, undisturbed) = (rows(&out), rows(&calm));
    // Kept as it was, its time as well.
    assert_eq!(resumed[0], first["row"]);
    let timeless = |rows: Vec<Value>| -> Vec<Value> {
        let without = |mut row: Value| {
            row["seconds"] = Value::Null;
            row
        };
        rows.into_iter().map(without).collect()
    };
    assert_eq!(timeless(resumed), timeless(undisturbed));
}
