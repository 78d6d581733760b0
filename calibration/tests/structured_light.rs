//! Gray code and phase shift on a rendered plane of which every projector pixel is known.

use calibration::{CalibrationError, CodeLayout, CodePicture, Photo, decode, light_corners};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SIZE: [usize; 2] = [200, 150];
/// Rays along each edge of a camera pixel.
const RAYS: usize = 4;

/// A camera's view of a plane that a projector lights.
struct View {
    layout: CodeLayout,
    /// Light by way of other points over direct light.
    indirect: f64,
    /// Standard deviation of a code.
    noise: f64,
    mirrored: bool,
    /// The projector's pixels run into each other.
    soft: bool,
}

impl View {
    fn new(layout: CodeLayout) -> Self {
        Self { layout, indirect: 0.1, noise: 1.0, mirrored: false, soft: false }
    }

    /// The projector pixel that lights a place in the camera's picture.
    fn truth(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let x = if self.mirrored { SIZE[0] as f64 - x } else { x };
        let below = 1.0 + 4e-4 * x - 2e-4 * y;
        // Less than two camera pixels a projector pixel, turned by some degrees.
        [(0.52 * x + 0.04 * y + 1.3) / below, (-0.03 * x + 0.55 * y + 9.7) / below]
    }

    /// Where the rays of each camera pixel end in the projector's picture, pixel by pixel.
    fn rays(&self) -> Vec<[f64; 2]> {
        let offset = |i: usize| (i as f64 + 0.5) / RAYS as f64 - 0.5;
        let pixel = |i: usize| ((i % SIZE[0]) as f64, (i / SIZE[0]) as f64);
        (0..SIZE[0] * SIZE[1])
            .map(pixel)
            .flat_map(|(x, y)| (0..RAYS * RAYS).map(move |i| (x, y, i)))
            .map(|(x, y, i)| self.truth([x + offset(i % RAYS), y + offset(i / RAYS)]))
            .collect()
    }

    fn picture(
        &self,
        at: usize,
        picture: CodePicture,
        rays: &[[f64; 2]],
        rng: &mut ChaCha8Rng,
    ) -> Photo {
        let axis = match picture {
            CodePicture::Bit { axis, .. } | CodePicture::Phase { axis, .. } => axis,
            _ => 0,
        };
        let levels: Vec<f64> =
            (0..self.layout.projector[axis]).map(|p| self.layout.level(picture, p)).collect();
        let level = |pixel: f64| levels.get(pixel.max(0.0) as usize).copied().unwrap_or(0.0);
        let light = |ray: &[f64; 2]| {
            let (whole, part) = (ray[axis].floor(), ray[axis] - ray[axis].floor());
            if self.soft {
                (1.0 - part) * level(whole) + part * level(whole + 1.0)
            } else {
                level(ray[axis].round())
            }
        };
        // By way of a wall that another, broad part of the picture lights: broad against the
        // stripes that tell direct light from indirect.
        let wall = |pixel: f64| {
            let first = (pixel.max(0.0) as usize + 25) % levels.len();
            levels.iter().cycle().skip(first).take(64).sum::<f64>() / 64.0
        };
        let code = |rays: &[[f64; 2]]| {
            let direct = rays.iter().map(light).sum::<f64>() / rays.len() as f64;
            let indirect = self.indirect * wall(rays[0][axis]);
            let code = 9.0 + 150.0 * (direct + indirect) / (1.0 + self.indirect);
            // Four uniform numbers have a variance of a third.
            let noise: f64 = (0..4).map(|_| rng.random::<f64>() - 0.5).sum();
            (code + self.noise * 3_f64.sqrt() * noise).round().clamp(0.0, 255.0) as u16
        };
        let data = rays.chunks(RAYS * RAYS).map(code).collect();
        let [width, height] = SIZE;
        Photo { width, height, channels: 1, data, max_value: 255, name: format!("code{at:02}.png") }
    }

