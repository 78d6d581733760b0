//! The page about a session at every stage, looked at in a browser; and the session derived again from
//! its pictures.

mod common;

use calibration::{HdrImage, write_exr};
use common::{Run, diaphane, tiny_session};
use material::{
    BoundaryConvention, Channel, Face, Grid, Material, Optics, Overwrite, Provenance, Resolution,
    npz,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use std::f32::consts::TAU;
use std::path::{Path, PathBuf};
use std::process::Command;

#[track_caller]
fn well(args: &[&str]) -> Run {
    let run = diaphane(args);
    assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
    run
}

/// Fails with what is told, and with the exit code of bad input.
#[track_caller]
fn refused(args: &[&str], told: &[&str]) {
    let run = diaphane(args);
    assert_eq!(run.code, 2, "{args:?}: {}", run.stderr);
    let error = run.json["error"].as_str().unwrap_or_default();
    assert!(told.iter().all(|t| error.contains(t)), "{told:?} in {error}");
    assert!(run.json["hint"].is_string(), "{}", run.json);
}

const SOLVE: [&str; 4] = ["--max-evaluations", "6", "--device", "cpu"];

/// One small session from nothing to its last word: the same pictures serve all.
#[test]
fn a_session_is_reported_at_every_stage_and_derived_again() {
    let folder = tempfile::tempdir().unwrap();
    let session = folder.path().join("wax").display().to_string();
    // Cells of ten mean free paths: what they come to is of no matter here, only that it is soon.
    let small = [("cells", "[4, 4, 2]"), ("spacing_mm", "[4.5, 4.5, 2.25]")];
    tiny_session(&session, &[&small[..], &[("regions", "[2, 1]")]].concat(), "");
    let pages = stages(&session, folder.path());
    in_a_browser(&pages);
    derived_again(&session);
}

/// What the page of each stage shows and misses.
fn stages(session: &str, folder: &Path) -> Vec<PathBuf> {
    let mut pages = Vec::new();
    let mut page = |name: &str, missing: &[&str], sections: &[&str]| {
        let file = folder.join(format!("{name}.html"));
        let run = well(&["report", session, "--output", file.to_str().unwrap()]);
        let told = run.json["missing"].as_array().unwrap();
        assert_eq!(told.iter().map(|m| m.as_str().unwrap()).collect::<Vec<_>>(), missing, "{name}");
        let text = std::fs::read_to_string(&file).unwrap();
        let all = [
            "Captured</h2>",
            "Captured and relit</h2>",
            "Inside the material</h2>",
            "How the solve went</h2>",
            "Calibration</h2>",
            "Exposures</h2>",
            "The capture</h2>",
            "Where it comes from</h2>",
        ];
        for section in all {
            assert_eq!(text.contains(section), sections.contains(&section), "{name}: {section}");
        }
        assert_eq!(text.contains("There is no verdict yet"), !missing.is_empty(), "{name}");
        assert!(!text.contains("NaN") && !text.contains(">inf"), "{name}: a number that is none");
        pages.push(file);
        text
    };
    let [calibration, exposures, capture, origin] =
        ["Calibration</h2>", "Exposures</h2>", "The capture</h2>", "Where it comes from</h2>"];
    let from_merge = ["measurement", "material", "verification", "export"];
    let all =
        [&["calibration pictures", "calibration", "sample pictures"], &from_merge[..]].concat();
    page("begun", &all, &[origin]);
    well(&["calibrate", "all", session]);
    page("calibrated", &[&all[2..]].concat(), &[calibration, exposures, capture, origin]);
    well(&["capture", session]);
    let text = page("captured", &all[3..], &[calibration, exposures, capture, origin]);
    // Three exposures, and their shots.
    for cell in ["<th>50 ms</th><th>0.40 s</th><th>3.00 s</th>", "<th>region-02</th><td"] {
        assert!(text.contains(cell), "{cell}");
    }
    well(&["merge", session]);
    page("merged", &all[4..], &["Captured</h2>", calibration, exposures, capture, origin]);
    well(&[&["solve", session][..], &SOLVE].concat());
    let inside = ["Inside the material</h2>", "How the solve went</h2>"];
    let relit = ["Captured and relit</h2>", calibration, exposures, capture, origin];
    let relit = [&relit[..], &inside].concat();
    page("solved", &all[5..], &relit);
    well(&["verify", session]);
    well(&["export", session]);
    let text = page("done", &[], &relit);
    let measured = session_json(session, "measurement/measurement.json");
    let patterns = measured["patterns"].as_array().unwrap().len();
    assert_eq!(text.matches("class=\"chart scanline\"").count(), patterns);
    // Each picture by its hash, and how to come to the same.
    for input in measured["inputs"].as_array().unwrap() {
        assert!(text.contains(input["blake3"].as_str().unwrap()), "{input}");
    }
    assert!(text.contains(&format!("diaphane solve {session} --max-evaluations 6 --device cpu\n")));
    pages
}

fn session_json(session: &str, file: &str) -> Value {
    serde_json::from_slice(&std::fs::read(Path::new(session).join(file)).unwrap()).unwrap()
}

/// Widths of a phone and of a desktop's window, CSS pixels.
const WIDTHS: [u32; 2] = [390, 1280];

/// Each page in Chromium: nothing on its console, every picture there, nothing sticks out, and the slider
/// changes the slice.
fn in_a_browser(pages: &[PathBuf]) {
    let names = ["chromium", "chromium-browser", "google-chrome"];
    let runs = |name: &&str| {
        Command::new(name).arg("--version").output().is_ok_and(|out| out.status.success())
    };
    let Some(browser) = names.into_iter().find(runs) else {
        eprintln!("SKIPPED: the pages in a browser: no Chromium (cargo xtask setup installs it)");
        return;
    };
    let folder = pages[0].parent().unwrap();
    let names: Vec<&str> = pages.iter().map(|p| p.file_name().unwrap().to_str().unwrap()).collect();
    let look = format!(
        "<!DOCTYPE html><meta charset=\"utf-8\"><body><pre id=\"outcome\"></pre><script>\n\
         const PAGES = {names:?}, WIDTHS = {WIDTHS:?};\n{}</script></body>\n",
        include_str!("report/look.js")
    );
    let harness = folder.join("look.html");
    std::fs::write(&harness, look).unwrap();
    // Virtual time: the clock stands while something loads, and the outcome is there before it is over.
    let out = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files"])
        .args(["--enable-logging=stderr", "--virtual-time-budget=30000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", folder.join("browser").display()))
        .arg(format!("file://{}", harness.display()))
        .output()
        .unwrap();
    let log = String::from_utf8_lossy(&out.stderr);
    let console: Vec<&str> = log.lines().filter(|line| line.contains("CONSOLE")).collect();
    assert!(console.is_empty(), "{console:#?}");
    let dom = String::from_utf8_lossy(&out.stdout);
    let (_, outcome) = dom.split_once("<pre id=\"outcome\">").unwrap_or_default();
    let (outcome, _) = outcome.split_once("</pre>").unwrap_or_default();
    let seen: Value = serde_json::from_str(&outcome.replace("&lt;", "<").replace("&amp;", "&"))
        .unwrap_or_else(|e| panic!("{e}: {outcome:?}\n{log}"));
    let seen = seen.as_array().unwrap_or_else(|| panic!("{seen}"));
    assert_eq!(seen.len(), pages.len() * WIDTHS.len());
    for look in seen {
        let width = look["width"].as_u64().unwrap();
        assert!(look["scrolls"].as_u64().unwrap() <= width, "{look}");
        for none in ["wide", "missing", "outside"] {
            assert!(look[none].as_array().unwrap().is_empty(), "{look}");
        }
        assert_eq!(look["flat"], 0, "{look}");
        let done = ["solved.html", "done.html"].contains(&look["page"].as_str().unwrap());
        assert_eq!(look["slider"].is_object(), done, "{look}");
        if done {
            let slider = &look["slider"];
            assert_eq!(slider["max"], 1, "{look}");
            assert_eq!(slider["first"], serde_json::json!(["0%", "slice 1 of 2, 1.13 mm deep"]));
            assert_eq!(slider["last"], serde_json::json!(["100%", "slice 2 of 2, 3.38 mm deep"]));
            // A finger hits it.
            assert!(slider["height"].as_f64().unwrap() >= 28.0, "{look}");
            // Three of each pattern, six slices, two of the calibration's devices.
            assert!(look["images"].as_u64().unwrap() >= 3 * 2 + 6 + 2, "{look}");
        }
    }
}

/// `verify --strict` agrees with what the commands left, and names what somebody changed.
fn derived_again(session: &str) {
    let strict = ["verify", session, "--strict"];
    let file = |name: &str| Path::new(session).join(name);
    let kept = Kept::of(session);
    let told = well(&strict).json;
    assert_eq!(told["differs"], false);
    assert!(told["checked"].as_array().unwrap().len() >= 5, "{told}");
    assert!(Kept::of(session).0 == kept.0, "it writes nothing");

    let mut figures = session_json(session, "material/verification.json");
    figures["fit"] = 1e-9.into();
    std::fs::write(file("material/verification.json"), figures.to_string()).unwrap();
    refused(&strict, &["verification.json: fit: is 1e-9, derived again"]);
    kept.put_back(session);

    // A calibration, in a figure that nothing else goes by, and everything behind it made from that.
    let before = found(session);
    let mut calibration = session_json(session, "calibration/calibration.json");
    calibration["white_disagreement"] = 0.5.into();
    std::fs::write(file("calibration/calibration.json"), calibration.to_string()).unwrap();
    refused(&strict, &["measurement: out of date"]);
    well(&["merge", session, "--force"]);
    well(&[&["solve", session, "--force"][..], &SOLVE].concat());
    well(&["verify", session, "--force"]);
    assert!(found(session) == before, "merge and solve gave something else the second time");
    refused(&strict, &["calibration.json: white_disagreement: is 0.5, derived again "]);
    kept.put_back(session);

    touch_up_the_measurement(session);
    refused(&strict, &["measurement", "is not what was written"]);
    let mut index = session_json(session, "measurement/measurement.json");
    index["arrays"] = material::hash_file(&file("measurement/measurement.npz")).unwrap().into();
    std::fs::write(file("measurement/measurement.json"), index.to_string()).unwrap();
    refused(&strict, &["material: out of date"]);
    well(&[&["solve", session, "--force"][..], &SOLVE].concat());
    well(&["verify", session, "--force"]);
    refused(
        &strict,
        &["measurement.npz: region-01: radiance G of cell 3, 2 is ", ", derived again "],
    );

    let frame = file("frames/region-02/region-02-e1-r0.png");
    let mut bytes = std::fs::read(&frame).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&frame, bytes).unwrap();
    refused(&strict, &["frames/region-02/region-02-e1-r0.png: has changed since it was taken"]);
    std::fs::remove_file(&frame).unwrap();
    refused(&strict, &["frames/region-02/region-02-e1-r0.png: not there"]);
}

