//! `diaphane verify`: does the material look like the sample, also under light that it was not
//! fitted to?

use crate::Failure;
use crate::cli::STOP;
use crate::commands::solve::MATERIAL;
use crate::measurement::Measured;
use crate::output::{Done, Progress, counted};
use crate::session::Session;
use crate::steps::{self, Ledger, made_from};
use diffusion::{CpuSolver, Medium, bssrdf_error};
use material::{Input, Material, Overwrite};
use rig::Purpose;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

pub(crate) const RESULT: &str = "material/verification.json";

/// Relative residual of the solves behind the BSSRDF error: its square is far below any E.
const TOLERANCE: f64 = 1e-5;

/// Relight the material under every captured pattern, and under those kept out of the fit
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane verify my-wax\n  diaphane verify my-wax --strict\n\nWith --strict nothing is written: every picture is hashed, calibration, measurement and figures are derived from them once more, and the first thing that is not as the session has it is told (exit code 2)."
)]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    /// Replace a verification that is there
    #[arg(long, conflicts_with = "strict")]
    force: bool,
    /// Derive everything again from the pictures, and say what differs from what is there
    #[arg(long)]
    strict: bool,
}

/// Errors of the relit images.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Verification {
    /// Σ (L − L_meas)² / Σ L_meas² over the fitted patterns (design: fit f).
    pub fit: f64,
    /// Relative RMS over the patterns that were held out: √ of the same; None without such patterns.
    pub heldout_rel_rms: Option<f64>,
    /// E of W08 figure 11 against the simulator's truth, mean of the channels; None without one.
    pub bssrdf_error: Option<f64>,
    pub bssrdf_error_by_channel: Vec<f64>,
    /// Pixels that are lit directly from the front, which the others leave out; None without a
    /// surface to predict them with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lit_pixels: Option<LitPixels>,
    pub patterns: Vec<PatternError>,
    /// What was compared; empty in files from before it was noted.
    #[serde(default)]
    pub inputs: Vec<Input>,
}

/// Errors of pixels that are lit directly, or next to one that is, over fitted and held-out patterns;
/// the pictures that the surface was found from are left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LitPixels {
    /// Relative RMS with all that the material has.
    pub rel_rms: f64,
    /// The same of held-out patterns alone; None without such.
    pub heldout_rel_rms: Option<f64>,
    /// Relative RMS by multiple scattering alone, of all patterns.
    pub without_surface_rel_rms: f64,
}

/// Error of one relit image.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct PatternError {
    pub name: String,
    pub held_out: bool,
    /// Relative RMS over all channels.
    pub rel_rms: f64,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    if args.strict {
        return super::verify_strict::run(&session);
    }
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let result = verify(&session, overwrite)?;
    let mut text = String::new();
    for p in &result.patterns {
        let kept = if p.held_out { " (held out)" } else { "" };
        text += &format!("{:18} {:6.2} %{kept}\n", p.name, 100.0 * p.rel_rms);
    }
    text += &format!("fit {:.2e}", result.fit);
    if let Some(e) = result.heldout_rel_rms {
        text += &format!(", held-out patterns {:.2} % relative RMS", 100.0 * e);
    }
    if let Some(e) = result.bssrdf_error {
        text += &format!(", BSSRDF error E {e:.2e}");
    }
    if let Some(lit) = &result.lit_pixels {
        text += &format!(
            "\nlit pixels {:.2} % relative RMS, {:.2} % without the surface",
            100.0 * lit.rel_rms,
            100.0 * lit.without_surface_rel_rms
        );
    }
    text += &format!("\n{}", steps::next_line(&session)?);
    Ok(Done::new(json!(result), text))
}

/// The material of a session.
pub(crate) fn load_material(session: &Session) -> Result<Material, Failure> {
    let path = session.required(MATERIAL, "diaphane solve SESSION")?;
    let again = || format!("solve again: {}", session.command("solve SESSION --force"));
    Material::load(&path).map_err(|e| Failure::from(e).hint(again()))
}

/// Relights and compares, and writes the result.
pub(crate) fn verify(session: &Session, overwrite: Overwrite) -> Result<Verification, Failure> {
    session.refuse_existing(RESULT, overwrite)?;
    let ledger = Ledger::of(session)?;
    steps::warn(&ledger, "verification")?;
    let inputs = made_from::inputs(&made_from::verification(&ledger));
    let result = Verification { inputs, ..compare(session, &Measured::load(session)?)? };
    session.write_json(RESULT, &result, overwrite)?;
    Ok(result)
}

