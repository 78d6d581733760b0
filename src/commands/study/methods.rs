//! `diaphane study methods`: the paper's method against the default.

use super::common::{Block, Files, Pace, TRUTH_WEIGHT};
use crate::Failure;
use crate::output::Done;
use crate::study::kept::Kept;
use crate::study::methods::{METHODS, Row, Traced, csv, describe, draw, measure, ratios};
use crate::study::solving::Device;
use crate::study::truth::Truth;
use material::Face;
use serde_json::json;

/// The paper's method against the default, on the same pictures
///
/// Both solve a simulated block, lit from the back on one of 4 x 4 regions after the other. What it
/// takes until the squared residual is ε = 1e-4 of the pictures' squares is compared, in solves on the
/// finest grid with the homogeneous start, and how good κ, μ and the BSSRDF are where each method ends
/// by itself. The noise has to be below 1 % for ε to be in reach: at 2 % it is smaller than the noise.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane study methods --out study\n  diaphane study methods --noise 0.02 --out study-noisy"
)]
pub(crate) struct Args {
    #[command(flatten)]
    files: Files,
    #[command(flatten)]
    block: Block,
    /// Standard deviation of every pixel as a share of its radiance
    #[arg(long, default_value_t = 0.005)]
    noise: f64,
    /// Every seed is another block and other noise
    #[arg(long, value_delimiter = ',', default_value = "1,2,3")]
    seeds: Vec<u64>,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    if !(0.0..=0.5).contains(&args.noise) {
        return Err(Failure::input(format!("--noise: expected 0 to 0.5, found {}", args.noise)));
    }
    let mut seeds = args.seeds.clone();
    seeds.sort_unstable();
    seeds.dedup();
    args.block.scene(1, Face::Back)?;
    let written = args.files.open("methods.csv", "methods.svg")?;
    let settings = json!({ "block": json!(args.block.key()), "noise": args.noise });
    let mut kept = written.kept::<Traced>(&settings)?;
    let mut device = Device::open(&args.files.device)?;
    let key = |seed: u64, method: &str| format!("{seed} {method}");
    // The paper's method takes about twice as long for its 16 pictures.
    let weight = |method: &str| if method == METHODS[0].0 { 40.0 } else { 24.0 };
    let missing = |kept: &Kept<Traced>, seed: u64| {
        METHODS.into_iter().filter(|(name, _)| !kept.has(&key(seed, name))).collect::<Vec<_>>()
    };
    let (mut rows, mut all) = (0, 0.0);
    for missing in seeds.iter().map(|seed| missing(&kept, *seed)).filter(|m| !m.is_empty()) {
        rows += missing.len();
        all += TRUTH_WEIGHT + missing.iter().map(|(name, _)| weight(name)).sum::<f64>();
    }
    let mut pace = Pace::new("methods", rows, all);
    for &seed in &seeds {
        let missing = missing(&kept, seed);
        if missing.is_empty() {
            continue;
        }
        let scene = args.block.scene(seed, Face::Back)?;
        let truth = Truth::new(&scene, &mut device, |done, all| {
            pace.say(&format!("seed {seed}, the true BSSRDF: {done}/{all}"));
        });
        let truth = truth.map_err(|failure| kept.told(failure))?;
        pace.spent(TRUTH_WEIGHT);
        for method in missing {
            let what = format!("seed {seed}, {}", method.0);
            kept.row(&key(seed, method.0), || {
                measure(&scene, method, (args.noise, seed), &truth, &mut device, |p| {
                    pace.step(&what, p);
                })
            })?;
            pace.made(weight(method.0));
        }
    }
    let mut traced = kept.rows();
    traced.retain(|r| seeds.contains(&r.row.seed));
    traced.sort_by_key(|r| r.row.seed);
    let rows: Vec<&Row> = traced.iter().map(|r| &r.row).collect();
    pace.finish(&format!("{} materials on {}", rows.len(), device.name()));
    let title = format!("Fit over solves: {}, 16 pictures", args.block.title());
    written.write(&csv(&rows), draw(&traced, &title).as_deref())?;
    let mut json = written.json(&rows, settings);
    let ratio = |(seed, ratio)| json!({ "seed": seed, "paper_over_default": ratio });
    json["fine_solves_to_epsilon"] = ratios(&rows).into_iter().map(ratio).collect();
    let done = Done::new(json, written.text(&describe(&rows)));
    kept.finish()?;
    Ok(done)
}
