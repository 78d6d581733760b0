//! `diaphane forward` as a user meets it: file in, file out, and errors that name the file.

use material::Overwrite;
use material::npz::{self, NpzReader};
use std::path::Path;
use std::process::{Command, Output};

const CELLS: [usize; 3] = [7, 6, 5];

/// What goes into a problem file; the arrays as (name, shape, values).
type Arrays = Vec<(&'static str, Vec<usize>, Vec<f64>)>;

fn problem(light: &'static str) -> Arrays {
    let [nx, ny, nz] = CELLS;
    let wave = |i: usize| (i as f64 * 0.7).sin();
    let volume = |base: f64| (0..nx * ny * nz).map(|i| base * (1.0 + 0.5 * wave(i))).collect();
    let q = (0..3 * nx * ny).map(|i| 1.0 + wave(i)).collect();
    vec![
        ("kappa", vec![nz, ny, nx], volume(0.4)),
        ("mu", vec![nz, ny, nx], volume(0.02)),
        (light, vec![3, ny, nx], q),
        ("h", vec![], vec![0.5]),
        ("C", vec![], vec![2.1489]),
    ]
}

fn save(path: &Path, arrays: &Arrays) {
    npz::write(path, Overwrite::Replace, |npz| {
        arrays.iter().try_for_each(|(name, shape, data)| npz.array_f64(name, shape, data))
    })
    .unwrap();
}

fn forward(input: &Path, output: &Path, more: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_diaphane"))
        .args(["forward", "--json", "--input"])
        .arg(input)
        .arg("--output")
        .arg(output)
        .args(more)
        .output()
        .unwrap()
}

fn json(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// ‖b − Aφ‖ / ‖b‖, the largest of the three fields, by the scheme as it is published for comparison:
/// inner faces h · 2κaκb/(κa + κb), outer faces h²/(h/(2κ) + 2C), cells μh³.
fn residual(arrays: &Arrays, phi: &[f64], lit_z: usize) -> f64 {
    let [nx, ny, nz] = CELLS;
    let (kappa, mu, q, h, c) =
        (&arrays[0].2, &arrays[1].2, &arrays[2].2, arrays[3].2[0], arrays[4].2[0]);
    let n = nx * ny * nz;
    let mut worst = 0.0f64;
    for m in 0..3 {
        let phi = &phi[m * n..(m + 1) * n];
        let (mut rr, mut bb) = (0.0, 0.0);
        for i in 0..n {
            let at = [i % nx, i / nx % ny, i / (nx * ny)];
            let (mut b, mut product) = (0.0, mu[i] * h.powi(3) * phi[i]);
            for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
                for up in [false, true] {
                    let end = if up { CELLS[axis] - 1 } else { 0 };
                    if at[axis] == end {
                        let g = h * h / (h / (2.0 * kappa[i]) + 2.0 * c);
                        product += g * phi[i];
                        if axis == 2 && at[2] == lit_z {
                            b += g * q[m * nx * ny + i % (nx * ny)];
                        }
                    } else {
                        let j = if up { i + stride } else { i - stride };
                        let t = h * 2.0 * kappa[i] * kappa[j] / (kappa[i] + kappa[j]);
                        product += t * (phi[i] - phi[j]);
                    }
                }
            }
            rr += (b - product).powi(2);
            bb += b * b;
        }
        worst = worst.max((rr / bb).sqrt());
    }
    worst
}

/// The answer satisfies the equations, written out here once more, to the tolerance asked for (and
/// not to a much better one by chance); the radiance of both faces is (C/π) of the outward flux.
#[test]
fn solves_what_the_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("p.npz"), folder.path().join("phi.npz"));
    let [nx, ny, nz] = CELLS;
    for (light, lit_z) in [("q", 0), ("q_front", 0), ("q_back", nz - 1)] {
        let arrays = problem(light);
        save(&input, &arrays);
        let run = forward(&input, &output, &["--rtol", "1e-9", "--force"]);
        assert!(run.status.success(), "{run:?}");
        let said = json(&run);
        for key in ["seconds", "iterations", "unknowns_rhs_per_s"] {
            assert!(said[key].as_f64().unwrap() > 0.0, "{key}");
        }
        let mut npz = NpzReader::open(&output).unwrap();
        let phi = npz.shaped("phi", &[3, nz, ny, nx]).unwrap();
        let reached = residual(&arrays, &phi, lit_z);
        assert!(reached <= 1e-9, "{light}: {reached:.1e}");
        let reported = said["relative_residual"].as_f64().unwrap();
        // Both are sums in double of numbers near 1e-9 of the right-hand side.
        assert!((reported / reached - 1.0).abs() < 1e-3, "{reported:.3e} {reached:.3e}");

        for (name, z) in [("radiance_front", 0), ("radiance_back", nz - 1)] {
            let radiance = npz.shaped(name, &[3, ny, nx]).unwrap();
            for m in 0..3 {
                for c in 0..nx * ny {
                    let i = z * nx * ny + c;
                    let q = if z == lit_z { arrays[2].2[m * nx * ny + c] } else { 0.0 };
                    let g = 1.0 / (0.5 / (2.0 * arrays[0].2[i]) + 2.0 * 2.1489);
                    let flux = g * (phi[m * nx * ny * nz + i] - q);
                    let expected = 2.1489 / std::f64::consts::PI * flux;
                    let found = radiance[m * nx * ny + c];
                    assert!((found - expected).abs() < 1e-12, "{name} {m} {c}: {found}");
                }
            }
        }
    }
}

