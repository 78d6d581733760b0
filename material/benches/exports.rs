//! Every export of a material of 256 × 256 × 20 voxels and three channels, and their sizes.

use std::path::{Path, PathBuf};
use std::time::Duration;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use material::{
    Channel, Conversion, Face, Format, Grid, Material, Optics, Overwrite, Provenance, write_all,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Veins with noise on them: acquired coefficients have no two voxels alike.
fn slab() -> Material {
    let grid = Grid::new([256, 256, 20], [0.25; 3]).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut field = |mean: f32, contrast: f32| {
        let mut voxel = |i: usize| {
            let [x, y, z] = [i % 256, i / 256 % 256, i / 65536].map(|n| n as f32);
            let vein = (0.05 * x + 0.03 * y + 2.0 * (0.02 * y + 0.1 * z).sin()).sin();
            mean * (contrast * vein + 0.02 * random.random_range(-1.0..1.0_f32)).exp()
        };
        (0..grid.len()).map(&mut voxel).collect()
    };
    let channels = ["R", "G", "B"].map(|name| Channel {
        name: name.into(),
        kappa_mm: field(0.3, 0.4),
        mu_per_mm: field(0.01, 0.8),
        gain: 1.0,
    });
    let optics = Optics::from_eta(1.4);
    Material::new(grid, channels.into(), optics, Face::Back, Provenance::default()).unwrap()
}

/// How large a folder is.
fn bytes(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    let size = |entry: std::fs::DirEntry| match entry.metadata().unwrap() {
        about if about.is_dir() => bytes(&entry.path()),
        about => about.len(),
    };
    entries.map(size).sum()
}

fn exports(criterion: &mut Criterion) {
    let material = slab();
    let formats = [
        Format::Vdb,
        Format::Mitsuba,
        Format::Pbrt,
        Format::Nrrd,
        Format::Exr,
        Format::Npz,
        Format::Gltf,
        Format::OpenPbr,
    ];
    let write = |format: Format, folder: &Path| {
        let path = folder.join("m").with_extension(format.ending());
        format.write(&path, &material, Conversion::default(), Overwrite::Refuse).unwrap();
    };
    let all = |folder: &Path| {
        let path = |format: &Format| folder.join("m").with_extension(format.ending());
        let paths: Vec<PathBuf> = formats.iter().map(path).collect();
        write_all(&paths, &material, Conversion::default(), Overwrite::Refuse).unwrap();
    };
    let mut group = criterion.benchmark_group("export");
    group.sample_size(10).warm_up_time(Duration::from_secs(1));
    group.measurement_time(Duration::from_secs(5));
    let mut run = |name: &str, write: &dyn Fn(&Path)| {
        group.bench_function(name, |b| {
            b.iter_batched_ref(
                || tempfile::tempdir().unwrap(),
                |folder| write(folder.path()),
                BatchSize::PerIteration,
            );
        });
        let folder = tempfile::tempdir().unwrap();
        let before = processor();
        write(folder.path());
        let took =
            before.zip(processor()).map_or("unknown".into(), |(a, b)| format!("{:.2} s", b - a));
        let size = bytes(folder.path()) as f64 / 1e6;
        println!("export/{name}: {size:.1} MB, processor time {took}");
    };
    formats.iter().for_each(|format| run(format.ending(), &|folder| write(*format, folder)));
    run("all", &all);
    println!("most memory: {}", peak().unwrap_or_else(|| "unknown".into()));
}

/// The processor time that the process has had, s, as Linux tells it: in hundredths.
fn processor() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The program's name, in brackets, may have spaces.
    let numbers = status.rsplit_once(')')?.1.split_whitespace();
    let ticks: Option<Vec<f64>> = numbers.skip(11).take(2).map(|n| n.parse().ok()).collect();
    Some(ticks?.iter().sum::<f64>() / 100.0)
}

/// The most memory that the process ever had, as Linux tells it.
fn peak() -> Option<String> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| Some(line.strip_prefix("VmHWM:")?.trim().to_owned()))
}

criterion_group!(benches, exports);
criterion_main!(benches);