/// What a verification would say of a measurement; its inputs are left empty, and nothing is written.
pub(crate) fn compare(session: &Session, measured: &Measured) -> Result<Verification, Failure> {
    let material = load_material(session)?;
    let maps: Vec<Vec<f64>> = measured.patterns.iter().map(|p| p.irradiance.clone()).collect();
    if material.channels().len() != measured.channels.len() {
        let error = format!(
            "{MATERIAL}: has {}, the measurement has {}",
            counted(material.channels().len(), "channel"),
            measured.channels.len()
        );
        let hint = format!("solve again: {}", session.command("solve SESSION --force"));
        return Err(Failure::input(error).hint(hint));
    }
    let relit = renderer::relight(&material, &maps)?;

    let mut patterns = Vec::new();
    // (squared error, squared radiance) of fitted and held-out patterns.
    let mut sums = [(0.0, 0.0); 2];
    for (m, pattern) in measured.patterns.iter().enumerate() {
        let (mut error, mut energy) = (0.0, 0.0);
        for (c, images) in relit.iter().enumerate() {
            let pixels = pattern.radiance[c].iter().zip(&pattern.variance[c]).zip(&images[m]);
            for ((l, _), r) in pixels.filter(|((_, v), _)| v.is_finite()) {
                error += (r - l) * (r - l);
                energy += l * l;
            }
        }
        let sum = &mut sums[usize::from(pattern.held_out())];
        *sum = (sum.0 + error, sum.1 + energy);
        // A pattern without a usable pixel (the whole face lit in front) says nothing.
        if energy == 0.0 {
            continue;
        }
        let rel_rms = (error / energy).sqrt();
        patterns.push(PatternError {
            name: pattern.name.clone(),
            held_out: pattern.held_out(),
            rel_rms,
        });
    }
    let [(error, energy), (held_error, held_energy)] = sums;
    let by_channel = against_truth(session, &material)?;
    Ok(Verification {
        fit: error / energy,
        heldout_rel_rms: (held_energy > 0.0).then(|| (held_error / held_energy).sqrt()),
        bssrdf_error: (!by_channel.is_empty())
            .then(|| by_channel.iter().sum::<f64>() / by_channel.len() as f64),
        bssrdf_error_by_channel: by_channel,
        lit_pixels: lit_pixels(measured, &relit, renderer::surface_radiance(&material, &maps)),
        patterns,
        inputs: Vec::new(),
    })
}

/// Errors of lit pixels; `relit` and the surface's share of it are `[channel][pattern][cell]`.
fn lit_pixels(
    measured: &Measured,
    relit: &[Vec<Vec<f64>>],
    surface: Option<Vec<Vec<Vec<f64>>>>,
) -> Option<LitPixels> {
    let surface = surface?;
    // Squared errors with the surface and without it, and squared radiance, of fitted and held-out
    // patterns.
    let mut sums = [[0.0; 3]; 2];
    for (m, pattern) in measured.patterns.iter().enumerate() {
        if pattern.purpose == Purpose::Surface {
            continue;
        }
        let sum = &mut sums[usize::from(pattern.held_out())];
        for (c, (relit, surface)) in relit.iter().zip(&surface).enumerate() {
            let modelled = relit[m].iter().zip(&surface[m]);
            let pixels = pattern.radiance[c].iter().zip(&pattern.lit_variance[c]).zip(modelled);
            for ((l, _), (r, s)) in pixels.filter(|((_, v), _)| v.is_finite()) {
                sum[0] += (r - l) * (r - l);
                sum[1] += (r - s - l) * (r - s - l);
                sum[2] += l * l;
            }
        }
    }
    let [fitted, held] = sums;
    let all: [f64; 3] = std::array::from_fn(|i| fitted[i] + held[i]);
    let rms = |error: f64, energy: f64| (energy > 0.0).then(|| (error / energy).sqrt());
    Some(LitPixels {
        rel_rms: rms(all[0], all[2])?,
        heldout_rel_rms: rms(held[0], held[2]),
        without_surface_rel_rms: rms(all[1], all[2])?,
    })
}

/// E of every channel where the sample is simulated; nothing where nobody knows the truth.
fn against_truth(session: &Session, material: &Material) -> Result<Vec<f64>, Failure> {
    let Some(simulated) = session.simulated()? else { return Ok(Vec::new()) };
    let truth = simulated.truth();
    let mut out = Vec::new();
    let mut solver = CpuSolver::<f32>::new();
    let all = material.channels().len();
    let mut progress = Progress::new("BSSRDF error", 100 * all);
    for (c, (channel, medium)) in material.channels().iter().zip(&truth.media).enumerate() {
        let wide = |v: &[f32]| v.iter().map(|&x| f64::from(x)).collect();
        let acquired =
            Medium::new(*material.grid(), wide(&channel.kappa_mm), wide(&channel.mu_per_mm))?;
        let error = bssrdf_error(
            (&acquired, material.optics(), channel.gain),
            (medium, &truth.optics),
            material.lit_face(),
            &mut solver,
            TOLERANCE,
            |done, all| {
                progress.set(100 * c + 100 * done / all, &channel.name);
                !STOP.load(Ordering::Relaxed)
            },
        )?;
        out.push(error);
    }
    progress.finish(&out.iter().map(|e| format!("{e:.2e}")).collect::<Vec<_>>().join(" "));
    Ok(out)
}
