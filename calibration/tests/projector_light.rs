//! A projector's response, black and colour wheel, from pictures of which the truth is known.

use calibration::{
    BurstFrame, CalibrationError, HdrImage, ProjectorFlatField, find_colour_wheel,
    measure_projector_light,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A normal number, near enough.
fn normal(rng: &mut ChaCha8Rng) -> f64 {
    (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
}

/// A sheet that is brightest on the left, under light of three channels, with noise.
fn sheet(light: [f64; 3], noise: f64, rng: &mut ChaCha8Rng) -> HdrImage {
    let (width, height) = (40, 30);
    let radiance = (0..width * height * 3).map(|i| {
        let (pixel, channel) = (i / 3, i % 3);
        let here = if pixel % width < 30 { 1.0 - 0.01 * (pixel % width) as f64 } else { 0.02 };
        (here * light[channel] + noise * normal(rng)) as f32
    });
    let radiance: Vec<f32> = radiance.collect();
    HdrImage {
        width,
        height,
        channels: 3,
        variance: vec![(noise * noise) as f32; radiance.len()],
        radiance,
        variance_known: true,
        clipped_shortest: 0,
        lost_longest: 0,
    }
}

const GAMMA: [f64; 3] = [2.2, 1.8, 2.4];
const BLACK: f64 = 1.0 / 800.0;

fn ramp(seed: u64, noise: f64) -> Vec<(f64, HdrImage)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let level = |i: usize| i as f64 / 51.0;
    let light = |x: f64| GAMMA.map(|g| BLACK + (1.0 - BLACK) * x.powf(g));
    (0..52).map(|i| (level(i), sheet(light(level(i)), noise, &mut rng))).collect()
}

#[test]
fn the_response_is_recovered_with_its_uncertainty() {
    let (mut covered, mut count) = (0, 0);
    for seed in 0..10 {
        let found = measure_projector_light(&ramp(seed, 0.02)).unwrap();
        for (channel, gamma) in found.channels.iter().zip(GAMMA) {
            // 900 pixels of 2 % noise: 8e-4 of a level, and white's and black's are shared by
            // all; light changes by 0.2 for each unit of the exponent: 0.02 is five sigma.
            assert!((channel.gamma - gamma).abs() < 0.02, "{seed}: {}", channel.gamma);
            assert!((channel.black - BLACK).abs() < 4.0 * channel.black_sigma, "{}", channel.black);
            assert!(channel.light.windows(2).all(|pair| pair[0] <= pair[1]));
            for (i, (light, sigma)) in channel.light.iter().zip(&channel.sigma).enumerate() {
                let x = i as f64 / 51.0;
                // Where levels are closer than their noise, pooling makes them better than sigma.
                if (0.35..0.95).contains(&x) {
                    covered += usize::from((light - x.powf(gamma)).abs() < *sigma);
                    count += 1;
                }
            }
        }
    }
    let coverage = f64::from(covered as u32) / f64::from(count);
    eprintln!("1 sigma covers {coverage:.3} of {count} levels");
    // Levels of one ramp share their black and white: 30 ramps, 8 % is one sigma of those.
    assert!((0.55..0.80).contains(&coverage), "{coverage}");
}

#[test]
fn light_and_input_are_each_others_inverse() {
    let mut ramp = ramp(1, 1e-4);
    // The room lights what the projector does not.
    for (_, picture) in &mut ramp {
        let pixels = picture.radiance.chunks_exact_mut(3).enumerate();
        pixels.filter(|(p, _)| p % 40 >= 30).for_each(|(_, pixel)| pixel.fill(0.2));
    }
    let found = measure_projector_light(&ramp).unwrap();
    for i in 1..20 {
        let input = f64::from(i) / 20.0;
        let light = found.light(2, input).unwrap();
        // Straight lines over a fiftieth of a power curve: a quarter of the bend, 3e-4.
        assert!((light - input.powf(2.4)).abs() < 1e-3, "{input} {light}");
        assert!((found.input(2, light).unwrap() - input).abs() < 1e-9);
    }
    assert_eq!(found.light(3, 0.5), None);
    for channel in &found.channels {
        // 900 pixels of 0.01 % noise under light of 0.84 in the mean: 4e-6, a three-hundredth.
        assert!((channel.black / BLACK - 1.0).abs() < 0.02, "{}", channel.black);
    }
}

#[test]
fn a_ramp_that_says_too_little_is_refused() {
    let whole = ramp(2, 1e-3);
    let refused = |ramp: &[(f64, HdrImage)]| measure_projector_light(ramp).unwrap_err().to_string();
    assert!(refused(&whole[1..]).contains("0.0196"), "no black");
    assert!(refused(&whole[..51]).contains("levels"), "no white");
    assert!(refused(&[]).contains("[]"));
    let mut twice = whole.clone();
    twice[7].0 = twice[8].0;
    assert!(refused(&twice).contains("different levels"));
    let mut small = whole.clone();
    small[5].1.width = 20;
    assert!(refused(&small).contains("level 0.098"));
    let mut clipped = whole;
    clipped[51].1.variance.fill(f32::INFINITY);
    assert!(refused(&clipped).contains("no pixel"));
}

/// A lamp that dims during the ramp, as a projector that has just been switched on.
#[test]
fn a_fall_of_the_light_is_reported() {
    let mut falling = ramp(3, 1e-3);
    assert!(measure_projector_light(&falling).unwrap().channels[0].largest_fall < 3.0);
    for value in &mut falling[40].1.radiance {
        *value *= 0.9;
    }
    let found = measure_projector_light(&falling).unwrap();
    assert!(found.channels[0].largest_fall > 20.0, "{}", found.channels[0].largest_fall);
    assert!(found.channels[0].light.windows(2).all(|pair| pair[0] <= pair[1]));
}

/// A burst under a wheel of three colours whose segments overlap a little, times noise.
fn burst(turn_s: f64, depth: f64, noise: f64, seed: u64) -> Vec<BurstFrame> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut out = Vec::new();
    for i in 0..32 {
        let step = (f64::from(i) + 0.33 * (2.4 * f64::from(i * i)).sin()).clamp(0.0, 31.0);
        let exposure_s = 0.001 + (0.04 - 0.001) * step / 31.0;
        for _ in 0..4 {
            let begin: f64 = rng.random();
            let turns = exposure_s / turn_s;
            let radiance = (0..3).map(|c| {
                // Mean over the exposure, by many moments of it.
                let moments = 600;
                let mean = (0..moments).map(|m| {
                    let at = begin + turns * (m as f64 + 0.5) / moments as f64;
                    let within = (at - at.floor() - c as f64 / 3.0).rem_euclid(1.0);
                    if within < 1.0 / 3.0 { 3.0 } else { 0.0 }
                });
                let wheel = mean.sum::<f64>() / moments as f64;
                0.7 * (1.0 + depth * (wheel - 1.0)) * (1.0 + noise * normal(&mut rng))
            });
            out.push(BurstFrame { exposure_s, radiance: radiance.collect() });
        }
    }
    out
}

