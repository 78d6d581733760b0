//! `diaphane calibrate light`: what the projector's light is, from a session's own pictures.

use super::all::{described, lit_z, load};
use super::frames::{frame_photo_repeat, merge_shot, subtract};
use crate::Failure;
use crate::output::{Done, Progress};
use crate::sensor::Sensor;
use crate::session::Session;
use crate::wheel::{KnownWheel, LIGHT};
use calibration::{
    BurstFrame, FacePlane, HdrImage, ProjectorFlatField, ProjectorLight, find_colour_wheel,
    measure_projector_light,
};
use material::Overwrite;
use rig::{BURST_SHOT, DARK_SHOT, WHITE_AGAIN_SHOT, grey_shot};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;

/// Columns and rows that the projector's picture is cut into for its evenness.
const CELLS: [usize; 2] = [16, 12];
/// Pixels of the sheet that a frame of the burst is averaged over: one in so many.
const EVERY: usize = 5;
/// There once the sample's pictures are being taken.
const SAMPLE: &str = "frames/black";
/// Change of the lamp over the ramp that is worth a word.
const DRIFT: f64 = 0.01;

/// Measure the projector: response, black, contrast, evenness, colour wheel
///
/// Takes the pictures that `diaphane capture SESSION --light` took of the white sheet, after
/// `diaphane calibrate all SESSION`.
#[derive(clap::Args)]
#[command(
    after_help = "Example:\n  diaphane capture my-wax --light && diaphane calibrate light my-wax"
)]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    /// Replace a measurement that is there
    #[arg(long)]
    force: bool,
}

/// What is known of the projector's light.
#[derive(Debug, Serialize, Deserialize)]
struct Measured {
    light: ProjectorLight,
    flat_field: ProjectorFlatField,
    /// White after the ramp over white in it, less 1, and its 1-sigma: the lamp's drift.
    drift: (f64, f64),
    /// `None` if the light is steady within an exposure.
    known_wheel: Option<KnownWheel>,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    session.refuse_existing(LIGHT, overwrite)?;
    let found = measure(&session)?;
    session.write_json(LIGHT, &found, overwrite)?;
    Ok(Done::new(as_json(&found), describe(&found, &session)))
}

fn measure(session: &Session) -> Result<Measured, Failure> {
    let acquisition = session.acquisition();
    let (levels, times) = (acquisition.ramp(), acquisition.ramp_exposures_s());
    let found = load(session)?;
    let (_, described) = described(session)?;
    let sensor = Sensor::of(session)?;
    let mut progress = Progress::new("projector light", levels.len() + 2);
    let merged = |shot: &str| merge_shot(session, shot, &times, &found.response, &sensor);
    let dark = merged(DARK_SHOT).map_err(|failure| {
        failure.hint(format!("take them with: {}", session.command("capture SESSION --light")))
    })?;
    let mut ramp = Vec::with_capacity(levels.len());
    for (i, &level) in levels.iter().enumerate() {
        let shot = grey_shot(level);
        progress.set(i, &shot);
        ramp.push((level, subtract(merged(&shot)?, &dark)));
    }
    let light = measure_projector_light(&ramp)?;
    let (Some((_, black)), Some((_, white))) = (ramp.first(), ramp.last()) else {
        return Err(Failure::input("the ramp has no levels"));
    };
    let again = subtract(merged(WHITE_AGAIN_SHOT)?, &dark);
    let drift = drift(white, &again);

    progress.set(levels.len(), "evenness");
    let seen = FacePlane { z_mm: lit_z(session), ..found.front };
    let lit = super::lit_plane(session)?;
    let projector = [lit.device.width, lit.device.height];
    let flat_field =
        ProjectorFlatField::measure(&subtract(white.clone(), black), projector, CELLS, |pixel| {
            lit.face_to_pixel(seen.pixel_to_face(pixel)?)
        })?;

    progress.set(levels.len() + 1, "colour wheel");
    let mut burst = Vec::new();
    let bright = bright_samples(white);
    for shot in acquisition.light_plan().shots.iter().filter(|s| s.name == BURST_SHOT) {
        for (e, &exposure_s) in shot.exposures_s.iter().enumerate() {
            for repeat in 0..shot.repeats {
                let photo = frame_photo_repeat(session, BURST_SHOT, e, repeat)?;
                let seen = HdrImage::from_photo(&photo, &found.response)?;
                let black = described.black_level / f64::from(photo.max_value);
                // One frame makes no bracket; its black is the camera's.
                let light = means(&seen, &bright)
                    .into_iter()
                    .enumerate()
                    .map(|(c, mean)| (mean - found.response.linearise(black, c)) / exposure_s);
                burst.push(BurstFrame { exposure_s, radiance: light.collect() });
            }
        }
    }
    let there = session.path(SAMPLE).exists().then(|| session.sample_bracket_s());
    let asked_s = &session.config.plan.bracket_s;
    let known_wheel = find_colour_wheel(&burst)?.map(|w| KnownWheel::new(w, asked_s, there));
    progress.finish("done");
    Ok(Measured { light, flat_field, drift, known_wheel })
}

