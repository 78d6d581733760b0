//! `diaphane study plans`: is an adaptive or a multiplexed plan worth it?

use crate::Failure;
use crate::cli::STOP;
use crate::commands::init::SampleName;
use crate::output::{Done, Progress, outputs};
use crate::session::PlanConfig;
use crate::study::drawing::draw;
use crate::study::plans::{Light, PlanKind, Row, Study};
use crate::study::tally::CLASSES;
use material::{Overwrite, atomic_write};
use serde_json::json;
use simulator::SampleSpec;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// Capture time and noise of plain, adaptive and multiplexed plans, on the simulated rig
///
/// Every plan is carried out under light from a millionth of the simulated rig's up to all of it,
/// and once with a camera that adds no noise of its own. What each region's picture is off from
/// the true one is the noise.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane study plans --out study")]
pub(crate) struct Args {
    /// Folder for plans.csv and plans.svg
    #[arg(long)]
    out: PathBuf,
    /// What the simulated sample is made of
    #[arg(long, value_enum, default_value = "wax")]
    sample: SampleName,
    /// Every seed is another block and other noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Look at every so many-th cell of the block's grid only, along each axis
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    step: u32,
    /// Replace results that are there
    #[arg(long)]
    force: bool,
}

/// Light over the simulated rig's.
const LEVELS: [f64; 7] = [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0];

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let [csv, svg] = outputs(&args.out, ["plans.csv", "plans.svg"], overwrite)?;
    let plan = PlanConfig::default();
    let sample = SampleSpec { kind: args.sample.kind(), seed: args.seed };
    let study = Study::new(&sample, plan.regions, plan.bracket_s, args.step)?;
    let noisy = LEVELS.map(|level| Light { level, camera_noise: true });
    let lights = noisy.into_iter().chain([Light { level: 1.0, camera_noise: false }]);
    let mut progress = Progress::new("study", LEVELS.len() + 1);
    let mut rows = Vec::new();
    for (done, light) in lights.enumerate() {
        if STOP.load(Ordering::Relaxed) {
            return Err(Failure::other("interrupted").hint("run the same command again"));
        }
        progress.set(done, &title(light));
        rows.extend(study.rows(light)?);
    }
    progress.finish(&format!("{} plans", rows.len()));
    let groups: Vec<&[Row]> = rows.chunks(PlanKind::ALL.len()).collect();
    atomic_write(&csv, overwrite, |file| file.write_all(table_csv(&groups).as_bytes()))?;
    let drawing = draw(&groups[..LEVELS.len().min(groups.len())]);
    atomic_write(&svg, overwrite, |file| file.write_all(drawing.as_bytes()))?;
    let mut text = String::new();
    for group in &groups {
        text += &describe(group);
    }
    let _ = write!(text, "{}\n{}", csv.display(), svg.display());
    let compared: Vec<_> =
        groups.iter().flat_map(|g| g.iter().map(|row| compare(row, &g[0]))).collect();
    Ok(Done::new(json!({ "table": csv, "drawing": svg, "rows": compared }), text))
}

fn title(light: Light) -> String {
    if light.camera_noise {
        format!("light × {:.0e}", light.level)
    } else {
        format!("light × {:.0e}, photon noise alone", light.level)
    }
}

fn over(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    std::array::from_fn(|c| a[c] / b[c])
}

/// A row with what it is over the plain plan under the same light.
fn compare(row: &Row, plain: &Row) -> serde_json::Value {
    let mut json = json!(row);
    if let Some(object) = json.as_object_mut() {
        let seconds = row.seconds / plain.seconds;
        let pixel = over(row.noise.pixel, plain.noise.pixel);
        object.insert("time_over_plain".into(), json!(seconds));
        object.insert("pixel_over_plain".into(), json!(pixel));
        object.insert("equal_time_over_plain".into(), json!(pixel.map(|p| p * seconds.sqrt())));
        let with_black = over(row.noise.with_black, plain.noise.with_black);
        object.insert(
            "equal_time_with_black_over_plain".into(),
            json!(with_black.map(|p| p * seconds.sqrt())),
        );
        object.insert("cell_over_plain".into(), json!(over(row.noise.cell, plain.noise.cell)));
    }
    json
}

/// For people: one line a plan.
fn describe(group: &[Row]) -> String {
    let Some(plain) = group.first() else { return String::new() };
    let mut out = format!(
        "{}: {:.3} electrons at most in {:.0} s\n  {:24}{:>8}{:>8}   SD over plain's: {}{:>12}{:>11}{:>12}{:>7}\n",
        title(plain.light),
        plain.peak_electrons,
        plain.exposures_s.last().copied().unwrap_or(0.0),
        "plan",
        "seconds",
        "share",
        CLASSES.map(|c| format!("{c:>9}")).concat(),
        "equal time",
        "and black",
        "with model",
        "told",
    );
    for row in group {
        let share = row.seconds / plain.seconds;
        let pixel = over(row.noise.pixel, plain.noise.pixel);
        let cell = over(row.noise.cell, plain.noise.cell);
        let _ = writeln!(
            out,
            "  {:24}{:8.0}{:8.2}{:19}{}{:12.3}{:11.3}{:12.3}{:7.3}",
            row.plan.name(),
            row.seconds,
            share,
            "",
            pixel.map(|p| format!("{p:9.3}")).concat(),
            pixel[3] * share.sqrt(),
            over(row.noise.with_black, plain.noise.with_black)[3] * share.sqrt(),
            cell.iter().copied().fold(0.0, f64::max),
            row.noise.told,
        );
    }
    out
}

/// For other programs.
fn table_csv(groups: &[&[Row]]) -> String {
    let per_class = |name: &str| CLASSES.map(|c| format!(",{name}_{c}")).concat();
    let mut out = format!(
        "light,camera_noise,peak_electrons,plan,frames,seconds,time_over_plain{}{}{}{}{},told,exposures_s\n",
        per_class("pixel_sd"),
        per_class("pixel_sd_over_plain"),
        per_class("pixel_sd_over_plain_at_equal_time"),
        per_class("pixel_sd_with_black_over_plain_at_equal_time"),
        per_class("cell_sd_with_model_error_over_plain"),
    );
    for row in groups.iter().copied().flatten() {
        let Some(plain) = groups.iter().find_map(|g| g.first().filter(|p| p.light == row.light))
        else {
            continue;
        };
        let share = row.seconds / plain.seconds;
        let pixel = over(row.noise.pixel, plain.noise.pixel);
        let figures = [
            row.noise.pixel,
            pixel,
            pixel.map(|p| p * share.sqrt()),
            over(row.noise.with_black, plain.noise.with_black).map(|p| p * share.sqrt()),
            over(row.noise.cell, plain.noise.cell),
        ];
        let times: Vec<String> = row.exposures_s.iter().map(|t| format!("{t:.5}")).collect();
        let _ = writeln!(
            out,
            "{},{},{:.4},\"{}\",{},{:.2},{:.4}{},{:.4},{}",
            row.light.level,
            row.light.camera_noise,
            row.peak_electrons,
            row.plan.name(),
            row.frames,
            row.seconds,
            share,
            figures.as_flattened().iter().map(|v| format!(",{v:.6e}")).collect::<String>(),
            row.noise.told,
            times.join(" "),
        );
    }
    out
}
