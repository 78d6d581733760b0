//! A capture that is killed again and again ends with what an undisturbed one leaves.

mod common;

use common::{diaphane, tiny_session};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SEED: u64 = 50;
const KILLS: usize = 50;

fn lines(journal: &Path) -> usize {
    std::fs::read(journal).map_or(0, |bytes| bytes.iter().filter(|&&b| b == b'\n').count())
}

/// Starts a capture and kills it (SIGKILL) a random while after a random number of new lines in the
/// journal; false if it ended before.
fn kill_once(session: &str, chance: &mut ChaCha8Rng) -> bool {
    let journal = Path::new(session).join("journal.jsonl");
    // The first line says that a run began.
    let until = lines(&journal) + chance.random_range(0..4);
    let after = Duration::from_micros(chance.random_range(0..30_000));
    let mut child = Command::new(env!("CARGO_BIN_EXE_diaphane"))
        .args(["capture", session])
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let began = Instant::now();
    while lines(&journal) < until {
        if child.try_wait().unwrap().is_some() {
            return false;
        }
        assert!(began.elapsed() < Duration::from_secs(120), "no line in two minutes");
        std::thread::sleep(Duration::from_millis(2));
    }
    std::thread::sleep(after);
    // Not if it has ended just now.
    let running = child.try_wait().unwrap().is_none();
    child.kill().unwrap();
    child.wait().unwrap();
    running
}

/// Every file below a folder, with its content.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut out = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            out.extend(files(&path));
        } else {
            out.insert(path.display().to_string(), std::fs::read(&path).unwrap());
        }
    }
    out
}

fn relative(session: &str, under: &str) -> BTreeMap<String, Vec<u8>> {
    let folder = Path::new(session).join(under);
    let prefix = folder.display().to_string();
    files(&folder).into_iter().map(|(path, bytes)| (path.replace(&prefix, ""), bytes)).collect()
}

fn step(arguments: &[&str]) {
    let run = diaphane(arguments);
    assert_eq!(run.code, 0, "{arguments:?}: {}", run.stderr);
}

#[test]
fn fifty_kills_lose_nothing_and_double_nothing() {
    println!("seed {SEED}");
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (undisturbed, killed) = (path("undisturbed"), path("killed"));
    for session in [&undisturbed, &killed] {
        tiny_session(session, &[("bracket_s", "[0.05, 0.15, 0.4, 1.2, 3.0]")], "");
    }
    step(&["capture", &undisturbed]);
    step(&["calibrate", "all", &undisturbed]);
    step(&["capture", &undisturbed]);
    step(&["merge", &undisturbed]);

    let mut chance = ChaCha8Rng::seed_from_u64(SEED);
    let mut kills = 0;
    while kills < KILLS / 2 && kill_once(&killed, &mut chance) {
        kills += 1;
    }
    assert_eq!(kills, KILLS / 2, "the calibration pictures were all there before");
    step(&["capture", &killed]);
    step(&["calibrate", "all", &killed]);
    while kills < KILLS && kill_once(&killed, &mut chance) {
        kills += 1;
    }
    assert_eq!(kills, KILLS, "the sample's pictures were all there before");
    step(&["capture", &killed]);
    step(&["merge", &killed]);

    // Frames: none lost, none beside them (set aside, or half written), each in the journal once.
    let frames = relative(&undisturbed, "frames");
    let found = relative(&killed, "frames");
    assert_eq!(found.keys().collect::<Vec<_>>(), frames.keys().collect::<Vec<_>>());
    assert!(found == frames, "a frame differs");
    let journal = std::fs::read_to_string(Path::new(&killed).join("journal.jsonl")).unwrap();
    for name in frames.keys() {
        let name = name.trim_start_matches('/');
        let told = journal.lines().filter(|line| {
            line.contains("\"frame-written\"") && line.contains(&format!("frames/{name}"))
        });
        assert_eq!(told.count(), 1, "{name}");
    }
    assert!(journal.matches("\"started\"").count() > KILLS / 2, "few runs came to begin");
    assert!(
        relative(&killed, "measurement") == relative(&undisturbed, "measurement"),
        "the measurement differs"
    );
}