/// Pixels of the sheet that white lights well.
fn bright_samples(white: &HdrImage) -> Vec<usize> {
    let sum = |p: usize| -> f32 {
        white.radiance[p * white.channels..(p + 1) * white.channels].iter().sum()
    };
    let pixels = white.width * white.height;
    let most = (0..pixels).map(sum).fold(0.0, f32::max);
    (0..pixels).step_by(EVERY).filter(|&p| sum(p) > 0.5 * most).collect()
}

/// Mean of each channel over some pixels.
fn means(picture: &HdrImage, pixels: &[usize]) -> Vec<f64> {
    let mean = |channel: usize| {
        let sample = |p: &usize| f64::from(picture.radiance[p * picture.channels + channel]);
        pixels.iter().map(sample).sum::<f64>() / pixels.len().max(1) as f64
    };
    (0..picture.channels).map(mean).collect()
}

/// How much brighter white was the second time, and 1-sigma of that.
fn drift(first: &HdrImage, second: &HdrImage) -> (f64, f64) {
    let bright = bright_samples(first);
    let sum = |picture: &HdrImage| {
        let samples = bright.iter().flat_map(|p| p * first.channels..(p + 1) * first.channels);
        let samples =
            samples.filter(|&i| first.variance[i].is_finite() && second.variance[i].is_finite());
        samples.fold((0.0, 0.0), |(s, v), i| {
            (s + f64::from(picture.radiance[i]), v + f64::from(picture.variance[i]))
        })
    };
    let ((a, va), (b, vb)) = (sum(first), sum(second));
    (b / a - 1.0, (va / (a * a) + vb / (b * b)).sqrt())
}

fn as_json(found: &Measured) -> serde_json::Value {
    let channels = found.light.channels.iter().map(|c| {
        let (contrast, contrast_sigma) = c.contrast();
        json!({
            "gamma": c.gamma,
            "gamma_rms": c.gamma_rms,
            "black": c.black,
            "contrast": contrast,
            "contrast_sigma": contrast_sigma,
            "largest_fall_sigma": c.largest_fall,
            "light": c.light,
        })
    });
    let channels: Vec<_> = channels.collect();
    let wheel = found.known_wheel.as_ref().map(|known| &known.wheel);
    json!({
        "levels": found.light.levels,
        "channels": channels,
        "evenness": found.flat_field.evenness(),
        "drift": found.drift.0,
        "drift_sigma": found.drift.1,
        "wheel_turn_s": wheel.map(|w| w.turn_s),
        "wheel_turn_sigma_s": wheel.map(|w| w.turn_sigma_s),
        "shortest_exposure_s": wheel.map(|w| w.whole_turns_s(0.0)),
    })
}

fn describe(found: &Measured, session: &Session) -> String {
    let mut text = String::from("channel   gamma (RMS)       contrast        at half input\n");
    for (i, c) in found.light.channels.iter().enumerate() {
        let name = ["red", "green", "blue"].get(i).copied().unwrap_or("grey");
        let (contrast, sigma) = c.contrast();
        let half = found.light.light(i, 0.5).unwrap_or(f64::NAN);
        text += &format!(
            "{name:8} {:6.3} ({:.4})   {contrast:7.0} ± {sigma:<5.0}  {:6.2} %\n",
            c.gamma,
            c.gamma_rms,
            100.0 * half
        );
        if c.largest_fall > 4.0 {
            text += &format!(
                "  warning: the light falls by {:.1} sigma between two rising levels: is the lamp steady?\n",
                c.largest_fall
            );
        }
    }
    text += "the room's light counts as the projector's black\n";
    text += &format!(
        "darkest part of the lit sheet: {:.0} % of the brightest\n",
        100.0 * found.flat_field.evenness()
    );
    let (drift, sigma) = found.drift;
    text += &format!(
        "lamp: {:+.2} ± {:.2} % from the ramp's end to after the burst",
        100.0 * drift,
        100.0 * sigma
    );
    if drift.abs() > DRIFT.max(3.0 * sigma) {
        text += "; let it warm up for half an hour";
    }
    text += &match &found.known_wheel {
        None => "\nno colour wheel: the light is steady in the shortest exposures".to_owned(),
        Some(known) => wheel_text(known, &session.config.plan.bracket_s),
    };
    text
}

fn wheel_text(known: &KnownWheel, asked: &[f64]) -> String {
    let wheel = &known.wheel;
    let worst = |t: f64| wheel.scatter(t).into_iter().fold(0.0, f64::max);
    let mut text = format!(
        "\ncolour wheel: one turn in {:.3} ± {:.3} ms; expose for whole turns, at least {:.2} ms",
        1e3 * wheel.turn_s,
        1e3 * wheel.turn_sigma_s,
        1e3 * wheel.whole_turns_s(0.0)
    );
    let taken = known.bracket_s(asked);
    if taken != asked {
        let times: Vec<String> = taken.iter().map(|t| format!("{:.4}", t)).collect();
        text += &format!("\nthe sample is exposed for whole turns: {} s", times.join(" "));
    }
    // Those of pictures that were there already.
    for t in taken.into_iter().filter(|t| worst(*t) > 0.002) {
        let (scatter, better) = (100.0 * worst(t), 1e3 * wheel.whole_turns_s(t));
        text += &format!("\n  {:.2} ms scatters by {scatter:.1} %; better {better:.2} ms", 1e3 * t);
    }
    text
}