    fn pictures(&self, seed: u64) -> Vec<Photo> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let (sequence, rays) = (self.layout.sequence(), self.rays());
        let picture = |(i, p)| self.picture(i, p, &rays, &mut rng);
        sequence.into_iter().enumerate().map(picture).collect()
    }
}

/// Corners of a board of squares 22 camera pixels wide.
fn corners() -> Vec<[f64; 2]> {
    let at = |i: usize| 31.3 + 22.0 * i as f64;
    (0..5).flat_map(|j| (0..7).map(move |i| [at(i) + 0.37 * j as f64, at(j)])).collect()
}

#[test]
fn gray_code_names_the_projector_pixel() {
    let view = View::new(CodeLayout::gray_code([128, 120]));
    let decoded = decode(&view.layout, &view.pictures(1)).unwrap();
    assert!(decoded.share() > 0.97, "{}", decoded.share());
    let mut worst = 0.0_f64;
    for (axis, map) in [&decoded.columns, &decoded.rows].into_iter().enumerate() {
        for (i, &position) in map.position.iter().enumerate().filter(|(_, p)| p.is_finite()) {
            let truth = view.truth([(i % SIZE[0]) as f64, (i / SIZE[0]) as f64])[axis];
            worst = worst.max((f64::from(position) - truth).abs());
        }
    }
    // Half a pixel by rounding, and where noise takes an edge to the next camera pixel some more.
    assert!(worst < 0.75, "{worst}");
}

/// Corner errors over three sigma of their mean say that edges, not whole numbers, are fitted.
#[test]
fn corners_are_found_between_projector_pixels_without_bias() {
    for (name, layout) in [
        ("gray code", CodeLayout::gray_code([128, 120])),
        ("phase shift", CodeLayout::phase_shift([128, 120], 16, 4).unwrap()),
    ] {
        // Noise must outweigh what the rays' number and the projector's pixels do to an edge,
        // which averages out better than noise does. Indirect light shifts phases, not edges.
        let view = View { noise: 3.0, soft: true, indirect: 0.0, ..View::new(layout) };
        let mut sum = [0.0; 2];
        let (mut squares, mut covered, mut count) = (0.0, 0, 0);
        for seed in 0..4 {
            let decoded = decode(&view.layout, &view.pictures(seed)).unwrap();
            for (found, corner) in light_corners(&decoded, &corners()).iter().zip(corners()) {
                let (found, truth) = (found.unwrap(), view.truth(corner));
                let next = view.truth([corner[0] + 1.0, corner[1]]);
                // Over one pixel the map bends by a thousandth; the fit is good to a percent.
                let slope = found.slope.map(|row| row[0]);
                assert!((0..2).all(|a| (slope[a] - next[a] + truth[a]).abs() < 0.01), "{slope:?}");
                for axis in 0..2 {
                    let miss = found.pixel[axis] - truth[axis];
                    sum[axis] += miss;
                    squares += miss * miss;
                    covered += usize::from(miss.abs() < found.sigma_px);
                    count += 1;
                }
            }
        }
        let rms = (squares / f64::from(count)).sqrt();
        let coverage = covered as f64 / f64::from(count);
        let bias = sum.map(|s| s / f64::from(count / 2));
        eprintln!("{name}: rms {rms:.4} px, bias {bias:.4?}, 1 sigma covers {coverage:.2}");
        // A window holds some 20 edges of each direction; one is good to some hundredths.
        assert!(rms < 0.02, "{name}: {rms}");
        assert!(bias.iter().all(|b| b.abs() < 0.004), "{name}: {bias:?}");
        // 280 trials, of which those on one picture share edges: of 100, 15 % is three sigma.
        assert!((0.55..0.85).contains(&coverage), "{name}: {coverage}");
    }
}

