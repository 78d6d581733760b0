//! `diaphane study figure13`: smoothness that is too strong, right, and too weak.

use super::common::{Block, E_WEIGHT, Files, NOISE, Pace, TRUTH_WEIGHT};
use crate::Failure;
use crate::output::Done;
use crate::study::figure13::{FACTORS, Pictured, REGIONS, Row, csv, describe, draw, measure};
use crate::study::solving::{Device, go_on};
use crate::study::truth::Truth;
use material::Face;
use serde_json::json;

/// Smoothness that is too strong, right, and too weak (Wang et al. 2008, figure 13)
///
/// A simulated block, lit from the back on one of 4 x 4 regions after the other and photographed with
/// 2 % noise, is solved at the λ that the noise chooses, and at ones far above and below.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane study figure13 --out study")]
pub(crate) struct Args {
    #[command(flatten)]
    files: Files,
    #[command(flatten)]
    block: Block,
    /// Every seed is another block and other noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let scene = args.block.scene(args.seed, Face::Back)?;
    let written = args.files.open("figure13.csv", "figure13.svg")?;
    let settings = json!({ "block": json!(args.block.key()), "noise": NOISE, "seed": args.seed });
    let mut kept = written.kept::<Pictured>(&settings)?;
    let mut device = Device::open(&args.files.device)?;
    let pictures = scene.photographed(REGIONS, NOISE, args.seed, &mut device.solver, go_on)?;
    let key = |factor: f64| format!("{factor:e}");
    let left = FACTORS.iter().filter(|f| !kept.has(&key(**f))).count();
    let weight = (REGIONS * REGIONS) as f64 + E_WEIGHT;
    let mut pace = Pace::new("figure 13", left, TRUTH_WEIGHT + weight * left as f64);
    let truth = Truth::new(&scene, &mut device, |done, all| {
        pace.say(&format!("the true BSSRDF: {done}/{all}"));
    })
    .map_err(|failure| kept.told(failure))?;
    pace.spent(TRUTH_WEIGHT);
    // The one that the others are measured by comes first.
    let chosen = std::iter::once(1.0);
    for factor in chosen.chain(FACTORS.into_iter().filter(|f| *f != 1.0)) {
        if kept.has(&key(factor)) {
            continue;
        }
        let lambda = kept.rows().iter().find(|r| r.row.factor == 1.0).map(|r| r.row.outcome.lambda);
        let what = format!("λ × {factor:e}");
        kept.row(&key(factor), || {
            measure(&scene, &pictures, (factor, lambda), &truth, &mut device, |p| {
                pace.step(&what, p);
            })
        })?;
        pace.made(weight);
    }
    let mut pictured = kept.rows();
    pictured.sort_by(|a, b| a.row.factor.total_cmp(&b.row.factor));
    let rows: Vec<&Row> = pictured.iter().map(|r| &r.row).collect();
    pace.finish(&format!("{} materials on {}, seed {}", rows.len(), device.name(), args.seed));
    let title = format!("Smoothness: {}, 16 pictures", args.block.title());
    let drawing = draw(&scene, &pictures, &truth, &pictured, &title)?;
    written.write(&csv(&rows), Some(&drawing))?;
    let done = Done::new(written.json(&rows, settings), written.text(&describe(&rows)));
    kept.finish()?;
    Ok(done)
}
