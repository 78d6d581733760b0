//! `diaphane solve`: κ and μ of every voxel.

use crate::Failure;
use crate::adaptive::CHOICE;
use crate::checkpoint::{self, Checkpoint, Checkpoints};
use crate::cli::STOP;
use crate::measurement::{ARRAYS, Measured};
use crate::output::{Done, Progress};
use crate::regime;
use crate::resolution::{self, ByDepth};
use crate::session::Session;
use crate::steps::next_line;
use crate::surface::{SurfaceFound, add_surface};
use clap::ValueEnum;
use diffusion::{
    CpuSolver, DeviceChoice, Gpu, GpuError, Illuminations, Inverse, InverseError, InverseSettings,
    Iterate, Lambda, Measurement, Method, SolveError, Solved, Stage, invert_from, invert_on_gpu,
};
use material::{Channel, Grid, Input, Material, Optics, Overwrite, Provenance};
use rig::Purpose;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

pub(crate) const MATERIAL: &str = "material/material.diaphane";
pub(crate) const CONVERGENCE: &str = "material/convergence.json";

/// Find κ and μ of every voxel
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane solve my-wax\n  diaphane solve my-wax --method paper --lambda 1e-5"
)]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    #[command(flatten)]
    options: Options,
    /// Replace a material that is there
    #[arg(long)]
    force: bool,
    /// Begin anew, even where an interrupted solve could go on
    #[arg(long)]
    restart: bool,
}

#[derive(clap::Args, Clone)]
pub(crate) struct Options {
    /// How the coefficients are looked for
    #[arg(long, value_enum, default_value = "lbfgs")]
    method: MethodName,
    /// Strength of the smoothness term relative to the energy of the images; if not given it
    /// comes from the noise (lbfgs) or is 1e-5 (paper)
    #[arg(long)]
    lambda: Option<f64>,
    /// Fit a gain for each channel beside κ and μ: where brightness could not be calibrated. Pictures hardly tell it
    /// from a skin that absorbs
    #[arg(long)]
    free_gain: bool,
    /// Keep edges: do not smooth borders of veins and inclusions, where κ or μ changes by more than 10 % from
    /// one cell to the next
    #[arg(long)]
    edges: bool,
    /// Most gradient evaluations for each channel on each grid, from coarse to fine
    #[arg(long, default_value_t = 400)]
    max_evaluations: usize,
    /// What does the work: auto (a GPU in hardware, else the CPU), cpu, gpu or gpu:NAME
    #[arg(long, default_value = "auto")]
    device: DeviceChoice,
}

