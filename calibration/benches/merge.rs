//! Speed of the merge beside OpenCV's MergeDebevec: sixteen colour frames of 512 × 768 pixels,
//! 8 bits, of the same scene, and both with a response curve and for a linear camera.
//!
//! OpenCV's time depends on the allocator more than on the arithmetic: it asks for large pictures
//! anew in every merge, and the system has to clear their pages. Two regimes bracket what users
//! see: `MALLOC_MMAP_THRESHOLD_=131072`, where memory goes back at once, as in a program that
//! merges now and then, and `MALLOC_MMAP_THRESHOLD_=4000000000 MALLOC_TRIM_THRESHOLD_=4000000000`,
//! where it is kept. Without either the heap's layout decides, and the ratio means little.
//!
//! `cargo bench -p diaphane-calibration --features opencv-photo --bench merge` prints both in pixels of a frame per second.

use calibration::{CalibrationError, NoiseModel, Photo, Response, merge};
use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use opencv::core::{CV_32FC3, Mat, Vec3b, Vec3f, Vector};
use opencv::photo::create_merge_debevec;
use opencv::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const WIDTH: usize = 768;
const HEIGHT: usize = 512;
const FRAMES: i32 = 16;

/// A scene over five decades, with the noise that the merge is told of.
fn stack(response: &Response) -> Vec<(Photo, f64)> {
    let noise = NoiseModel::for_max_value(255);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let codes: Vec<f64> = (0..256).map(|v| response.linearise(f64::from(v) / 255.0, 0)).collect();
    (0..FRAMES)
        .map(|i| {
            let time = 2.0_f64.powf(f64::from(i) * 0.75) / 2048.0;
            let data = (0..WIDTH * HEIGHT * 3)
                .map(|s| {
                    let (x, y) = (s / 3 % WIDTH, s / 3 / WIDTH);
                    let wave = (x as f64 / 37.0).sin() + (y as f64 / 23.0).cos();
                    let scene = 10.0_f64.powf(5.0 * x as f64 / WIDTH as f64 - 2.5 + 0.2 * wave);
                    // Photons before the response, read noise and rounding after it.
                    let photons = (noise.gain / 255.0 * (scene * time).min(1.0)).sqrt();
                    let light = scene * time + photons * rng.sample::<f64, _>(StandardNormal);
                    let above = codes.partition_point(|e| *e < light).clamp(1, 255);
                    let (low, high) = (codes[above - 1], codes[above]);
                    let code = above as f64 - 1.0 + (light - low) / (high - low);
                    let read = noise.read_noise * rng.sample::<f64, _>(StandardNormal);
                    (code + read).round().clamp(0.0, 255.0) as u16
                })
                .collect();
            let name = format!("frame {i}");
            (Photo { width: WIDTH, height: HEIGHT, channels: 3, data, max_value: 255, name }, time)
        })
        .collect()
}

fn gamma() -> Response {
    let curve: Vec<f64> = (0..256).map(|k| (f64::from(k) / 255.0).powf(2.2)).collect();
    Response::from_exposures(vec![curve; 3]).expect("a power rises")
}

/// The same frames as OpenCV takes them, and the curve as its table.
fn opencv_stack(stack: &[(Photo, f64)], response: &Response) -> (Vector<Mat>, Vector<f32>, Mat) {
    let mats = stack.iter().map(|(photo, _)| {
        let pixels: Vec<Vec3b> = photo
            .data
            .chunks_exact(3)
            .map(|p| [p[2], p[1], p[0]].map(|v| v as u8).into())
            .collect();
        let rows: Vec<&[Vec3b]> = pixels.chunks(WIDTH).collect();
        Mat::from_slice_2d(&rows).expect("a picture")
    });
    let times = stack.iter().map(|(_, t)| *t as f32).collect();
    let mut table = Mat::new_rows_cols_with_default(256, 1, CV_32FC3, 0.0.into()).expect("a table");
    for k in 0..256 {
        // OpenCV takes logarithms of it: zero is not allowed.
        let e = response.linearise(f64::from(k) / 255.0, 0).max(1e-6) as f32;
        *table.at_mut::<Vec3f>(k).expect("a row") = [e, e, e].into();
    }
    (mats.collect(), times, table)
}

fn compare(criterion: &mut Criterion) {
    let noise = NoiseModel::for_max_value(255);
    for (name, response) in [("curve", gamma()), ("linear", Response::identity(3))] {
        let stack = stack(&response);
        let mut group = criterion.benchmark_group(format!("merge {name}"));
        group.throughput(Throughput::Elements((WIDTH * HEIGHT) as u64)).sample_size(20);
        group.bench_function("diaphane", |bench| {
            bench.iter_batched(
                || stack.clone(),
                |stack| {
                    let frames = stack.into_iter().map(Ok::<_, CalibrationError>);
                    merge(frames, &response, &noise)
                },
                BatchSize::LargeInput,
            );
        });
        let (mats, times, table) = opencv_stack(&stack, &response);
        let mut debevec = create_merge_debevec().expect("OpenCV's photo module");
        group.bench_function("OpenCV", |bench| {
            bench.iter(|| {
                let mut out = Mat::default();
                debevec.process_with_response(&mats, &mut out, &times, &table).expect("a merge");
                out
            });
        });
        group.finish();
    }
}

criterion_group!(benches, compare);
criterion_main!(benches);
