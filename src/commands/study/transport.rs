//! `diaphane study transport`: where is the diffusion model right?

use crate::Failure;
use crate::cli::STOP;
use crate::output::{Done, Progress, outputs};
use crate::study::transport::{Case, GOAL, Row, cases, draw, measure};
use material::{Face, LateralBoundary, Overwrite, atomic_write};
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// The diffusion model against radiative transport, with the true κ and μ
///
/// Blocks of known κ and μ are lit on one of 4 x 4 regions. What diffusion says of the front face's
/// radiance, in absolute units and with nothing fitted, is compared with Monte Carlo: over thickness
/// (6 to 40 mean free paths), albedo (0.95 to 0.999) and refractive index (1 to 1.5), over the size
/// of cells, for free blocks, for veins, and lit from the front.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane study transport --out study")]
pub(crate) struct Args {
    /// Folder for transport.csv and transport.svg
    #[arg(long)]
    out: PathBuf,
    /// Photons for each block
    #[arg(long, default_value_t = 2_000_000, value_parser = clap::value_parser!(u64).range(1000..))]
    photons: u64,
    /// Every seed is other noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Replace results that are there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let [csv, svg] = outputs(&args.out, ["transport.csv", "transport.svg"], overwrite)?;
    let cases = cases();
    let mut progress = Progress::new("study", cases.len());
    let mut rows = Vec::new();
    for (done, case) in cases.iter().enumerate() {
        if STOP.load(Ordering::Relaxed) {
            return Err(Failure::other("interrupted").hint("run the same command again"));
        }
        progress.set(done, &title(case));
        rows.push(measure(case, args.photons, args.seed)?);
    }
    let passed = rows.iter().filter(|row| row.agrees()).count();
    progress.finish(&format!(
        "{passed} of {} within {:.0} % in scale and {:.1} % root mean square",
        rows.len(),
        100.0 * GOAL.0,
        100.0 * GOAL.1
    ));
    atomic_write(&csv, overwrite, |file| file.write_all(table_csv(&rows).as_bytes()))?;
    atomic_write(&svg, overwrite, |file| file.write_all(draw(&rows).as_bytes()))?;
    let text = format!("{}{}\n{}", describe(&rows), csv.display(), svg.display());
    Ok(Done::new(json!({ "table": csv, "drawing": svg, "agree": passed, "rows": rows }), text))
}

fn title(case: &Case) -> String {
    let sides = if case.sides == LateralBoundary::Open { ", free" } else { "" };
    let lit = if case.lit == Face::Front { ", front lit" } else { "" };
    format!(
        "{} mean free paths, albedo {}, η {}, cells of {}, {} wide{sides}{lit}",
        case.thickness, case.albedo, case.eta, case.cell, case.width
    )
}

/// For people: one line a case.
fn describe(rows: &[Row]) -> String {
    let mut out = String::from(
        "series  thick  albedo  eta   cell  width    scale     rms  after gain    noise  through\n",
    );
    for row in rows {
        let case = &row.case;
        let _ = writeln!(
            out,
            "{:6} {:6} {:7} {:5} {:5} {:6} {:+7.2} % {:5.2} % {:8.2} % {:5.2} %  {:.2e}{}",
            case.series.name(),
            case.thickness,
            case.albedo,
            case.eta,
            case.cell,
            case.width,
            100.0 * row.scale_error,
            100.0 * row.relative_rms,
            100.0 * row.relative_rms_after_gain,
            100.0 * row.noise,
            row.through,
            if row.agrees() { "" } else { "  off" },
        );
    }
    out
}

/// For other programs.
fn table_csv(rows: &[Row]) -> String {
    let mut out = String::from(
        "series,thickness_mfp,albedo,eta,cell_mfp,width_mfp,lit,sides,veins,scale_error,relative_rms,relative_rms_after_gain,noise,through,agrees\n",
    );
    for row in rows {
        let Case { thickness, albedo, eta, cell, width, veins, .. } = row.case;
        let lit = if row.case.lit == Face::Front { "front" } else { "back" };
        let sides = if row.case.sides == LateralBoundary::Open { "open" } else { "no-flux" };
        let _ = writeln!(
            out,
            "{},{thickness},{albedo},{eta},{cell},{width},{lit},{sides},{veins},{:.5},{:.5},{:.5},{:.5},{:.5e},{}",
            row.case.series.name(),
            row.scale_error,
            row.relative_rms,
            row.relative_rms_after_gain,
            row.noise,
            row.through,
            row.agrees(),
        );
    }
    out
}
