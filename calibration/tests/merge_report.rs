//! What a merge says beside the radiance, and what it corrects: exposures that are not what their
//! times say, things that moved, pixels that are clipped or lost, the noise, the flat field.

use calibration::{
    CalibrationError, FlatField, HdrImage, KNOTS, MasterDark, MergeReport, Merger, NoiseModel,
    Photo, Response,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// 14 bits in 16, unit gain, 4 electrons of read noise.
const NOISE: NoiseModel = NoiseModel {
    black_level: 100.0,
    read_noise: 4.0,
    gain: 1.0,
    full_scale: 65535.0,
    saturation: 16383.0,
};
const TIMES: [f64; 4] = [0.01, 0.04, 0.16, 0.64];
/// More than one piece of work, in which the merge counts.
const SIDE: usize = 96;

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    rng.sample(StandardNormal)
}

fn photo(name: &str, channels: usize, data: Vec<u16>) -> Photo {
    let height = data.len() / channels / SIDE;
    Photo { width: SIDE, height, channels, data, max_value: 65535, name: name.into() }
}

/// The code of `signal` DN above black with noise.
fn code(signal: f64, read_noise: f64, rng: &mut ChaCha8Rng) -> u16 {
    let sigma = (read_noise * read_noise + NOISE.gain * signal).sqrt();
    (NOISE.black_level + signal + sigma * normal(rng)).round().clamp(0.0, NOISE.saturation) as u16
}

/// DN a second: two decades from left to right.
fn light(pixel: usize) -> f64 {
    4000.0 * 100_f64.powf((pixel % SIDE) as f64 / SIDE as f64)
}

/// A bracket in which exposure k has `gains[k]` of its light.
fn bracket(gains: [f64; 4], read_noise: f64, seed: u64) -> Vec<(Photo, f64)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let frame = |(k, t): (usize, f64)| {
        let pixels = 0..SIDE * SIDE;
        let data = pixels.map(|p| code(light(p) * gains[k] * t, read_noise, &mut rng)).collect();
        (photo(&format!("e{k}"), 1, data), t)
    };
    TIMES.into_iter().enumerate().map(frame).collect()
}

fn merged(bracket: &[(Photo, f64)], flat: Option<FlatField>) -> (HdrImage, MergeReport) {
    let channels = bracket[0].0.channels;
    let response = Response::identity(channels);
    let mut merger = Merger::new(&response, &NOISE).unwrap();
    if let Some(flat) = flat {
        merger = merger.with_flat(flat);
    }
    for (photo, time) in bracket {
        merger.add(photo.clone(), *time).unwrap();
    }
    merger.finish().unwrap()
}

/// Mean of radiance over truth, and how many samples lie within their 1-sigma.
fn against_truth(image: &HdrImage) -> (f64, f64) {
    let samples = image.radiance.iter().zip(&image.variance).enumerate();
    let (mut ratio, mut covered) = (0.0, 0.0);
    for (p, (l, v)) in samples {
        let (found, truth) = (f64::from(*l) * NOISE.full_scale, light(p));
        ratio += found / truth;
        let sigma = f64::from(*v).sqrt() * NOISE.full_scale;
        covered += if (found - truth).abs() < sigma { 1.0 } else { 0.0 };
    }
    let n = image.radiance.len() as f64;
    (ratio / n, covered / n)
}

#[test]
fn exposures_that_miss_their_times_are_corrected() {
    let (mut within, mut count) = (0, 0);
    for seed in 0..20 {
        // A shutter that is slow when short, a lamp that was dimmer for one exposure.
        let gains = [1.08, 1.0, 0.95, 1.0];
        let (image, report) = merged(&bracket(gains, NOISE.read_noise, seed), None);
        for (k, (name, check)) in report.exposures.iter().enumerate() {
            assert_eq!(name, &format!("e{k}"));
            let Some(step) = check.step else {
                assert_eq!(k, 3, "only the longest has nothing to be compared with");
                continue;
            };
            let truth = gains[k] / gains[k + 1];
            let off = (step - truth).abs() / check.step_sigma;
            // By chance once in 16 000.
            assert!(off < 4.0, "seed {seed}, {name}: {step} ± {}", check.step_sigma);
            assert!(check.step_sigma < 0.002, "{name}: ± {}", check.step_sigma);
            (within, count) = (within + usize::from(off < 1.0), count + 1);
            // Each step is a correction, and its error is in all shorter exposures.
            let error = (check.gain / gains[k] - 1.0).abs();
            assert!(error < 0.006, "{name}: {}", check.gain);
        }
        let (ratio, covered) = against_truth(&image);
        // Uncorrected it would be off by percents; the steps are known to 0.1 %.
        assert!((ratio - 1.0).abs() < 0.002, "seed {seed}: {ratio}");
        // Of 9216 samples 0.5 % (1 sigma); the common error of the steps takes a little.
        assert!((covered - 0.683).abs() < 0.03, "seed {seed}: {covered}");
    }
    let share = within as f64 / count as f64;
    eprintln!("seeds 0 to 20: 1 sigma of a step covers {within} of {count}");
    // 60 trials: 6 % (1 sigma), three of them.
    assert!((share - 0.683).abs() < 0.18, "{share}");
}

