//! `diaphane study acquired`: a material from Monte-Carlo pictures, under light it was not fitted to.

use crate::Failure;
use crate::cli::STOP;
use crate::output::{Done, Progress, outputs};
use crate::study::acquired::{Acquired, Pictures};
use material::{Overwrite, atomic_write};
use serde_json::json;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// A veined slab acquired from Monte-Carlo pictures, and tried under light it was not fitted to
///
/// A slab of 40 x 40 x 12 mm, 1/mean free path 1.2/mm, is lit from the back on one of 4 x 4 regions
/// after the other. κ and μ are fitted to these pictures, once with their brightness known, as of a calibrated
/// rig, and once with a free gain; and the material is compared with pictures of the whole face, a stripe
/// and a spot of 4 mm.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane study acquired --out study")]
pub(crate) struct Args {
    /// Folder for acquired.csv
    #[arg(long)]
    out: PathBuf,
    /// Photons for each picture
    #[arg(long, default_value_t = 1_500_000, value_parser = clap::value_parser!(u64).range(1000..))]
    photons: u64,
    /// Refractive indices of the slab
    #[arg(long, value_delimiter = ',', default_value = "1,1.4")]
    eta: Vec<f64>,
    /// Edges of the cells that κ and μ are solved on, mm: 0.5, 1 or 2
    #[arg(long, value_delimiter = ',', default_value = "0.5,1")]
    cells: Vec<f64>,
    /// Every seed is other noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Replace results that are there
    #[arg(long)]
    force: bool,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    if let Some(eta) = args.eta.iter().find(|eta| !(1.0..=3.0).contains(*eta)) {
        return Err(Failure::input(format!("--eta: expected 1 to 3, found {eta}")));
    }
    if let Some(cell) = args.cells.iter().find(|cell| ![0.5, 1.0, 2.0].contains(*cell)) {
        return Err(Failure::input(format!("--cells: expected 0.5, 1 or 2, found {cell}")));
    }
    let [csv] = outputs(&args.out, ["acquired.csv"], overwrite)?;
    let mut rows = Vec::new();
    for &eta in &args.eta {
        let mut progress = Progress::new("photons", Pictures::count());
        let pictures = Pictures::take(eta, args.photons, args.seed, |done| {
            progress.set(done, &format!("η = {eta}"));
            !STOP.load(Ordering::Relaxed)
        })?;
        progress.finish(&format!("{} pictures, η = {eta}", Pictures::count()));
        for (&cell, free_gain) in args.cells.iter().flat_map(|c| [(c, false), (c, true)]) {
            let what = format!("cells of {cell} mm, gain {}", gain_name(free_gain));
            let mut progress = Progress::new("solve", 0);
            rows.push(pictures.acquire(cell, free_gain, |p| {
                let message = format!(
                    "{what}: fit {:.2e}, χ²/N {:.2}, λ {:.1e}, {} solves",
                    p.fit, p.chi2, p.lambda, p.work.linear_solves
                );
                progress.set(p.work.gradient_evaluations, &message);
                !STOP.load(Ordering::Relaxed)
            })?);
            progress.finish(&what);
        }
    }
    atomic_write(&csv, overwrite, |file| file.write_all(table_csv(&rows).as_bytes()))?;
    let text = format!("{}{}", describe(&rows), csv.display());
    Ok(Done::new(json!({ "table": csv, "rows": rows }), text))
}

fn gain_name(free: bool) -> &'static str {
    if free { "free" } else { "known" }
}

/// For people: one line a material.
fn describe(rows: &[Acquired]) -> String {
    let mut out = String::new();
    for row in rows {
        let tried: Vec<String> = row
            .held_out
            .iter()
            .map(|h| {
                let [rms, noise] = [h.relative_rms, h.noise].map(|v| 100.0 * v);
                format!("{} {rms:.2} % (noise {noise:.2} %)", h.pattern)
            })
            .collect();
        let _ = writeln!(
            out,
            "η {}, cells of {} mm, noise {:.2} %: gain {} {:.4}, fit {:.2e}, χ²/N {:.2}; {}; mean {:.2} %",
            row.eta,
            row.cell_mm,
            100.0 * row.noise,
            gain_name(row.free_gain),
            row.gain,
            row.fit,
            row.chi2,
            tried.join(", "),
            100.0 * row.mean_relative_rms
        );
    }
    out
}

/// For other programs.
fn table_csv(rows: &[Acquired]) -> String {
    let mut out = String::from(
        "eta,cell_mm,noise,gain_is,gain,fit,chi2,linear_solves,pattern,relative_rms,pattern_noise\n",
    );
    for row in rows {
        for held in &row.held_out {
            let _ = writeln!(
                out,
                "{},{},{:.5},{},{:.5},{:.5e},{:.4},{},{},{:.5},{:.5}",
                row.eta,
                row.cell_mm,
                row.noise,
                gain_name(row.free_gain),
                row.gain,
                row.fit,
                row.chi2,
                row.linear_solves,
                held.pattern,
                held.relative_rms,
                held.noise
            );
        }
    }
    out
}
