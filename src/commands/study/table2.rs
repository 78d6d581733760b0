//! `diaphane study table2`: time and solves on the grids of the paper's four samples.

use super::common::{Files, NOISE, Pace};
use crate::Failure;
use crate::output::Done;
use crate::study::scene::Scene;
use crate::study::solving::Device;
use crate::study::table2::{Channel, SAMPLES, Sample, csv, describe, draw, rows};
use clap::ValueEnum;
use serde_json::json;

/// Time and solves on the grids of the paper's four samples (Wang et al. 2008, Table II)
///
/// Simulated blocks of 130 x 53 x 37 (lit from the back), 140 x 75 x 48 (front), 256 x 256 x 20 (back)
/// and 128 x 128 x 41 cells (back), 16 pictures each with 2 % noise, are solved channel by channel.
/// Time is that of the inverse solve. At full size (--scale 1) this takes long; what is done
/// is kept when it is interrupted.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane study table2 --out study\n  diaphane study table2 --samples marble --channels 1 --scale 1 --out full"
)]
pub(crate) struct Args {
    #[command(flatten)]
    files: Files,
    /// Which of the samples
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = Which::value_variants().to_vec())]
    samples: Vec<Which>,
    /// Colour channels of each: 3, or 1 to be done sooner
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=3))]
    channels: u64,
    /// Blocks are this many times as small along every axis, in cells of the same size
    #[arg(long, default_value_t = 4.0)]
    scale: f64,
    /// Every seed is another block and other noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// The rows of the table.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Which {
    /// 130 x 53 x 37, lit from the back
    #[value(name = "wax-1")]
    WaxOne,
    /// 140 x 75 x 48, lit from the front
    #[value(name = "wax-2")]
    WaxTwo,
    /// 256 x 256 x 20, lit from the back
    Marble,
    /// 128 x 128 x 41, lit from the back
    Stone,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    if !(args.scale.is_finite() && (1.0..=10.0).contains(&args.scale)) {
        let error = format!("--scale: expected 1 to 10, found {}", args.scale);
        return Err(Failure::input(error));
    }
    let mut todo: Vec<(&Sample, Scene)> = Vec::new();
    for (which, sample) in Which::value_variants().iter().zip(&SAMPLES) {
        for channel in 0..if args.samples.contains(which) { args.channels as usize } else { 0 } {
            let scene = sample.scene(args.scale, args.seed, channel)?;
            todo.push((sample, scene));
        }
    }
    let written = args.files.open("table2.csv", "table2.svg")?;
    let settings = json!({ "scale": args.scale, "noise": NOISE, "seed": args.seed });
    let device_name = format!("{:?}", args.files.device);
    let mut kept = written.kept::<Channel>(&json!([settings, device_name]))?;
    let mut device = Device::open(&args.files.device)?;
    let key = |sample: &Sample, channel: usize| format!("{} {channel}", sample.name);
    let asked: Vec<String> = todo.iter().map(|(s, scene)| key(s, scene.channel)).collect();
    todo.retain(|(sample, scene)| !kept.has(&key(sample, scene.channel)));
    let weight = |scene: &Scene| scene.grid.len() as f64;
    let all = todo.iter().map(|(_, scene)| weight(scene)).sum();
    let mut pace = Pace::new("table II", todo.len(), all);
    for (sample, scene) in todo {
        let [nx, ny, nz] = scene.grid.cells();
        let what = format!("{} {nx}x{ny}x{nz}, channel {}", sample.name, scene.channel + 1);
        pace.say(&format!("{what}: pictures"));
        kept.row(&key(sample, scene.channel), || {
            sample.measure(&scene, (NOISE, args.seed), &mut device, |p| pace.step(&what, p))
        })?;
        pace.made(weight(&scene));
    }
    let mut channels = kept.rows();
    channels.retain(|c| asked.iter().any(|key| *key == format!("{} {}", c.sample, c.channel)));
    let rows = rows(&channels);
    pace.finish(&format!("{} channels on {}, seed {}", channels.len(), device.name(), args.seed));
    let title = format!("Time of the inverse solve on {}", device.name());
    written.write(&csv(&rows), draw(&rows, &title).as_deref())?;
    let mut json = written.json(&rows, settings);
    json["device"] = json!(device.name());
    json["channels"] = json!(channels);
    let done = Done::new(json, written.text(&describe(&rows)));
    kept.finish()?;
    Ok(done)
}