#[test]
fn exposures_that_are_right_stay_as_they_are() {
    for seed in 0..20 {
        let (_, report) = merged(&bracket([1.0; 4], NOISE.read_noise, seed), None);
        // Four sigma: by chance in one of a thousand of these tests.
        assert!(report.exposures.iter().all(|(_, check)| check.gain == 1.0), "{report:?}");
        // One in a million samples.
        assert!(report.moved_samples <= 1, "{}", report.moved_samples);
        // 9216 samples tell a median to 1 % or so.
        let ratio = report.noise_ratio.unwrap();
        assert!((ratio - 1.0).abs() < 0.04, "{ratio}");
    }
}

#[test]
fn noise_that_is_not_the_models_is_told() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let frame = |(k, t): (usize, f64)| {
        let data = (0..SIDE * SIDE).map(|_| code(2.0 * t, 12.0, &mut rng)).collect();
        (photo(&format!("e{k}"), 1, data), t)
    };
    let frames: Vec<(Photo, f64)> = TIMES.into_iter().enumerate().map(frame).collect();
    let ratio = merged(&frames, None).1.noise_ratio.unwrap();
    // Three times the read noise; rounding and photons make 2.97 of it. 9216 samples tell it to
    // 1 %.
    assert!((ratio - 2.97).abs() < 0.1, "{ratio}");
}

#[test]
fn what_moved_is_named_and_trusted_less() {
    let still = bracket([1.0; 4], NOISE.read_noise, 5);
    let (before, _) = merged(&still, None);
    let mut moved = still;
    // Something bright stood in a corner while the third exposure was taken.
    let there = |p: usize| p % SIDE < 20 && p / SIDE < 10;
    for (p, v) in moved[2].0.data.iter_mut().enumerate().filter(|(p, _)| there(*p)) {
        *v += (0.6 * light(p) * TIMES[2]) as u16;
    }
    let (image, report) = merged(&moved, None);
    assert_eq!(report.moved_samples, 200, "{report:?}");
    // The longest weighs more than the third: that is the one which disagrees.
    assert_eq!(report.moved_by_exposure, [0, 0, 200, 0]);
    for p in 0..SIDE * SIDE {
        let (v, w) = (image.variance[p], before.variance[p]);
        // Six sigma of χ² at three degrees of freedom, and eighteen.
        if there(p) {
            assert!(v > 10.0 * w, "{p}: {v} {w}");
        } else {
            assert!((v / w - 1.0).abs() < 0.02, "{p}: {v} {w}");
        }
    }
}

#[test]
fn clipped_and_lost_pixels_are_counted() {
    let far = SIDE * SIDE - 1;
    let frame = |k: usize| {
        let mut data = vec![(500.0 + 100.0 * TIMES[k]) as u16; 3 * SIDE * SIDE];
        let mut set = |pixel: usize, codes: [u16; 3]| {
            data[3 * pixel..3 * pixel + 3].copy_from_slice(&codes);
        };
        // Clipped in one channel at every exposure; at the longest alone, which is no loss.
        set(7, [16383, 500, 500]);
        set(far, [500, 16383, 16383]);
        set(30, if k == 3 { [16383; 3] } else { [500; 3] });
        // Black in every channel; in two of three; and brighter than the read noise of 4 DN.
        set(50, [100; 3]);
        set(far - 1, [101; 3]);
        set(70, [100, 100, 500]);
        set(80, [106; 3]);
        (photo(&format!("e{k}"), 3, data), TIMES[k])
    };
    let (image, _) = merged(&[frame(0), frame(1), frame(2), frame(3)], None);
    assert_eq!((image.clipped_shortest, image.lost_longest), (2, 2));
}