#[test]
fn phase_says_how_well_it_knows() {
    let layout = CodeLayout::phase_shift([128, 120], 16, 4).unwrap();
    // Seen sharply, all of a projector pixel has its phase: then it is rounding that counts.
    let view = View { soft: true, indirect: 0.0, ..View::new(layout) };
    let decoded = decode(&view.layout, &view.pictures(5)).unwrap();
    assert!(decoded.share() > 0.97, "{}", decoded.share());
    let (mut covered, mut count, mut wild) = (0, 0, 0);
    for (i, &position) in decoded.columns.position.iter().enumerate() {
        if position.is_finite() {
            let truth = view.truth([(i % SIZE[0]) as f64, (i / SIZE[0]) as f64])[0];
            let miss = (f64::from(position) - truth).abs();
            covered += usize::from(miss < f64::from(decoded.columns.sigma[i]));
            wild += usize::from(miss > 1.0);
            count += 1;
        }
    }
    let coverage = covered as f64 / count as f64;
    eprintln!("1 sigma of a phase covers {coverage:.3} of {count}");
    // Stair-steps of the projector's pixels add a little to the noise.
    assert!((0.60..0.72).contains(&coverage), "{coverage}");
    assert_eq!(wild, 0, "unwrapped to another period");
}

/// Most light comes by way of other points, which other stripes light: better no code than theirs.
#[test]
fn where_indirect_light_rules_nothing_is_guessed() {
    let check = |indirect: f64| {
        // Whole numbers of stripes on the wall, whatever the bit that separates.
        let layout = CodeLayout::gray_code([128, 128]);
        let view = View { indirect, noise: 0.5, soft: true, ..View::new(layout) };
        let decoded = decode(&view.layout, &view.pictures(2)).unwrap();
        let off = |(i, p): (usize, &f32)| {
            let truth = view.truth([(i % SIZE[0]) as f64, (i / SIZE[0]) as f64])[0];
            (f64::from(*p) - truth).abs() > 1.5
        };
        let wrong = decoded.columns.position.iter().enumerate().filter(|&at| off(at)).count();
        eprintln!("indirect {indirect}: {:.3} decided, {wrong} wrong", decoded.share());
        (decoded.share(), wrong)
    };
    let (share, wrong) = check(0.4);
    assert!(share > 0.9 && wrong == 0, "{share} {wrong}");
    // With twice as much light from elsewhere the brighter of picture and inverse often lies.
    let (share, wrong) = check(2.0);
    assert!(share < 0.1 && wrong < 30, "{share} {wrong}");
}

#[test]
fn any_two_pictures_exchanged_are_both_named() {
    let view = View::new(CodeLayout::gray_code([128, 120]));
    let good = view.pictures(3);
    for a in 0..good.len() {
        for b in a + 1..good.len() {
            let mut spoilt = good.clone();
            spoilt.swap(a, b);
            let result = decode(&view.layout, &spoilt);
            match result {
                Err(CalibrationError::CodeSequence { picture, reason }) => {
                    let text = format!("{picture}: {reason}");
                    let names = [a, b].map(|i| format!("code{i:02}.png"));
                    assert!(names.iter().all(|n| text.contains(n)), "{a} {b}: {text}");
                }
                Err(other) => panic!("{a} {b}: {other}"),
                Ok(_) => panic!("{a} {b} passed"),
            }
        }
    }
}

#[test]
fn a_sheet_seen_from_behind_is_mirrored() {
    let front = View::new(CodeLayout::gray_code([128, 120]));
    let back = View { mirrored: true, ..View::new(front.layout.lit_from_behind()) };
    assert!(decode(&back.layout, &back.pictures(4)).unwrap().share() > 0.9);
    let message = decode(&front.layout, &back.pictures(4)).unwrap_err().to_string();
    assert!(message.contains("mirrored"), "{message}");
    let message = decode(&back.layout, &front.pictures(4)).unwrap_err().to_string();
    assert!(message.contains("not mirrored"), "{message}");
}
