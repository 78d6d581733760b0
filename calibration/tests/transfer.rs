//! Photon transfer on frames of a sensor that is known.

use calibration::{CalibrationError, Estimate, Photo, PhotonTransfer, SensorNoise};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Poisson, StandardNormal};

const SIDE: usize = 48;
const GAIN: f64 = 0.8;
const READ: f64 = 5.0;
const BLACK: f64 = 64.0;
/// Electrons a second.
const DARK: f64 = 12.0;

/// A frame of a sensor whose pixels differ by 2 % in gain and by 3 DN in black.
fn frame(name: &str, light: f64, exposure_s: f64, rng: &mut ChaCha8Rng) -> Photo {
    let data = (0..SIDE * SIDE).map(|p| {
        let mut pattern = ChaCha8Rng::seed_from_u64(p as u64);
        let own: f64 = 1.0 + 0.02 * pattern.sample::<f64, _>(StandardNormal);
        let offset: f64 = 3.0 * pattern.sample::<f64, _>(StandardNormal);
        let mean = (light * own + DARK) * exposure_s;
        let electrons = Poisson::new(mean.max(1e-9)).map_or(0.0, |p| p.sample(rng));
        let read: f64 = READ * rng.sample::<f64, _>(StandardNormal);
        (BLACK + offset + GAIN * (electrons + read)).round().clamp(0.0, 65535.0) as u16
    });
    let data = data.collect();
    Photo { width: SIDE, height: SIDE, channels: 1, data, max_value: 65535, name: name.into() }
}

fn measure(seed: u64) -> SensorNoise {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut transfer = PhotonTransfer::new(Some(16383.0));
    for light in [20.0, 200.0, 1000.0, 4000.0, 10_000.0] {
        let [a, b] = ["one", "other"].map(|name| frame(name, light, 1.0, &mut rng));
        transfer.add_flats(&a, &b).unwrap();
    }
    for seconds in [0.01, 2.0, 8.0] {
        let [a, b] = ["dark", "dark too"].map(|name| frame(name, 0.0, seconds, &mut rng));
        transfer.add_darks(&a, &b, seconds).unwrap();
    }
    transfer.finish().unwrap()
}

#[test]
fn the_stated_sigma_covers_the_truth() {
    // The pattern of black levels is the sensor's: its mean is what "black" means.
    let offsets = (0..SIDE * SIDE).map(|p| {
        let mut pattern = ChaCha8Rng::seed_from_u64(p as u64);
        let _: f64 = pattern.sample(StandardNormal);
        3.0 * pattern.sample::<f64, _>(StandardNormal)
    });
    let black = BLACK + offsets.sum::<f64>() / (SIDE * SIDE) as f64;
    let repeats = 200;
    let mut covered = [0_usize; 5];
    let mut chi2 = 0.0;
    for seed in 0..repeats {
        let found = measure(seed);
        let hit = |estimate: Estimate, truth: f64| (estimate.value - truth).abs() < estimate.sigma;
        let all = [
            hit(found.electrons_per_dn, 1.0 / GAIN),
            hit(found.read_noise_e, READ),
            hit(found.black_level_dn, black),
            hit(found.dark_current_dn_s.unwrap(), GAIN * DARK),
            hit(found.full_well_e, (16383.0 - black) / GAIN),
        ];
        all.iter().zip(&mut covered).for_each(|(hit, count)| *count += usize::from(*hit));
        chi2 += found.reduced_chi2 / repeats as f64;
    }
    let share = covered.map(|c| c as f64 / repeats as f64);
    eprintln!("seeds 0 to {repeats}: covered {share:?}, reduced χ² {chi2:.3}");
    for share in share {
        // 200 repeats tell 0.68 to 0.033 (1 sigma): three of them.
        assert!((share - 0.683).abs() < 0.1, "{share}");
    }
    // Six degrees of freedom, 200 times: 0.04 (1 sigma).
    assert!((chi2 - 1.0).abs() < 0.15, "{chi2}");
}

#[test]
fn frames_that_cannot_tell_are_named() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut transfer = PhotonTransfer::new(Some(4000.0));
    let dim = frame("dim", 100.0, 1.0, &mut rng);
    let bright = frame("bright", 6000.0, 1.0, &mut rng);
    let small = Photo { width: SIDE / 2, height: SIDE * 2, ..frame("small", 100.0, 1.0, &mut rng) };
    let named = |result: Result<(), CalibrationError>, words: [&str; 2]| {
        let Err(error) = result else { panic!("not refused") };
        let told = error.to_string();
        assert!(words.iter().all(|word| told.contains(word)), "{told}");
    };
    named(transfer.add_flats(&bright, &bright), ["bright", "saturated"]);
    let brighter = frame("brighter", 150.0, 1.0, &mut rng);
    named(transfer.add_flats(&dim, &brighter), ["brighter", "dim"]);
    named(transfer.add_flats(&dim, &small), ["small", "dim"]);
    transfer.add_darks(&dim, &dim, 1.0).unwrap();
    let result = transfer.finish().map(|_| ());
    named(result, ["pairs of flat frames", "2"]);
}

/// A 12-bit sensor in a 16-bit file: samples pile up at 4095, and nothing else tells.
#[test]
fn saturation_below_full_scale_and_copied_frames_are_refused() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let clipped = |name: &str, light: f64, rng: &mut ChaCha8Rng| {
        let mut photo = frame(name, light, 1.0, rng);
        photo.data.iter_mut().for_each(|v| *v = (*v).min(4095));
        photo
    };
    let mut transfer = PhotonTransfer::new(None);
    let [a, b] = ["one.png", "other.png"].map(|name| clipped(name, 4000.0, &mut rng));
    transfer.add_flats(&a, &b).unwrap();
    // About a third, and all, of the samples at the brightest code.
    for light in [5000.0, 9000.0] {
        let [a, b] = ["bright.png", "brighter.png"].map(|name| clipped(name, light, &mut rng));
        let error = transfer.add_flats(&a, &b).unwrap_err().to_string();
        assert!(error.contains("bright.png") && error.contains("4095 DN"), "{error}");
    }
    let copy = Photo { name: "copy.png".into(), ..a.clone() };
    let error = transfer.add_flats(&a, &copy).unwrap_err().to_string();
    assert!(error.contains("copy.png") && error.contains("one.png"), "{error}");
}

/// A brightest code that many samples share by noise alone is no saturation, nor is one of 8 bits,
/// where noise may be less than a code.
#[test]
fn a_full_top_code_that_is_noise_is_no_saturation() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let mut dim = |name: &str, max_value: u16, mean: f64, sigma: f64| {
        let mut photo = frame(name, 0.0, 1.0, &mut rng);
        for v in &mut photo.data {
            let noise: f64 = rng.sample(StandardNormal);
            *v = (mean + sigma * noise).clamp(39.0, 42.0).round() as u16;
        }
        Photo { max_value, ..photo }
    };
    // About 4 % at 42, some 35 % at 41; in 8 bits nine in ten at 40, the rest below.
    let wide = ["one", "other"].map(|name| dim(name, 65535, 40.3, 0.7));
    let narrow = ["one", "other"].map(|name| dim(name, 255, 39.7, 0.15));
    for (pair, saturation) in [(wide, 16383.0), (narrow, 255.0)] {
        let brightest = pair[0].data.iter().max().unwrap();
        let there = pair[0].data.iter().filter(|v| *v == brightest).count();
        assert!(there as f64 > 0.01 * pair[0].data.len() as f64, "{there} at {brightest}");
        PhotonTransfer::new(Some(saturation)).add_flats(&pair[0], &pair[1]).unwrap();
    }
}