/// A lens that darkens towards the edge.
fn vignette(pixel: usize) -> f64 {
    let from_middle = (pixel % SIDE) as f64 / SIDE as f64 - 0.5;
    1.0 - 1.6 * from_middle * from_middle
}

#[test]
fn a_flat_field_evens_the_picture() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let frame = |name: &str, light: f64, rng: &mut ChaCha8Rng| {
        let data = (0..SIDE * SIDE).map(|p| code(light * vignette(p), 4.0, rng)).collect();
        photo(name, 1, data)
    };
    let flats: Vec<Photo> = (0..4).map(|k| frame(&format!("flat{k}"), 1000.0, &mut rng)).collect();
    let average = |flats: &[Photo], dark: Option<&MasterDark>| {
        let all = flats.iter().cloned().map(Ok::<_, CalibrationError>);
        FlatField::average(all, dark, &Response::identity(1), &NOISE)
    };
    let flat = average(&flats, None).unwrap();
    let mean = |values: &mut dyn Iterator<Item = f64>| -> f64 {
        values.sum::<f64>() / (SIDE * SIDE) as f64
    };
    let even = mean(&mut (0..SIDE * SIDE).map(vignette));
    assert!((mean(&mut flat.gain.iter().map(|g| f64::from(*g))) - 1.0).abs() < 1e-5);
    let off = |flat: &FlatField| {
        let gains = flat.gain.iter().enumerate();
        mean(&mut gains.map(|(p, g)| (f64::from(*g) * even / vignette(p) - 1.0).powi(2))).sqrt()
    };
    // Four frames of 870 electrons in the mean, and what it says of them.
    let stated = f64::from(flat.relative_variance).sqrt();
    assert!((stated - 0.0171).abs() < 0.0003, "{stated}");
    assert!((off(&flat) / stated - 1.0).abs() < 0.1, "{} {stated}", off(&flat));
    // Dark frames instead of the model's black level.
    let darks = (0..2).map(|_| Ok::<_, CalibrationError>(frame("dark", 0.0, &mut rng)));
    let dark = MasterDark::average(1.0, darks).unwrap();
    let with_dark = average(&flats, Some(&dark)).unwrap();
    assert!((off(&with_dark) / stated - 1.0).abs() < 0.1, "{}", off(&with_dark));

    let bracket: Vec<(Photo, f64)> = TIMES[..3]
        .iter()
        .enumerate()
        .map(|(k, t)| (frame(&format!("e{k}"), 50_000.0 * t, &mut rng), *t))
        .collect();
    let (plain, _) = merged(&bracket, None);
    let (image, _) = merged(&bracket, Some(flat.clone()));
    let truth = 50_000.0 * even;
    let mut covered = 0.0;
    for p in 0..SIDE * SIDE {
        let found = f64::from(image.radiance[p]) * NOISE.full_scale;
        let variance = f64::from(image.variance[p]);
        covered +=
            if (found - truth).powi(2) < variance * NOISE.full_scale.powi(2) { 1.0 } else { 0.0 };
        // Divided by the gain, twice in the variance, and the flat field's own noise added.
        let gain = f64::from(flat.gain[p]);
        let l = f64::from(plain.radiance[p]) / gain;
        let own = f64::from(flat.relative_variance) * l * l;
        let expected = f64::from(plain.variance[p]) / (gain * gain) + own;
        assert!((variance / expected - 1.0).abs() < 1e-4, "{p}");
    }
    // Of 9216 samples 0.5 % (1 sigma).
    assert!((covered / (SIDE * SIDE) as f64 - 0.683).abs() < 0.02, "{covered}");

    let told = |result: Result<FlatField, CalibrationError>| result.unwrap_err().to_string();
    let bright = frame("bright", 40_000.0, &mut rng);
    let error = told(average(&[flats[0].clone(), bright], None));
    assert!(error.contains("bright") && error.contains("saturated"), "{error}");
    let mut shaded = flats[0].clone();
    shaded.data[40] = 100;
    let error = told(average(&[shaded], None));
    assert!(error.contains("flat0") && error.contains("light on every pixel"), "{error}");
}

