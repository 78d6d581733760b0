//! A solve that is interrupted goes on from its checkpoint; one of another problem, or a damaged one, is
//! refused.

mod common;

use calibration::{HdrImage, write_exr};
use common::diaphane;
use diffusion::{Batch, CpuSolver, Forward, Illuminations, Medium};
use material::{Face, Grid, Optics, Overwrite};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Imports pictures of a wavy block, 32 × 32 × 8 cells from twice as many along each axis.
fn session(folder: &Path) -> PathBuf {
    let fine = Grid::new([64, 64, 16], [0.25; 3]).unwrap();
    let wave = |i: usize| (0.15 * (i % 64) as f64).sin() * (0.2 * (i / 64 % 64) as f64).cos();
    let (kappa, mu) =
        (0..fine.len()).map(|i| (0.3 + 0.1 * wave(i), 0.01 - 0.004 * wave(i))).unzip();
    let optics = Optics::from_eta(1.3);
    let mut solver = CpuSolver::<f32>::new();
    let medium = Medium::new(fine, kappa, mu).unwrap();
    let mut forward = Forward::new(medium, &optics, &mut solver).unwrap();
    let light = Illuminations::regions(&fine, Face::Back, 4).unwrap();
    let mut fluence = Batch::zeros(fine.len(), light.count());
    forward.solve(&light, &mut fluence, 1e-6).unwrap();
    let images = folder.join("images");
    std::fs::create_dir(&images).unwrap();
    let mut manifest = String::from(
        "[sample]\nname = \"wavy\"\nsize_mm = [16.0, 16.0, 4.0]\ncells = [32, 32, 8]\n\
         lit_face = \"back\"\neta = 1.3\n[pictures]\nwhite = 1.0\nlinear = true\n",
    );
    for (r, image) in forward.exit_radiance(&light, &fluence, Face::Front).iter().enumerate() {
        let picture = HdrImage {
            width: 64,
            height: 64,
            channels: 3,
            radiance: image.iter().flat_map(|l| [(std::f64::consts::PI * l) as f32; 3]).collect(),
            variance: image.iter().flat_map(|l| [(0.01 * l).powi(2) as f32; 3]).collect(),
            variance_known: true,
            clipped_shortest: 0,
            lost_longest: 0,
        };
        write_exr(images.join(format!("r{r}.exr")), &picture, Overwrite::Refuse).unwrap();
        manifest += &format!(
            "[[pattern]]\nname = \"region-{r}\"\nimage = \"r{r}.exr\"\n\
             region = {{ columns = 4, rows = 4, index = {r} }}\n"
        );
    }
    let file = folder.join("m.toml");
    std::fs::write(&file, manifest).unwrap();
    let session = folder.join("session");
    let arguments = [&session, Path::new("--images"), &images, Path::new("--manifest"), &file];
    let run = diaphane([Path::new("import")].into_iter().chain(arguments));
    assert_eq!(run.code, 0, "{}", run.stderr);
    session
}

/// Interrupts a solve as Ctrl-C does, once there is a checkpoint of its first channel. What it says.
fn interrupted(session: &Path) -> String {
    let mut solve = Command::new(env!("CARGO_BIN_EXE_diaphane"));
    solve.arg("solve").arg(session).stderr(Stdio::piped()).stdout(Stdio::null());
    let child = solve.spawn().unwrap();
    let began = Instant::now();
    while !session.join("material/checkpoints/R.checkpoint").is_file() {
        assert!(began.elapsed() < Duration::from_secs(60), "no checkpoint");
        std::thread::sleep(Duration::from_millis(1));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let out = child.wait_with_output().unwrap();
    let told = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(1), "{told}");
    told
}

#[test]
fn a_solve_goes_on_from_its_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let session = session(folder.path());
    let at = session.to_str().unwrap();
    let told = interrupted(&session);
    assert!(told.contains("goes on from here"), "{told}");
    assert!(!session.join("material/material.diaphane").exists());
    let checkpoint = session.join("material/checkpoints/R.checkpoint");

    // Another problem, or none.
    let other = diaphane(["solve", at, "--lambda", "1e-3"]);
    assert_eq!(other.code, 2, "{}", other.stderr);
    assert!(other.stderr.contains("another problem"), "{}", other.stderr);
    assert!(other.stderr.contains("--restart"), "{}", other.stderr);
    let whole = std::fs::read(&checkpoint).unwrap();
    let mut bent = whole.clone();
    bent[whole.len() / 2] ^= 1;
    for damaged in [&whole[..whole.len() / 2], &whole[..7], &[], &bent] {
        std::fs::write(&checkpoint, damaged).unwrap();
        let refused = diaphane(["solve", at]);
        assert_eq!(refused.code, 2, "{}", refused.stderr);
        assert!(refused.stderr.contains("R.checkpoint: damaged"), "{}", refused.stderr);
    }
    std::fs::write(&checkpoint, &whole).unwrap();

    let resumed = diaphane(["solve", at]);
    assert_eq!(resumed.code, 0, "{}", resumed.stderr);
    assert!(resumed.stderr.contains("R: goes on after"), "{}", resumed.stderr);
    assert!(!session.join("material/checkpoints").exists());
    assert_eq!(resumed.json["converged"], true);

    // From the beginning it comes to the same: to what pictures without noise are fitted to,
    // within the fifth by which two descents that end at a gain of 0.2 % may differ.
    let anew = diaphane(["solve", at, "--force"]);
    assert_eq!(anew.code, 0, "{}", anew.stderr);
    let fit = |run: &common::Run| run.json["channels"][1]["fit"].as_f64().unwrap();
    assert!((fit(&resumed) / fit(&anew) - 1.0).abs() < 0.2, "{} {}", fit(&resumed), fit(&anew));
}

#[test]
fn restart_begins_anew() {
    let folder = tempfile::tempdir().unwrap();
    let session = session(folder.path());
    interrupted(&session);
    let run = diaphane(["solve", session.to_str().unwrap(), "--lambda", "1e-3", "--restart"]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(!run.stderr.contains("goes on after"), "{}", run.stderr);
    assert!(!session.join("material/checkpoints").exists());
}