impl Options {
    /// What the command line has without options.
    pub fn preset() -> Self {
        Self {
            method: MethodName::Lbfgs,
            lambda: None,
            free_gain: false,
            edges: false,
            max_evaluations: 400,
            device: DeviceChoice::Auto,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum MethodName {
    /// L-BFGS on the logarithms
    Lbfgs,
    /// Wang et al. 2008, Table I
    Paper,
}

/// How the solve of one channel went.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ChannelConvergence {
    pub channel: String,
    pub fit: f64,
    pub chi2: f64,
    pub lambda: f64,
    pub gain: f64,
    pub gradient_evaluations: usize,
    pub linear_solves: usize,
    pub homogeneous_kappa_mm: f64,
    pub homogeneous_mu_per_mm: f64,
    /// Fit after each gradient evaluation.
    pub history: Vec<f64>,
    /// `--max-evaluations` ended it before it had converged.
    #[serde(default)]
    pub cut_off: bool,
}

/// How a solve went.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Convergence {
    pub seconds: f64,
    pub fit: f64,
    /// What did the work.
    #[serde(default)]
    pub device: String,
    pub channels: Vec<ChannelConvergence>,
    /// How the surface of each channel was found; empty where there is none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub surface: Vec<SurfaceFound>,
}

impl Convergence {
    /// That channels did not converge, if so.
    pub fn cut_off(&self) -> Option<String> {
        let cut = self.channels.iter().filter(|c| c.cut_off);
        let names: Vec<&str> = cut.map(|c| c.channel.as_str()).collect();
        (!names.is_empty())
            .then(|| format!("did not converge: --max-evaluations cut off {}", names.join(", ")))
    }
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let session = Session::open(&args.session)?;
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    if args.restart {
        session.refuse_existing(MATERIAL, overwrite)?;
        checkpoint::clear(&session)?;
    }
    let result = solve(&session, &args.options, overwrite)?;
    let mut text = String::new();
    for c in &result.channels {
        text += &format!(
            "{}: fit {:.2e}, χ²/N {:.2}, λ {:.1e}, {} gradients, {} linear solves\n",
            c.channel, c.fit, c.chi2, c.lambda, c.gradient_evaluations, c.linear_solves
        );
    }
    for surface in &result.surface {
        text += &format!("{}\n", surface.text());
        surface.warning().iter().for_each(|warning| text += &format!("{warning}\n"));
    }
    if let Some(cut_off) = result.cut_off() {
        let more =
            format!("solve SESSION --max-evaluations {} --force", 2 * args.options.max_evaluations);
        text += &format!("warning: {cut_off}; solve again with more: {}\n", session.command(&more));
    }
    let material = Material::load(&session.path(MATERIAL))?;
    let by_depth = ByDepth::of(&material);
    by_depth.iter().for_each(|by_depth| text += &by_depth.table());
    let doubts = regime::warnings(&material);
    doubts.iter().for_each(|doubt| text += &format!("{doubt}\n"));
    let sum =
        |pick: fn(&ChannelConvergence) -> usize| result.channels.iter().map(pick).sum::<usize>();
    text += &format!(
        "fit {:.2e} in {:.1} s on {}: {}\n{}",
        result.fit,
        result.seconds,
        result.device,
        session.path(MATERIAL).display(),
        next_line(&session)?
    );
    let lambda: Vec<f64> = result.channels.iter().map(|c| c.lambda).collect();
    let json = json!({
        "fit": result.fit,
        "converged": result.cut_off().is_none(),
        "gradient_evaluations": sum(|c| c.gradient_evaluations),
        "linear_solves": sum(|c| c.linear_solves),
        "seconds": result.seconds,
        "device": result.device,
        "lambda": lambda,
        "material": session.path(MATERIAL),
        "channels": result.channels,
        "surface": result.surface,
        "model_warnings": doubts,
        "resolution": by_depth,
    });
    Ok(Done::new(json, text))
}

/// Solves all channels and writes the material.
pub(crate) fn solve(
    session: &Session,
    options: &Options,
    overwrite: Overwrite,
) -> Result<Convergence, Failure> {
    session.refuse_existing(MATERIAL, overwrite)?;
    let started = Instant::now();
    let measured = Measured::load(session)?;
    let fitted = measured.select(Purpose::Fit);
    let sample = &session.config.sample;
    let grid = sample.grid;
    let optics = sample.optics()?;
    let settings = settings(options)?;
    let maps = fitted.iter().map(|p| p.irradiance.clone()).collect();
    let light = Illuminations::new(&grid, sample.lit_face, maps)?;

    let mut provenance = provenance(session, &settings)?;
    let inputs: Vec<&Input> =
        provenance.inputs.iter().filter(|i| i.name.starts_with("measurement/")).collect();
    let problem = (inputs, grid, &optics, sample.lit_face, &provenance.settings);
    let mut solving = Solving {
        grid,
        optics,
        settings,
        gpu: options.device.gpu()?,
        cpu: CpuSolver::new(),
        checkpoints: Checkpoints::new(session, &problem)?,
    };
    let (mut channels, mut reports, mut resolutions) = (Vec::new(), Vec::new(), Vec::new());
    let (mut misfit, mut energy) = (0.0, 0.0);
    for (c, name) in measured.channels.iter().enumerate() {
        let radiance: Vec<Vec<f64>> = fitted.iter().map(|p| p.radiance[c].clone()).collect();
        let variance: Vec<Vec<f64>> = fitted.iter().map(|p| p.variance[c].clone()).collect();
        let measurement =
            Measurement::new(&grid, light.clone(), radiance, &variance).map_err(|e| {
                Failure::input(format!("{}, channel {name}: {e}", session.path(ARRAYS).display()))
            })?;
        let found = solving.channel(name, &measurement)?;
        let solved = Solved {
            grid: &grid,
            optics: &optics,
            measurement: &measurement,
            settings: &settings,
            found: &found,
        };
        // A GPU that was lost on the way is not asked again.
        let device = solving.gpu.as_ref().map_or(&DeviceChoice::Cpu, |_| &options.device);
        resolutions.extend(resolution::map(name, &solved, device)?);
        misfit += found.fit * measurement.energy();
        energy += measurement.energy();
        reports.push(convergence(name, &found));
        let narrow = |v: &[f64]| v.iter().map(|x| *x as f32).collect();
        channels.push(Channel {
            name: name.clone(),
            kappa_mm: narrow(&found.kappa_mm),
            mu_per_mm: narrow(&found.mu_per_mm),
            gain: found.gain,
        });
    }
    if !resolutions.is_empty() {
        let probes = format!("{} probes, seed {}", resolution::PROBES, resolution::SEED);
        provenance.settings.insert("resolution".into(), probes);
    }
    let mut material = Material::new(grid, channels, optics, sample.lit_face, provenance)?;
    if !resolutions.is_empty() {
        material = material.with_resolution(resolutions)?;
    }
    let (material, surface) = add_surface(material, &measured)?;
    let seconds = started.elapsed().as_secs_f64();
    let device = solving.gpu.map_or("CPU".to_owned(), |gpu| gpu.name().to_owned());
    let result = Convergence { seconds, fit: misfit / energy, device, channels: reports, surface };
    session.write_json(CONVERGENCE, &result, Overwrite::Replace)?;
    // The material last: once it is there the solve is done.
    material.save(&session.result(MATERIAL)?, overwrite)?;
    checkpoint::clear(session)?;
    Ok(result)
}

/// A problem that is solved channel by channel, and what does the work.
struct Solving<'s> {
    grid: Grid,
    optics: Optics,
    settings: InverseSettings,
    /// None on the CPU, or once a GPU was lost.
    gpu: Option<Gpu>,
    cpu: CpuSolver<f32>,
    checkpoints: Checkpoints<'s>,
}

