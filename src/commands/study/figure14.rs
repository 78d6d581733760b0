//! `diaphane study figure14`: κ and μ by depth, against the truth.

use super::common::{Block, Files, NOISE, Pace};
use crate::Failure;
use crate::output::Done;
use crate::study::figure14::{REGIONS, csv, describe, draw, rows};
use crate::study::solving::{Device, Outcome, go_on};
use diffusion::InverseSettings;
use material::Face;
use serde_json::json;

/// κ and μ by depth, against the truth (Wang et al. 2008, figure 14)
///
/// A simulated block, lit from the back on one of 4 x 4 regions after the other and photographed with
/// 2 % noise, is solved; each layer is compared with the true one.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane study figure14 --out study")]
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
    let written = args.files.open("figure14.csv", "figure14.svg")?;
    let settings = json!({ "block": json!(args.block.key()), "noise": NOISE, "seed": args.seed });
    let mut device = Device::open(&args.files.device)?;
    let mut pace = Pace::new("figure 14", 1, 1.0);
    let pictures = scene.photographed(REGIONS, NOISE, args.seed, &mut device.solver, go_on)?;
    let (found, seconds) =
        device.invert(&scene, &pictures, &InverseSettings::default(), |p| pace.step("solve", p))?;
    let truth = scene.truth()?;
    let rows = rows(&scene, &found, &truth);
    let outcome = Outcome::new(&found, seconds);
    pace.finish(&format!("fit {:.2e} on {}, seed {}", outcome.fit, device.name(), args.seed));
    let title = format!("By depth: {}, 16 pictures", args.block.title());
    let drawing = draw(&scene, &found, &truth, &rows, &title)?;
    written.write(&csv(&rows), Some(&drawing))?;
    let mut json = written.json(&rows, settings);
    json["solve"] = json!(outcome);
    Ok(Done::new(json, written.text(&describe(&rows))))
}