/// The files of a session that steps made.
struct Kept(Vec<(&'static str, Vec<u8>)>);

impl Kept {
    fn of(session: &str) -> Self {
        let names = [
            "calibration/calibration.json",
            "measurement/measurement.npz",
            "measurement/measurement.json",
            "material/material.diaphane",
            "material/convergence.json",
            "material/verification.json",
        ];
        let read = |name| (name, std::fs::read(Path::new(session).join(name)).unwrap());
        Self(names.map(read).into())
    }

    fn put_back(&self, session: &str) {
        self.0
            .iter()
            .for_each(|(n, bytes)| std::fs::write(Path::new(session).join(n), bytes).unwrap());
    }
}

/// What merge and solve found, bit by bit. The same pictures, settings and device give the same, on the
/// CPU; only when a material was made, and how long that took, are others each time.
fn found(session: &str) -> impl PartialEq {
    let file = |name: &str| Path::new(session).join(name);
    let material = Material::load(&file("material/material.diaphane")).unwrap();
    let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    let channels: Vec<_> = material
        .channels()
        .iter()
        .map(|c| (bits(&c.kappa_mm), bits(&c.mu_per_mm), c.gain.to_bits()))
        .collect();
    let maps = material.resolution().unwrap().iter();
    let resolution: Vec<_> = maps.map(|r| (bits(&r.kappa_mm), bits(&r.mu_mm))).collect();
    let convergence = session_json(session, "material/convergence.json")["channels"].clone();
    let arrays = std::fs::read(file("measurement/measurement.npz")).unwrap();
    (arrays, channels, resolution, convergence)
}

/// Moves one value to its neighbour in single precision: in the first pattern's second channel the cell in
/// column 3, row 2.
fn touch_up_the_measurement(session: &str) {
    let arrays = Path::new(session).join("measurement/measurement.npz");
    let mut reader = npz::NpzReader::open(&arrays).unwrap();
    let [m, c, n] = [session_patterns(session), 3, 4];
    let mut maps = Vec::new();
    for (name, shape) in [
        ("radiance", vec![m, c, n, n]),
        ("variance", vec![m, c, n, n]),
        ("irradiance", vec![m, n, n]),
    ] {
        let values: Vec<f32> =
            reader.shaped(name, &shape).unwrap().iter().map(|v| *v as f32).collect();
        maps.push((name, shape, values));
    }
    drop(reader);
    let touched = &mut maps[0].2[n * n + 2 * n + 3];
    *touched = f32::from_bits(touched.to_bits() + 1);
    npz::write(&arrays, Overwrite::Replace, |out| {
        maps.iter().try_for_each(|(name, shape, values)| out.array_f32(name, shape, values))
    })
    .unwrap();
}

fn session_patterns(session: &str) -> usize {
    session_json(session, "measurement/measurement.json")["patterns"].as_array().unwrap().len()
}

/// Largest page that can be sent by mail anywhere.
const MOST_BYTES: usize = 10_000_000;

/// 256 × 256 × 20 cells under 16 regions, as rough as pictures and a solve leave them: 1 % of noise in the
/// pictures, and details of six cells and 0.3 % of noise in the material.
#[test]
#[ignore = "relights 4 million unknowns under 16 patterns, which takes a minute and 2 GB"]
fn the_page_of_a_large_block_is_small() {
    const CELLS: [usize; 3] = [256, 256, 20];
    let [nx, ny, nz] = CELLS;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut noise =
        |sigma: f32| 1.0 + sigma * (random.random::<f32>() + random.random::<f32>() - 1.0) * 2.4;
    let mut manifest = String::from(
        "[sample]\nname = \"large\"\nsize_mm = [128.0, 128.0, 10.0]\ncells = [256, 256, 20]\nlit_face = \"back\"\neta = 1.4\n",
    );
    for m in 0..16_usize {
        let middle = [(m % 4) as f32 * 64.0 + 32.0, (m / 4) as f32 * 64.0 + 32.0];
        let value = |i: usize, noise: &mut dyn FnMut(f32) -> f32| {
            let (x, y) = ((i / 3 % nx) as f32 - middle[0], (i / 3 / nx) as f32 - middle[1]);
            0.02 * (-(x * x + y * y) / 4000.0).exp() * noise(0.01)
        };
        let image = HdrImage {
            width: nx,
            height: ny,
            channels: 3,
            radiance: (0..3 * nx * ny).map(|i| value(i, &mut noise)).collect(),
            variance: vec![1e-8; 3 * nx * ny],
            variance_known: true,
            clipped_shortest: 0,
            lost_longest: 0,
        };
        write_exr(path(&format!("{m}.exr")), &image, Overwrite::Replace).unwrap();
        manifest += &format!(
            "[[pattern]]\nname = \"p{m}\"\nimage = \"{m}.exr\"\nregion = {{ columns = 4, rows = 4, index = {m} }}\n"
        );
    }
    std::fs::write(path("m.toml"), manifest).unwrap();
    let [session, images, file] = ["large", "", "m.toml"].map(|n| path(n).display().to_string());
    well(&["import", &session, "--images", &images, "--manifest", &file]);

    let mut volume = |mean: f32| -> Vec<f32> {
        let value = |i: usize| {
            let [x, y, z] = [i % nx, i / nx % ny, i / nx / ny].map(|v| v as f32);
            let wave =
                |turn: f32, cells: f32| ((x * turn.cos() + y * turn.sin() + z) * TAU / cells).sin();
            let log = 0.4 * wave(0.3, 120.0)
                + 0.3 * wave(1.2, 31.0)
                + 0.15 * wave(2.1, 13.0)
                + 0.05 * wave(0.8, 6.0);
            mean * log.exp()
        };
        (0..nx * ny * nz).map(|i| value(i) * noise(0.003)).collect()
    };
    let mut channel = |name: &str| Channel {
        name: name.into(),
        kappa_mm: volume(0.3),
        mu_per_mm: volume(0.004),
        gain: 1.0,
    };
    let channels = ["R", "G", "B"].map(&mut channel).to_vec();
    let told = |c: &Channel| Resolution {
        kappa_mm: c.kappa_mm.iter().map(|v| 10.0 * v).collect(),
        mu_mm: c.mu_per_mm.iter().map(|v| 1000.0 * v).collect(),
    };
    let resolution = channels.iter().map(told).collect();
    let grid = Grid::new(CELLS, [0.5; 3]).unwrap();
    let optics = Optics::with_boundary(1.4, BoundaryConvention::Transport);
    let material =
        Material::new(grid, channels, optics, Face::Back, Provenance::default()).unwrap();
    let material = material.with_resolution(resolution).unwrap();
    let results = Path::new(&session).join("material");
    std::fs::create_dir(&results).unwrap();
    material.save(&results.join("material.diaphane"), Overwrite::Refuse).unwrap();
    let convergence = "{\"seconds\":1.0,\"fit\":1e-4,\"device\":\"CPU\",\"channels\":[]}";
    std::fs::write(results.join("convergence.json"), convergence).unwrap();
    well(&["report", &session]);
    let page = std::fs::read_to_string(Path::new(&session).join("report/report.html")).unwrap();
    assert!(page.contains("Captured and relit") && page.contains("finest detail of μ"));
    eprintln!("{} bytes", page.len());
    assert!(page.len() <= MOST_BYTES, "{} bytes", page.len());
}