/// A camera whose codes are a power of the light: what its read noise is in light depends on how
/// much there is, in the dark on what noise makes of it unless neighbours help.
#[test]
fn the_noise_of_a_curved_camera_is_that_of_its_light() {
    const GAMMA: f64 = 2.2;
    let curve = (0..KNOTS).map(|k| (k as f64 / (KNOTS - 1) as f64).powf(GAMMA)).collect();
    let response = Response::from_exposures(vec![curve]).unwrap();
    let noise = NoiseModel {
        black_level: 2000.0,
        read_noise: 500.0,
        gain: 0.1,
        full_scale: 65535.0,
        saturation: 65535.0,
    };
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let full = noise.full_scale;
    let black = response.linearise(noise.black_level / full, 0);
    // In the longest exposure codes from 0.1 to 10 times the read noise above black.
    let scene = |p: usize| {
        let above = noise.read_noise * 0.1 * 100_f64.powf((p % SIDE) as f64 / SIDE as f64);
        response.linearise((noise.black_level + above) / full, 0) - black
    };
    let times: Vec<f64> = (0..5).map(|k| 2_f64.powi(k) / 16.0).collect();
    let rows = 2000;
    let mut merger = Merger::new(&response, &noise).unwrap();
    // The code of an exposure, by bisection of the response as it is.
    let code_of = |exposure: f64| {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..50 {
            let middle = 0.5 * (low + high);
            if response.linearise(middle, 0) < exposure { low = middle } else { high = middle }
        }
        full * low
    };
    for (k, &t) in times.iter().enumerate() {
        let exact: Vec<f64> = (0..SIDE).map(|x| code_of(black + scene(x) * t)).collect();
        let data = (0..SIDE * rows)
            .map(|p| (exact[p % SIDE] + noise.read_noise * normal(&mut rng)).round() as u16)
            .collect();
        merger.add(Photo { max_value: 65535, ..photo(&format!("e{k}"), 1, data) }, t).unwrap();
    }
    let (image, _) = merger.finish().unwrap();
    // Beside the edges, where the next row's end is among the neighbours.
    for from in (8..56).step_by(8) {
        let samples = (0..rows).flat_map(|y| (from..from + 8).map(move |x| y * SIDE + x));
        let squares = samples.map(|p| {
            let off = f64::from(image.radiance[p]) - scene(p);
            off * off / f64::from(image.variance[p])
        });
        let chi2 = squares.sum::<f64>() / (8 * rows) as f64;
        eprintln!("columns from {from}: squares over stated variance {chi2:.3}");
        // 16 000 samples tell it to 1.1 % (1 sigma), and the bend of the curve makes the noise of
        // one sample a little lopsided: 4 % at most. With variances from a first guess, which
        // are those of each sample's own noise, it is 0.83 to 0.9.
        assert!((chi2 - 1.0).abs() < 0.07, "columns from {from}: {chi2}");
    }
}

/// Blocks of lanes that are not full must not look at what other blocks left in them: which blocks
/// came before on a thread depends on the number of threads, and on chance.
#[test]
fn a_merge_is_the_same_on_any_number_of_threads() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let curve = (0..KNOTS).map(|k| (k as f64 / (KNOTS - 1) as f64).powf(2.2)).collect();
    let response = Response::from_exposures(vec![curve]).unwrap();
    // Some of it so dim that neighbours are asked; 29 rows fill no whole number of blocks. The
    // shortest exposure has more light than its time says, so that it is corrected by what the
    // few samples tell.
    let frames: Vec<(Photo, f64)> = TIMES
        .into_iter()
        .map(|t| {
            let gain = if t == TIMES[0] { 1.2 } else { 1.0 };
            let exposure = |p| (light(p) * gain * t / 65535.0).powf(1.0 / 2.2) * 16000.0;
            let data = (0..SIDE * 29).map(|p| code(exposure(p), 4.0, &mut rng)).collect();
            (photo("dim", 1, data), t)
        })
        .collect();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (image, report) = pool.install(|| {
            let mut merger = Merger::new(&response, &NOISE).unwrap();
            frames.iter().for_each(|(photo, t)| merger.add(photo.clone(), *t).unwrap());
            merger.finish().unwrap()
        });
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        // The report shows what the first, coarse look at the exposures found.
        (bits(&image.radiance), bits(&image.variance), format!("{report:?}"))
    };
    let one = on(1);
    for threads in [2, 3, 5, 8, 16] {
        for round in 0..10 {
            assert!(on(threads) == one, "{threads} threads, round {round}");
        }
    }
}