#[test]
fn a_colour_wheel_is_found_with_its_uncertainty() {
    let (mut covered, mut count) = (0, 0);
    for (i, turn_s) in
        [1.0 / 120.0, 1.0 / 60.0, 1.0 / 180.0, 1.0 / 240.0, 0.0071].iter().enumerate()
    {
        for seed in 0..6 {
            let wheel = find_colour_wheel(&burst(*turn_s, 1.0, 1e-3, 10 * i as u64 + seed));
            let wheel = wheel.unwrap().unwrap();
            let miss = (wheel.turn_s - turn_s).abs();
            assert!(
                miss < 0.02 * turn_s,
                "{turn_s} found as {} ± {}",
                wheel.turn_s,
                wheel.turn_sigma_s
            );
            covered += usize::from(miss < wheel.turn_sigma_s);
            count += 1;
            // A whole number of turns hides the wheel; half a turn more shows it.
            let whole = wheel.whole_turns_s(0.0);
            assert!(whole >= 0.999 / 30.0 && whole < 1.0 / 30.0 + 1.01 * turn_s, "{whole}");
            let scatter = |t: f64| wheel.scatter(t).into_iter().fold(0.0, f64::max);
            assert!(scatter(turn_s * 1.5) > 4.0 * scatter(wheel.turn_s), "{turn_s}");
        }
    }
    eprintln!("1 sigma of the turn covers {covered} of {count}");
    // 30 trials: 68 % ± 9 %. A wheel's sample variances scatter less than normal numbers' do, so
    // that sigma is rather too large: three sigma up, two down.
    assert!((0.50..0.96).contains(&(f64::from(covered as u32) / f64::from(count))), "{covered}");
}

#[test]
fn a_steady_light_has_no_wheel() {
    for seed in 0..20 {
        assert_eq!(
            find_colour_wheel(&burst(1.0 / 120.0, 0.0, 1e-3, seed)).unwrap(),
            None,
            "{seed}"
        );
    }
    let few: Vec<_> = burst(1.0 / 120.0, 1.0, 1e-3, 0).into_iter().take(20).collect();
    assert!(matches!(find_colour_wheel(&few), Err(CalibrationError::BadInput { .. })));
    assert!(find_colour_wheel(&[]).is_err());
}

#[test]
fn evenness_is_told_by_projector_pixel() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let white = sheet([1.0; 3], 1e-3, &mut rng);
    // The camera's columns run along the projector's, mirrored.
    let field = ProjectorFlatField::measure(&white, [80, 60], [4, 3], |[x, y]| {
        Some([79.0 - 2.0 * x, 2.0 * y])
    })
    .unwrap();
    // Ten camera columns a cell, from the right: unlit, then 0.745, 0.845 and 0.945 in the mean.
    let brightest = 0.9505;
    for (cell, truth) in [(0, 0.02), (1, 0.7505), (2, 0.8505), (3, 0.9505)] {
        let found = field.irradiance[4 + cell].unwrap();
        assert!((found - truth / brightest).abs() < 0.01, "{cell}: {found}");
        // The noise of three channels over 100 pixels' light.
        let sigma = field.sigma[4 + cell].unwrap() * 3.0 * brightest / 3_f64.sqrt();
        assert!((sigma * 10.0 / 1e-3 - 1.0).abs() < 0.01, "{sigma}");
    }
    // The sheet ends within a cell: what counts is the light of a pixel, not of the cell.
    let half = ProjectorFlatField::measure(&white, [80, 60], [4, 3], |[x, y]| {
        (y < 25.0 && x < 30.0).then_some([79.0 - 2.0 * x, 2.0 * y])
    })
    .unwrap();
    assert!((half.irradiance[9].unwrap() - 0.7505 / brightest).abs() < 0.01);
    assert_eq!(half.irradiance[8], None);
    assert!(ProjectorFlatField::measure(&white, [80, 60], [4, 3], |_| None).is_err());
}
