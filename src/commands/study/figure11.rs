//! `diaphane study figure11`: how good a material gets with the number of pictures.

use super::common::{Block, E_WEIGHT, Files, NOISE, Pace, TRUTH_WEIGHT};
use crate::Failure;
use crate::output::Done;
use crate::study::figure11::{Row, csv, describe, draw, least, measure, name};
use crate::study::kept::Kept;
use crate::study::solving::Device;
use crate::study::truth::Truth;
use material::Face;
use serde_json::json;

/// The error of a material over the number of pictures (Wang et al. 2008, figure 11)
///
/// A simulated block is lit on one of n x n regions after the other, from the back and then from the
/// front, photographed with 2 % noise, and solved. Lit from the front, what is lit directly is masked, so n
/// begins at 2 there. E compares all of the acquired and the true BSSRDF.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane study figure11 --out study\n  diaphane study figure11 --cells 72x72x10 --out study-patent"
)]
pub(crate) struct Args {
    #[command(flatten)]
    files: Files,
    #[command(flatten)]
    block: Block,
    /// n is 1 to this
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u64).range(1..=32))]
    most: u64,
    /// Every seed is another block and other noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let most = args.most as usize;
    let scenes =
        [args.block.scene(args.seed, Face::Back)?, args.block.scene(args.seed, Face::Front)?];
    let [nx, ny, _] = scenes[0].grid.cells();
    if most > nx.min(ny) {
        let error = format!("--most: expected at most {}, one region a cell", nx.min(ny));
        return Err(Failure::input(format!("{error}, found {most}")));
    }
    let written = args.files.open("figure11.csv", "figure11.svg")?;
    let settings = json!({ "block": json!(args.block.key()), "noise": NOISE, "seed": args.seed });
    let mut kept = written.kept::<Row>(&settings)?;
    let mut device = Device::open(&args.files.device)?;
    let key = |lit: Face, n: usize| format!("{} {n}", name(lit));
    let weight = |n: usize| (n * n) as f64 + E_WEIGHT;
    let todo = |kept: &Kept<Row>, lit: Face| -> Vec<usize> {
        (least(lit)..=most).filter(|n| !kept.has(&key(lit, *n))).collect()
    };
    let missing = [Face::Back, Face::Front].map(|lit| todo(&kept, lit));
    // The true BSSRDF, what the grid leaves of it, and the rows.
    let before = TRUTH_WEIGHT + E_WEIGHT;
    let weigh = |rows: &Vec<usize>| before + rows.iter().map(|n| weight(*n)).sum::<f64>();
    let all = missing.iter().filter(|rows| !rows.is_empty()).map(weigh).sum();
    let mut pace = Pace::new("figure 11", missing.iter().map(Vec::len).sum(), all);
    for (scene, missing) in scenes.into_iter().zip(missing) {
        let lit = name(scene.lit);
        if missing.is_empty() {
            continue;
        }
        let truth = Truth::new(&scene, &mut device, |done, all| {
            pace.say(&format!("lit from the {lit}, the true BSSRDF: {done}/{all}"));
        });
        let truth = truth.map_err(|failure| kept.told(failure))?;
        let grid_e = truth.of_the_grid(&mut device).map_err(|failure| kept.told(failure))?;
        pace.spent(before);
        for n in missing {
            let what = format!("lit from the {lit}, {n} x {n} pictures");
            kept.row(&key(scene.lit, n), || {
                measure(&scene, n, (NOISE, args.seed), (&truth, grid_e), &mut device, |p| {
                    pace.step(&what, p);
                })
            })?;
            pace.made(weight(n));
        }
    }
    let mut rows = kept.rows();
    rows.retain(|row| row.n <= most);
    rows.sort_by_key(|row| (row.lit == Face::Front, row.n));
    pace.finish(&format!("{} materials on {}, seed {}", rows.len(), device.name(), args.seed));
    let title = format!("Error over the number of pictures: {}", args.block.title());
    written.write(&csv(&rows), draw(&rows, &title).as_deref())?;
    let done = Done::new(written.json(&rows, settings), written.text(&describe(&rows)));
    kept.finish()?;
    Ok(done)
}
