//! The program as it is run on a machine that has nothing else.

use serde_json::Value;
use std::process::{Command, Output};

fn bench(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_diaphane-bench")).args(args).output().unwrap()
}

/// Both sets of grids, the smallest: what is printed is what was solved, and the figures belong together.
#[test]
fn figures_belong_together() {
    for (set, cells) in [("--no-inverse", [130, 53, 37]), ("--cubes", [32, 32, 32])] {
        let run = bench(&["--device", "cpu", "--grids", "1", set, "--json"]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let found: Value = serde_json::from_slice(&run.stdout).unwrap();
        assert_eq!(found["device"], "CPU");
        assert!(found["bandwidth_bytes_per_s"].as_f64().unwrap() > 1e8, "{found}");
        let [row] = found["grids"].as_array().unwrap().as_slice() else { panic!("{found}") };
        assert_eq!(row["cells"], serde_json::json!(cells));
        let number = |name: &str| row[name].as_f64().unwrap();
        let unknowns = 16.0 * cells.iter().product::<u64>() as f64;
        let product = number("forward_s") * number("unknowns_rhs_per_s");
        assert!((product / unknowns - 1.0).abs() < 1e-9, "{row}");
        // Multigrid needs some ten; one that has lost its coarse grids needs hundreds.
        assert!((3.0..20.0).contains(&number("iterations")), "{row}");
        assert!(number("gradient_s") > 0.0 && row["inverse"].is_null(), "{row}");
    }
}

/// What cannot be run ends with 2 and says so.
#[test]
fn what_cannot_be_is_said() {
    let cases: [(&[&str], &str); 3] = [
        (&["--device", "gpu:no such adapter"], "no such adapter"),
        (&["--device", "cpu", "--limit", "nan"], "--limit"),
        (&["--grids", "5"], "--grids"),
    ];
    for (args, says) in cases {
        let run = bench(args);
        let stderr = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(says), "{stderr}");
    }
}