/// With `--edges`: the step of log κ or log μ that is one.
const EDGE: f64 = 0.1;

/// What a solve usually takes until it has converged, in forward and adjoint solves on its own grid;
/// the time that is left is judged by it.
const USUAL_SOLVES: f64 = 1600.0;

impl Solving<'_> {
    /// κ and μ of a channel, from where an earlier attempt stopped.
    fn channel(&mut self, name: &str, measurement: &Measurement) -> Result<Inverse, Failure> {
        let mut iterate = match self.checkpoints.load(name)? {
            Some(Checkpoint::Found(found)) => return Ok(found),
            Some(Checkpoint::Going(iterate)) => Some(iterate),
            None => None,
        };
        let mut progress = Progress::new(&format!("solve {name}"), 0);
        if let Some(iterate) = &iterate {
            let done = iterate.work.gradient_evaluations;
            progress.say(&format!("{name}: goes on after {done} gradients"));
        }
        let found = loop {
            let (found, last) = self.attempt(name, measurement, iterate.take(), &mut progress)?;
            match (found, &self.gpu) {
                (
                    Err(InverseError::Solve(SolveError::Gpu(lost @ GpuError::Lost { .. }))),
                    Some(_),
                ) => {
                    progress.say(&format!("warning: {lost}; {name} goes on on the CPU"));
                    (self.gpu, iterate) = (None, last);
                }
                (Err(InverseError::Interrupted), _) => {
                    if let Some(last) = last {
                        self.checkpoints.save(name, &Checkpoint::Going(last))?;
                    }
                    let hint = "run the same command again, and it goes on from here";
                    return Err(Failure::other("interrupted").hint(hint));
                }
                (found, _) => break found?,
            }
        };
        progress.finish(&format!("fit {:.2e}, λ {:.1e}", found.fit, found.lambda));
        self.checkpoints.save(name, &Checkpoint::Found(found.clone()))?;
        Ok(found)
    }

    /// One go at a channel on what there is; beside the answer, the last iterate that was saved, or the one
    /// at which it was interrupted.
    fn attempt(
        &mut self,
        name: &str,
        measurement: &Measurement,
        iterate: Option<Iterate>,
        progress: &mut Progress,
    ) -> Result<(Result<Inverse, InverseError>, Option<Iterate>), Failure> {
        let mut last = iterate.clone();
        let mut failure = None;
        let began = Instant::now();
        let before = iterate.as_ref().map_or(0.0, |iterate| iterate.work.fine_solves);
        let checkpoints = &mut self.checkpoints;
        let mut observe = |p: &diffusion::Progress<'_>| {
            let stage = match p.stage {
                Stage::Homogeneous => "homogeneous start".to_owned(),
                Stage::Volume => format!("{} x {} x {} cells", p.cells[0], p.cells[1], p.cells[2]),
            };
            let message = format!(
                "{stage}: objective {:.3e}, fit {:.2e}, χ²/N {:.2}, λ {:.1e}, {} gradients, {:.0} solves",
                p.objective,
                p.fit,
                p.chi2,
                p.lambda,
                p.work.gradient_evaluations,
                p.work.fine_solves
            );
            let here = p.work.fine_solves - before;
            let left = (here > 0.0 && p.work.fine_solves < USUAL_SOLVES).then(|| {
                began.elapsed().as_secs_f64() / here * (USUAL_SOLVES - p.work.fine_solves)
            });
            progress.set_left(p.work.gradient_evaluations, &message, left);
            let stop = STOP.load(Ordering::Relaxed);
            let due = p.stage == Stage::Volume && (checkpoints.due() || stop);
            if let Some(iterate) = due.then(|| p.iterate()).flatten() {
                let iterate = last.insert(iterate);
                if !stop {
                    let going = Checkpoint::Going(iterate.clone());
                    failure = checkpoints.save(name, &going).err();
                }
            }
            !stop && failure.is_none()
        };
        let (grid, optics, settings) = (&self.grid, &self.optics, &self.settings);
        let found = match &self.gpu {
            None => invert_from(
                iterate,
                grid,
                optics,
                measurement,
                settings,
                &mut self.cpu,
                &mut observe,
            ),
            Some(gpu) => {
                invert_on_gpu(iterate, grid, optics, measurement, settings, gpu, &mut observe)
            }
        };
        match failure {
            Some(failure) => Err(failure),
            None => Ok((found, last)),
        }
    }
}

