//! `diaphane calibrate colour`: from a photographed ColorChecker to the camera's colour matrix.

use super::colour_input::{self, Input};
use super::swatches;
use crate::Failure;
use crate::output::{Done, check_output};
use calibration::{
    ChartReference, ColourCalibration, Illuminant, PATCH_NAMES, calibrate_colour, find_chart,
    read_chart,
};
use clap::ValueEnum;
use material::{Overwrite, atomic_write};
use serde_json::json;
use std::io::Write;
use std::path::PathBuf;

/// Calibrate a camera's colours from a photograph of a ColorChecker Classic
#[derive(clap::Args)]
#[command(after_help = "Examples:
  diaphane calibrate colour --image chart.jpg
  diaphane calibrate colour --image merged.exr --reference my-chart.csv --output chart
  diaphane calibrate colour --frames 450nm --frames 550nm --frames 600nm --darks darks \\
      --exposures times.txt --mosaic gbrg --chart 59,57 351,58 336,222 74,217")]
pub(crate) struct Args {
    #[command(flatten)]
    input: Input,
    /// Where the chart is, if it is not found: pixels of the middles of dark skin, bluish green,
    /// black and white
    #[arg(long, num_args = 4, allow_hyphen_values = true, value_names = ["X,Y", "X,Y", "X,Y", "X,Y"], value_parser = pixel)]
    chart: Option<Vec<[f64; 2]>>,
    /// Measured patches: a CSV with columns X, Y, Z or L, a, b and 24 lines; the manufacturer's
    /// values from November 2014 on if not given
    #[arg(long)]
    reference: Option<PathBuf>,
    /// The light that the measured patches are stated for
    #[arg(long, value_enum, default_value_t, requires = "reference")]
    light: Light,
    /// Name of the results, without .json and .png; that of the first picture if not given
    #[arg(long)]
    output: Option<PathBuf>,
    /// Replace results that are there
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, Default, ValueEnum)]
enum Light {
    /// Horizon light
    #[default]
    D50,
    /// Noon daylight
    D65,
    /// Equal energy
    E,
}

impl From<Light> for Illuminant {
    fn from(light: Light) -> Self {
        match light {
            Light::D50 => Self::D50,
            Light::D65 => Self::D65,
            Light::E => Self::EqualEnergy,
        }
    }
}

fn pixel(text: &str) -> Result<[f64; 2], String> {
    text.split_once(',')
        .and_then(|(x, y)| Some([x.trim().parse().ok()?, y.trim().parse().ok()?]))
        .filter(|p: &[f64; 2]| p.iter().all(|v| v.is_finite()))
        .ok_or_else(|| "expected X,Y in pixels, for instance 59,57".into())
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let reference = match &args.reference {
        Some(path) => ChartReference::load(path, args.light.into())?,
        None => ChartReference::published(),
    };
    let first = args.input.first()?;
    let base = match &args.output {
        // Who writes the whole name means the same.
        Some(name) if name.extension().is_some_and(|e| e == "json") => name.with_extension(""),
        Some(name) => name.clone(),
        None => first.with_extension("colour"),
    };
    let [file, swatch] = ["json", "png"].map(|extension| {
        let mut name = base.clone().into_os_string();
        name.push(format!(".{extension}"));
        PathBuf::from(name)
    });
    [&file, &swatch].into_iter().try_for_each(|path| check_output(path, overwrite))?;
    let picture = colour_input::read(&args.input)?;
    let found = match args.chart.as_deref() {
        // A mosaic's quads are the pixels of its colour picture.
        Some(&[a, b, c, d]) => {
            let middles = [a, b, c, d].map(|p| p.map(|v| (v + 0.5) / picture.binned - 0.5));
            read_chart(&picture.image, middles, &picture.name)
        }
        _ => find_chart(&picture.image, &picture.name),
    };
    let patches = found.map_err(|error| {
        Failure::input(error).hint(
            "the whole chart has to be in view, sharp, evenly lit and not clipped; if it is, say \
             where with --chart",
        )
    })?;
    let result = calibrate_colour(&patches, &reference)?;
    let text = serde_json::to_string_pretty(&result).map_err(Failure::other)?;
    let png = swatches::draw(&result)?;
    atomic_write(&file, overwrite, |out| out.write_all(text.as_bytes()))?;
    atomic_write(&swatch, overwrite, |out| out.write_all(&png))?;
    let score =
        result.score().ok_or_else(|| Failure::other("no model describes the chart's colours"))?;
    let each = result.patches.iter().zip(PATCH_NAMES).map(|(p, name)| {
        json!({ "name": name, "delta_e2000": p.delta_e, "delta_e2000_loo": p.left_out })
    });
    let json = json!({
        "delta_e2000_mean": score.fitted.mean,
        "delta_e2000_p95": score.fitted.p95,
        "delta_e2000_max": score.fitted.max,
        "delta_e2000_loo": score.left_out.mean,
        "delta_e2000_loo_p95": score.left_out.p95,
        "delta_e2000_loo_max": score.left_out.max,
        "delta_e2000_white_balance": result.balanced.mean,
        "delta_e2000_raw": result.raw.mean,
        "model": result.correction.model,
        "matrix": result.correction.matrix,
        "unit": result.correction.unit,
        "why": result.why,
        "models": result.models,
        "white_balance": result.white_balance,
        "reference": result.reference,
        "patches": each.collect::<Vec<_>>(),
        "output": [file, swatch],
    });
    Ok(Done::new(json, table(&result, &file, &swatch)))
}

fn table(result: &ColourCalibration, file: &std::path::Path, swatch: &std::path::Path) -> String {
    let mut text =
        format!("{:32} {:>6} {:>6} {:>6}   left out:\n", "CIEDE2000", "mean", "95 %", "max");
    for (name, e) in [("no correction", result.raw), ("white balance", result.balanced)] {
        text += &format!("{name:32} {:6.2} {:6.2} {:6.2}\n", e.mean, e.p95, e.max);
    }
    for score in &result.models {
        let (fit, out) = (score.fitted, score.left_out);
        text += &format!(
            "{:32} {:6.2} {:6.2} {:6.2}   {:6.2} {:6.2} {:6.2}{}\n",
            score.model.to_string(),
            fit.mean,
            fit.p95,
            fit.max,
            out.mean,
            out.p95,
            out.max,
            if score.model == result.correction.model { "  <" } else { "" }
        );
    }
    let worst =
        (0..24).max_by(|&a, &b| result.patches[a].delta_e.total_cmp(&result.patches[b].delta_e));
    if let Some(worst) = worst {
        let off = result.patches[worst].delta_e;
        text += &format!("worst patch: {}, {off:.1}\n", PATCH_NAMES[worst]);
    }
    let clipped: Vec<&str> = result
        .patches
        .iter()
        .zip(PATCH_NAMES)
        .filter(|(p, _)| p.patch.is_clipped())
        .map(|(_, name)| name)
        .collect();
    if !clipped.is_empty() {
        text += &format!("warning: clipped and left out: {}\n", clipped.join(", "));
    }
    text += &format!("{}\n{} and {}", result.why, file.display(), swatch.display());
    text
}
