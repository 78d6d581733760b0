//! Readers fed with files that were whole once. No mutation may make one panic, or take more
//! memory than the file's own size times a constant.
//!
//! `DIAPHANE_FUZZ_CASES` sets how many a reader; a million take some minutes in release.
//! `DIAPHANE_FUZZ_READER` names one reader, `DIAPHANE_FUZZ_FROM` the first case, to see one again.

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::panic::catch_unwind;
use std::sync::atomic::{AtomicUsize, Ordering};

use common::surfaced;
use material::{Conversion, Format, Overwrite, readers};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SEED: u64 = 20_261_123;
/// What zip can do at best is 1032 : 1; numbers are held in two widths and turned into our frame.
const MOST_BYTES_A_BYTE: usize = 4096;
/// Buffers and tables that readers have whatever the file; threads' first use of them.
const ALWAYS: usize = 4 << 20;

/// Counts what is taken.
struct Counting;

static TAKEN: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: all it does beside counting is to call the system's allocator with what it was given.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let taken = TAKEN.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        MOST.fetch_max(taken, Ordering::Relaxed);
        // SAFETY: as the caller vouches for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        TAKEN.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller vouches for.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// A file of the format, of one channel or three.
fn whole(name: &str, channels: &[&str]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let (file, written) = match name {
        "native" => ("m.diaphane", Format::Native),
        "npz" => ("m.npz", Format::Npz),
        "vdb" => ("m.vdb", Format::Vdb),
        "nrrd" => ("m.nrrd", Format::Nrrd),
        "exr" => ("m.exr", Format::Exr),
        _ => ("sigma_a.vol", Format::Mitsuba),
    };
    let path = folder.path().join(format!("m.{}", written.ending()));
    let conversion = Conversion::default();
    written.write(&path, &surfaced(channels), conversion, Overwrite::Refuse).unwrap();
    std::fs::read(folder.path().join(file)).unwrap()
}

/// Numbers that lengths and counts break at.
const NUMBERS: [u32; 10] = [0, 1, 2, 7, 255, 1 << 16, 1 << 20, 1 << 30, i32::MAX as u32, u32::MAX];

fn mutate(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    for _ in 0..random.random_range(1..5) {
        if bytes.is_empty() {
            return;
        }
        let mut at = random.random_range(0..bytes.len());
        // Most of a sparse file is zeros; what counts stands between them.
        if random.random_range(0..4) > 0 {
            at = (at..bytes.len()).find(|&at| bytes[at] != 0).unwrap_or(at);
        }
        match random.random_range(0..9) {
            0 | 1 => bytes[at] = random.random(),
            2 => bytes[at] ^= 1 << random.random_range(0..8),
            3 | 4 if at + 4 <= bytes.len() => {
                let number = NUMBERS[random.random_range(0..NUMBERS.len())];
                bytes[at..at + 4].copy_from_slice(&number.to_le_bytes());
            }
            5 => bytes[at] = b"0123456789-.,:{}[]\"\n e"[random.random_range(0..22)],
            6 if random.random_range(0..4) == 0 => bytes.truncate(at),
            7 => {
                let end = bytes.len().min(at + random.random_range(1..64));
                let piece = bytes[at..end].to_vec();
                let to = random.random_range(0..bytes.len());
                bytes.splice(to..to, piece);
            }
            8 => {
                let end = bytes.len().min(at + random.random_range(1..64));
                bytes.drain(at..end);
            }
            _ => random.fill_bytes(&mut bytes[at..][..1]),
        }
    }
}

/// Gets a changed native file past its hash.
fn seal(bytes: &mut [u8]) {
    if let Some(body) = bytes.len().checked_sub(32) {
        let (body, hash) = bytes.split_at_mut(body);
        hash.copy_from_slice(blake3::hash(body).as_bytes());
    }
}

#[test]
fn mutated_files_are_answered() {
    let number = |name| std::env::var(name).ok().and_then(|n| n.parse::<u64>().ok());
    let cases = number("DIAPHANE_FUZZ_CASES").unwrap_or(2000);
    let from = number("DIAPHANE_FUZZ_FROM").unwrap_or(0);
    let only = std::env::var("DIAPHANE_FUZZ_READER").ok();
    println!("seed {SEED}, {cases} mutations a reader");
    for (name, reader) in readers() {
        if only.as_deref().is_some_and(|only| only != name) {
            continue;
        }
        let mut random = ChaCha8Rng::seed_from_u64(SEED);
        let files = [whole(name, &["Y"]), whole(name, &["R", "G", "B"])];
        files.iter().for_each(|file| reader(file).unwrap());
        let (mut read, mut most) = (0, 0.0_f64);
        for case in 0..cases {
            let mut bytes = files[usize::from(case % 4 == 3)].clone();
            mutate(&mut bytes, &mut random);
            if name == "native" && case % 8 != 0 {
                seal(&mut bytes);
            }
            if case < from {
                continue;
            }
            let before = TAKEN.load(Ordering::Relaxed);
            MOST.store(before, Ordering::Relaxed);
            let outcome = catch_unwind(|| reader(&bytes).is_ok());
            let taken = MOST.load(Ordering::Relaxed).saturating_sub(before);
            let Ok(whole) = outcome else { panic!("{name}: seed {SEED}, case {case} panics") };
            read += u64::from(whole);
            most = most.max(taken as f64 / bytes.len().max(1) as f64);
            assert!(
                taken <= bytes.len() * MOST_BYTES_A_BYTE + ALWAYS,
                "{name}: seed {SEED}, case {case}: {taken} bytes taken for {}",
                bytes.len()
            );
        }
        println!("{name}: {read} of {cases} were read, at most {most:.0} bytes taken a byte");
    }
}
