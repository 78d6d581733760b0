use super::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const NOISE: FrameNoise = FrameNoise { dark: 3e-4, photons: 4e-5, saturation: 0.98 };

/// The least time of all subsets, by trying them all, from the formulas alone.
fn by_trying_all(
    channels: &[ChannelBrightness],
    times: &[f64],
    frame_s: f64,
    goal: &NoiseGoal,
) -> f64 {
    let variance = |c: &ChannelBrightness, l: f64, taken: &[f64]| {
        let FrameNoise { dark, photons, saturation } = c.noise;
        let usable = taken.iter().filter(|t| l * **t <= saturation);
        // From 0: the sum of nothing is −0, whose inverse is −∞.
        let sum = usable.fold(0.0, |s, t| s + t * t / (dark * dark + photons * l * t));
        1.0 / sum + c.floor * c.floor
    };
    let mut best = f64::INFINITY;
    for subset in 0_u32..1 << times.len() {
        if subset.count_ones() < 2 {
            continue;
        }
        let taken: Vec<f64> =
            (0..times.len()).filter(|k| subset >> k & 1 == 1).map(|k| times[k]).collect();
        let good = channels.iter().all(|c| {
            c.radiances.iter().all(|&l| {
                let whole = variance(c, l, times);
                whole.is_infinite()
                    || variance(c, l, &taken) <= goal.tolerance.powi(2) * whole * (1.0 + 1e-9)
            })
        });
        if good {
            best = best.min(taken.iter().map(|t| t + frame_s).sum());
        }
    }
    best
}

/// Two radiances a channel, which are classes themselves: those between would only ask more,
/// so what is chosen may take longer, never less; and with a single radiance exactly as long.
#[test]
fn no_subset_that_does_takes_less_time() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut smaller = 0;
    for case in 0..200 {
        let count = rng.random_range(2..9);
        let times: Vec<f64> = (0..count).map(|_| 10f64.powf(rng.random_range(-1.5..1.0))).collect();
        let mut channel = || {
            let radiance = 10f64.powf(rng.random_range(-3.0..1.5));
            let floor = if rng.random_range(0..2) == 0 {
                0.0
            } else {
                radiance * rng.random_range(0.0..0.05)
            };
            ChannelBrightness { noise: NOISE, radiances: vec![radiance], floor }
        };
        let channels = [channel(), channel(), channel()];
        let goal =
            NoiseGoal { tolerance: rng.random_range(1.0..1.5), left_out: 0.0, head_room: 1.0 };
        let frame_s = rng.random_range(0.0..1.0);
        let expected = by_trying_all(&channels, &times, frame_s, &goal);
        let found = match choose_exposures(&channels, &times, frame_s, &goal) {
            Ok(found) => found,
            Err(error) => {
                assert_eq!(error, ExposureChoiceError::NothingToSee, "case {case}");
                continue;
            }
        };
        // Sums in another order.
        assert!((found.time_s - expected).abs() < 1e-9, "case {case}: {found:?}, {expected} s");
        assert!(found.worst <= goal.tolerance * (1.0 + 1e-6), "case {case}: {found:?}");
        assert!(found.exposures_s.iter().all(|t| times.contains(t)));
        assert!(found.exposures_s.is_sorted());
        smaller += usize::from(found.time_s < found.bracket_time_s);
    }
    assert!(smaller > 100, "{smaller} of 200 cases had a choice at all");
}

#[test]
fn every_place_of_the_picture_and_of_a_brighter_one_reaches_the_goal() {
    let radiances: Vec<f64> = (0..500).map(|i| 1e-3 * 1.02_f64.powi(i)).collect();
    let brightest = radiances[499];
    let channel =
        ChannelBrightness { noise: NOISE, radiances: radiances.clone(), floor: 0.003 * brightest };
    let times = crate::bracket(1.0 / 30.0, 8.0, 9);
    let goal = NoiseGoal { tolerance: 1.05, left_out: 0.0, head_room: 2.0 };
    let found = choose_exposures(std::slice::from_ref(&channel), &times, 0.5, &goal).unwrap();
    assert!(found.time_s < found.bracket_time_s / 3.0, "{found:?}");
    let variance = |l: f64, times: &[f64]| {
        1.0 / times.iter().map(|&t| NOISE.information(l, t)).sum::<f64>() + channel.floor.powi(2)
    };
    for l in radiances.iter().copied().chain([1.3, 1.7, 2.0].map(|x| x * brightest)) {
        let (chosen, whole) = (variance(l, &found.exposures_s), variance(l, &times));
        // Between two classes, a third of a stop apart, an exposure may clip a little early.
        assert!(chosen <= 1.07_f64.powi(2) * whole || whole.is_infinite(), "{l}: {chosen} {whole}");
    }
}

