//! Colours whose truth is known.

use calibration::{
    CalibrationError, ChartReference, ColourModel, Illuminant, Patch, calibrate_colour,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A camera's R, G, B from X, Y, Z: inverse of some sensor's matrix.
const CAMERA: [[f64; 3]; 3] = [[1.6, -0.2, -0.1], [-0.4, 1.3, 0.1], [0.05, -0.1, 0.8]];

fn chart(seen: impl Fn(usize, [f64; 3]) -> [f64; 3]) -> [Patch; 24] {
    let reference = ChartReference::published();
    std::array::from_fn(|i| {
        let xyz = reference.xyz[i];
        let rgb = CAMERA.map(|row| (0..3).map(|c| row[c] * xyz[c]).sum::<f64>());
        Patch {
            centre: [0.0; 2],
            radiance: seen(i, rgb),
            standard_error: [0.0; 3],
            unevenness: 0.0,
            clipped: 0.0,
        }
    })
}

#[test]
fn a_camera_that_is_a_matrix_is_found() {
    // In any unit of light.
    let patches = chart(|_, rgb| rgb.map(|v| 37.0 * v));
    let found = calibrate_colour(&patches, &ChartReference::published()).unwrap();
    assert_eq!(found.correction.model, ColourModel::Matrix, "{}", found.why);
    let score = found.score().unwrap();
    // Rounding: solved in double precision, differences of cube roots.
    assert!(score.fitted.max < 1e-6 && score.left_out.max < 1e-6, "{score:?}");
    let xyz = found.correction.apply(patches[14].radiance);
    let truth = ChartReference::published().xyz[14];
    assert!((0..3).all(|i| (xyz[i] - truth[i]).abs() < 1e-9), "{xyz:?} {truth:?}");
    assert!(found.balanced.mean > 1.0, "a balance is no matrix: {:?}", found.balanced);
    let text = serde_json::to_string(&found).unwrap();
    let read: calibration::ColourCalibration = serde_json::from_str(&text).unwrap();
    assert_eq!(read.correction, found.correction);
}

#[test]
fn noise_alone_does_not_buy_a_richer_model() {
    let mut richer = 0;
    for seed in 0..20 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let noise: Vec<[f64; 3]> =
            (0..24).map(|_| std::array::from_fn(|_| rng.random::<f64>() - 0.5)).collect();
        let patches = chart(|i, rgb| std::array::from_fn(|c| rgb[c] * (1.0 + 0.1 * noise[i][c])));
        let found = calibrate_colour(&patches, &ChartReference::published()).unwrap();
        richer += usize::from(found.correction.model != ColourModel::Matrix);
        let (first, last) = (&found.models[0], &found.models[3]);
        // More terms always fit better and here never foretell better.
        assert!(last.fitted.mean < first.fitted.mean, "seed {seed}: {:?}", found.models);
        assert!(last.left_out.mean > first.left_out.mean, "seed {seed}: {:?}", found.models);
    }
    // One standard error is exceeded by chance one time in six, for each of three models.
    assert!(richer <= 8, "{richer} of 20");
}

#[test]
fn stray_light_is_seen_and_taken_off() {
    let patches = chart(|_, rgb| rgb.map(|v| v + 0.05));
    let found = calibrate_colour(&patches, &ChartReference::published()).unwrap();
    assert_eq!(found.correction.model, ColourModel::Affine, "{}", found.why);
    assert!(found.score().unwrap().left_out.max < 1e-6);
    assert!(found.models[0].left_out.mean > 1.0, "{:?}", found.models[0]);
}

#[test]
fn clipped_patches_are_left_out_and_too_many_refused() {
    let mut patches = chart(|_, rgb| rgb);
    for i in [5, 11] {
        patches[i].clipped = 0.5;
        patches[i].radiance = [0.3; 3];
    }
    let found = calibrate_colour(&patches, &ChartReference::published()).unwrap();
    let score = found.score().unwrap();
    assert!(score.fitted.max < 1e-6, "{score:?}");
    assert!(found.patches[5].left_out.is_none() && found.patches[5].delta_e > 5.0);
    patches[..7].iter_mut().for_each(|p| p.clipped = 1.0);
    let error = calibrate_colour(&patches, &ChartReference::published());
    assert!(matches!(error, Err(CalibrationError::ChartNotFound { .. })), "{error:?}");
    // One colour throughout determines nothing.
    let grey = chart(|_, rgb| [rgb[1]; 3]);
    assert!(calibrate_colour(&grey, &ChartReference::published()).is_err());
}

#[test]
fn measured_patches_are_read_or_refused_by_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("patches.csv");
    let load = |text: &str| {
        std::fs::write(&path, text).unwrap();
        ChartReference::load(&path, Illuminant::D50)
    };
    let published = ChartReference::published();
    let mut per_cent = String::from("# chart 7\nname;X;Y;Z\n");
    let mut lab = String::from("L,a,b\n");
    for (i, xyz) in published.xyz.iter().enumerate() {
        let [x, y, z] = xyz.map(|v| 100.0 * v);
        per_cent += &format!("\"patch {i}\";{x};{y};{z}\n");
        lab += &format!("{},0,0\n", if i < 18 { 50 } else { 95 - 12 * (i - 18) });
    }
    let read = load(&per_cent).unwrap();
    let off = read.xyz.iter().flatten().zip(published.xyz.iter().flatten());
    assert!(off.into_iter().all(|(a, b)| (a - b).abs() < 1e-12));
    // L = 50 has Y = 0.184; without a and b it has the white's colour.
    let grey = load(&lab).unwrap().xyz[3];
    assert!((grey[1] - 0.1842).abs() < 1e-4 && (grey[0] / grey[1] - 0.9642).abs() < 1e-9);
    let short: String = per_cent.lines().take(20).map(|l| format!("{l}\n")).collect();
    for (text, word) in [
        ("", "heading"),
        ("R,G,B\n1,2,3\n", "heading"),
        (short.as_str(), "24 patches"),
        (&per_cent.replace("\"patch 3\";", "\"patch 3\";x"), "line 6"),
        (&per_cent.replace("\"patch 3\";", "\"patch 3\";NaN;"), "line 6"),
        (&lab.replace("95,0,0", "20,0,0"), "darkens"),
        (&per_cent.replacen("patch 3\";", "patch 3\";-1;-1;-1;", 1), "luminances"),
    ] {
        let message = load(text).unwrap_err().to_string();
        assert!(message.contains(word) && message.contains("patches.csv"), "{word}: {message}");
    }
}