fn settings(options: &Options) -> Result<InverseSettings, Failure> {
    let lambda = match options.lambda {
        None => Lambda::CrossValidation,
        Some(l) if l.is_finite() && l >= 0.0 => Lambda::Fixed(l),
        Some(l) => {
            return Err(Failure::input(format!("--lambda: expected a number ≥ 0, found {l}")));
        }
    };
    if options.max_evaluations == 0 {
        return Err(Failure::input("--max-evaluations: expected at least 1, found 0"));
    }
    Ok(InverseSettings {
        method: match options.method {
            MethodName::Lbfgs => Method::Lbfgs,
            MethodName::Paper => Method::Paper,
        },
        lambda,
        free_gain: options.free_gain,
        edge: options.edges.then_some(EDGE),
        max_evaluations: options.max_evaluations,
        ..InverseSettings::default()
    })
}

fn convergence(name: &str, found: &Inverse) -> ChannelConvergence {
    ChannelConvergence {
        channel: name.to_owned(),
        fit: found.fit,
        chi2: found.chi2,
        lambda: found.lambda,
        gain: found.gain,
        gradient_evaluations: found.work.gradient_evaluations,
        linear_solves: found.work.linear_solves,
        homogeneous_kappa_mm: found.homogeneous.0,
        homogeneous_mu_per_mm: found.homogeneous.1,
        history: found.history.clone(),
        cut_off: !found.converged,
    }
}

fn provenance(session: &Session, settings: &InverseSettings) -> Result<Provenance, Failure> {
    let mut inputs = Vec::new();
    for name in ["session.toml", ARRAYS, "measurement/measurement.json"] {
        inputs.push(Input::from_file(name, &session.path(name))?);
    }
    for name in ["calibration/calibration.json", CHOICE] {
        if session.path(name).is_file() {
            inputs.push(Input::from_file(name, &session.path(name))?);
        }
    }
    let journal = rig::read_journal(&session.path("journal.jsonl"))?;
    let captured_unix_s = journal.entries.first().map_or(0, |entry| entry.unix_s as u64);
    let seed = match &session.config.rig {
        crate::session::RigConfig::Simulated { sample, .. } => Some(sample.seed),
        _ => None,
    };
    let settings = BTreeMap::from([
        ("method".to_owned(), format!("{:?}", settings.method)),
        ("lambda".to_owned(), format!("{:?}", settings.lambda)),
        ("free_gain".to_owned(), settings.free_gain.to_string()),
        ("edge".to_owned(), settings.edge.map_or("none".to_owned(), |edge| edge.to_string())),
        ("model_error".to_owned(), settings.model_error.to_string()),
        ("max_evaluations".to_owned(), settings.max_evaluations.to_string()),
        ("tolerance".to_owned(), settings.tolerance.to_string()),
    ]);
    Ok(Provenance {
        software: "diaphane".into(),
        version: env!("CARGO_PKG_VERSION").into(),
        captured_unix_s,
        seed,
        inputs,
        settings,
    })
}
