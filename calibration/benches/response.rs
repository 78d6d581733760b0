//! Speed of the response recovery: three pictures of 640 × 426 pixels, 8 bits, three channels,
//! from decoded pictures to curves.

use calibration::{Photo, recover_response};
use criterion::{Criterion, criterion_group, criterion_main};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

const WIDTH: usize = 640;
const HEIGHT: usize = 426;

/// A scene over four decades through a gamma curve, with noise of one code.
fn bracket() -> Vec<(Photo, f64)> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let frame = |time: f64| {
        let data = (0..WIDTH * HEIGHT * 3).map(|s| {
            let (x, y) = ((s / 3 % WIDTH) as f64, (s / 3 / WIDTH) as f64);
            let wave = (x / 37.0).sin() + (y / 23.0).cos();
            let scene = 10.0_f64.powf(4.0 * x / WIDTH as f64 - 3.0 + 0.2 * wave);
            let code = 255.0 * (scene * time).powf(1.0 / 2.2);
            (code + rng.sample::<f64, _>(StandardNormal)).round().clamp(0.0, 255.0) as u16
        });
        let data = data.collect();
        let name = format!("{time} s");
        (Photo { width: WIDTH, height: HEIGHT, channels: 3, data, max_value: 255, name }, time)
    };
    [0.125, 1.0, 8.0].map(frame).into()
}

fn recovery(criterion: &mut Criterion) {
    let bracket = bracket();
    criterion.bench_function("response", |bench| bench.iter(|| recover_response(&bracket)));
}

criterion_group!(benches, recovery);
criterion_main!(benches);