/// Every wrong input ends with exit code 2, an error that names the file and the array, and
/// no output.
#[test]
fn wrong_input_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("p.npz"), folder.path().join("phi.npz"));
    let change = |edit: &dyn Fn(&mut Arrays)| {
        let mut arrays = problem("q");
        edit(&mut arrays);
        arrays
    };
    let cases: [(&str, Arrays); 11] = [
        ("mu", change(&|a| a[1].1 = vec![5, 7, 6])),
        ("kappa", change(&|a| a[0].2[17] = f64::NAN)),
        ("kappa", change(&|a| a[0].2[17] = -0.1)),
        ("mu", change(&|a| a[1].2[3] = -1e-3)),
        ("q", change(&|a| a[2].2[9] = f64::INFINITY)),
        ("q", change(&|a| a[2].1 = vec![3, 7, 6])),
        ("kappa", change(&|a| a[0].1 = vec![35, 6])),
        ("q_back", change(&|a| drop(a.remove(2)))),
        ("mu", change(&|a| drop(a.remove(1)))),
        ("h", change(&|a| a[3].2[0] = 0.0)),
        ("C", change(&|a| a[4].2[0] = -1.0)),
    ];
    for (name, arrays) in &cases {
        save(&input, arrays);
        let run = forward(&input, &output, &[]);
        let error = json(&run)["error"].as_str().unwrap().to_owned();
        assert_eq!(run.status.code(), Some(2), "{error}");
        assert!(error.contains("p.npz") && error.contains(name), "{name}: {error}");
        assert!(!output.exists());
    }

    save(&input, &problem("q"));
    let whole = std::fs::read(&input).unwrap();
    std::fs::write(&input, &whole[..whole.len() / 2]).unwrap();
    let run = forward(&input, &output, &[]);
    assert_eq!(run.status.code(), Some(2));
    assert!(json(&run)["error"].as_str().unwrap().contains("p.npz"));

    save(&input, &problem("q"));
    for (flags, word) in [
        (["--device", "gpu:no such"], "\"no such\""),
        (["--device", "cuda"], "gpu:NAME"),
        (["--rtol", "0"], "rtol"),
    ] {
        let run = forward(&input, &output, &flags);
        assert_eq!(run.status.code(), Some(2));
        assert!(json(&run)["error"].as_str().unwrap().contains(word));
        assert!(!output.exists());
    }
}

/// The answer of a GPU is the CPU's within what both residuals leave: a condition number below 100
/// times 1e-6.
#[test]
fn a_gpu_gives_the_same_answer() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("p.npz"), folder.path().join("phi.npz"));
    save(&input, &problem("q"));
    let mut answers = Vec::new();
    for device in ["cpu", "gpu"] {
        let run = forward(&input, &output, &["--device", device, "--force"]);
        let said = json(&run);
        if device == "gpu" && said["hint"].to_string().contains("driver") {
            println!("SKIPPED: {}", said["error"]);
            return;
        }
        assert!(run.status.success(), "{said}");
        println!("{device}: {}", said["device"]);
        assert_eq!(said["device"] == "CPU", device == "cpu");
        let mut npz = NpzReader::open(&output).unwrap();
        answers.push(npz.array_f64("phi").unwrap().data);
    }
    let largest = answers[0].iter().fold(0.0f64, |a, v| a.max(v.abs()));
    for (cpu, gpu) in answers[0].iter().zip(&answers[1]) {
        assert!((cpu - gpu).abs() < 1e-4 * largest, "{cpu} {gpu}");
    }
}

/// A residual out of reach is a failure of the work (1), not of the input (2); nothing is written.
#[test]
fn an_answer_is_neither_made_up_nor_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let (input, output) = (folder.path().join("p.npz"), folder.path().join("phi.npz"));
    save(&input, &problem("q"));
    let run = forward(&input, &output, &["--rtol", "1e-30"]);
    assert_eq!(run.status.code(), Some(1));
    assert!(json(&run)["error"].as_str().unwrap().contains("1.0e-30"));
    assert!(!output.exists());

    std::fs::write(&output, "precious").unwrap();
    let run = forward(&input, &output, &[]);
    assert_eq!(run.status.code(), Some(2));
    assert!(json(&run)["hint"].as_str().unwrap().contains("--force"));
    assert_eq!(std::fs::read_to_string(&output).unwrap(), "precious");
    assert!(forward(&input, &output, &["--force"]).status.success());
    assert!(NpzReader::open(&output).is_ok());
}