/// Photons rule here: 0.3 and 0.45 s have 88 % of the bracket's light, which a fifth more noise
/// allows, and are clipped where it is twice as bright.
#[test]
fn head_room_keeps_the_exposure_that_a_brighter_picture_needs() {
    let noise = FrameNoise { dark: 1e-5, ..NOISE };
    let channel = ChannelBrightness { noise, radiances: vec![2.0], floor: 0.0 };
    let choose = |head_room| {
        let goal = NoiseGoal { tolerance: 1.2, left_out: 0.0, head_room };
        let channel = std::slice::from_ref(&channel);
        choose_exposures(channel, &[0.1, 0.3, 0.45], 0.5, &goal).unwrap().exposures_s
    };
    assert_eq!(choose(1.0), [0.3, 0.45]);
    assert_eq!(choose(2.0), [0.1, 0.3, 0.45]);
}

/// Where nothing but the camera's noise counts, the dark places ask for all of the time.
#[test]
fn without_a_floor_the_dark_places_keep_the_long_exposures() {
    let channel = ChannelBrightness { noise: NOISE, radiances: vec![1e-4, 0.1], floor: 0.0 };
    let times = crate::bracket(1.0 / 30.0, 8.0, 9);
    let goal = NoiseGoal { tolerance: 1.0, left_out: 0.0, head_room: 1.0 };
    let found = choose_exposures(&[channel], &times, 0.5, &goal).unwrap();
    assert_eq!(found.exposures_s, times);
    assert!((found.worst - 1.0).abs() < 1e-9);
}

#[test]
fn glints_that_are_left_out_do_not_count() {
    let mut radiances = vec![0.05; 999];
    radiances.push(20.0);
    let channel = ChannelBrightness { noise: NOISE, radiances, floor: 1e-4 };
    let times = crate::bracket(1.0 / 30.0, 8.0, 9);
    let goal = |left_out| NoiseGoal { tolerance: 1.05, left_out, head_room: 1.0 };
    let choose = |left_out| {
        choose_exposures(std::slice::from_ref(&channel), &times, 0.5, &goal(left_out)).unwrap()
    };
    assert!(choose(0.0).exposures_s[0] < 0.05);
    assert!(choose(1e-3).exposures_s[0] > 0.05);
}

#[test]
fn what_makes_no_sense_is_named() {
    let channel = ChannelBrightness { noise: NOISE, radiances: vec![0.1], floor: 0.0 };
    let goal = NoiseGoal { tolerance: 1.05, left_out: 0.0, head_room: 1.0 };
    let choose = |channel: &ChannelBrightness, times: &[f64], goal| {
        choose_exposures(std::slice::from_ref(channel), times, 0.5, &goal)
    };
    assert_eq!(choose(&channel, &[], goal), Err(ExposureChoiceError::Bracket(vec![])));
    assert!(matches!(
        choose(&channel, &[1.0, f64::NAN], goal),
        Err(ExposureChoiceError::Bracket(_))
    ));
    let bright = ChannelBrightness { radiances: vec![1e6], ..channel.clone() };
    assert_eq!(choose(&bright, &[1.0], goal), Err(ExposureChoiceError::NothingToSee));
    let none = ChannelBrightness { radiances: vec![], ..channel.clone() };
    assert_eq!(choose(&none, &[1.0], goal), Err(ExposureChoiceError::NothingToSee));
    let spoilt = NoiseGoal { tolerance: 0.9, ..goal };
    let error = choose(&channel, &[1.0], spoilt).unwrap_err().to_string();
    assert!(error.contains("tolerance") && error.contains("0.9"), "{error}");
    assert_eq!(choose(&channel, &[1.0], goal).unwrap().exposures_s, [1.0]);
}
