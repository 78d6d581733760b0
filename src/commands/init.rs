//! `diaphane init`: a session on the simulated rig, or on one of devices.

pub(crate) mod devices;

use crate::Failure;
use crate::adaptive::{Brackets, SchemeName};
use crate::devices::RIG_FILE;
use crate::output::Done;
use crate::session::{Config, PlanConfig, RigConfig, Sample, Session};
use crate::wheel;
use calibration::{Board, NoiseModel};
use clap::ValueEnum;
use material::{
    BoundaryConvention, Face, Illumination, LateralBoundary, Overwrite, Scheme, atomic_copy,
};
use serde_json::json;
use simulator::{Imperfections, SampleKind, SampleSpec, SimulatedRig, Transport};
use std::path::PathBuf;

/// Make a session: on the simulated rig, or with --rig on one of devices
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  diaphane init my-wax --sample wax --seed 1\n  diaphane init next-wax --light my-wax\n  diaphane init quick-wax --brackets adaptive\n  \
    diaphane init true-wax --transport monte-carlo\n  \
    diaphane init my-marble --rig rig.toml --size 80x80x12 --cells 160x160x24 --board 9x6 --square 10"
)]
pub(crate) struct Args {
    /// Folder of the session
    session: PathBuf,
    #[command(flatten)]
    simulated: SimulatedArgs,
    #[command(flatten)]
    devices: devices::DeviceArgs,
    /// A session on the same rig whose calibrate light found a colour wheel: all exposures become
    /// whole turns of it
    #[arg(long, value_name = "SESSION")]
    light: Option<PathBuf>,
    /// Exposures of each pattern
    #[arg(long, value_enum, default_value = "full")]
    brackets: Brackets,
    /// How the regions of the lit face are lit
    #[arg(long, value_enum, default_value = "regions")]
    scheme: SchemeName,
    /// Replace a session.toml that is there
    #[arg(long)]
    force: bool,
}

#[derive(clap::Args)]
pub(crate) struct SimulatedArgs {
    /// What the simulated sample is made of
    #[arg(long, value_enum, default_value = "wax")]
    pub sample: SampleName,
    /// Every seed is another block
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The face that the projector lights
    #[arg(long, value_enum, default_value = "back")]
    pub lit: LitFace,
    /// How light gets through the simulated sample: as the solver has it, or photon by photon
    #[arg(long, value_enum, default_value = "diffusion")]
    pub transport: TransportName,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum TransportName {
    Diffusion,
    MonteCarlo,
}

impl From<TransportName> for Transport {
    fn from(name: TransportName) -> Self {
        match name {
            TransportName::Diffusion => Self::Diffusion,
            TransportName::MonteCarlo => Self::monte_carlo(),
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum SampleName {
    Wax,
    Marble,
    Stone,
}

impl SampleName {
    /// The simulator's name for it.
    pub fn kind(self) -> SampleKind {
        match self {
            Self::Wax => SampleKind::Wax,
            Self::Marble => SampleKind::Marble,
            Self::Stone => SampleKind::Stone,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum LitFace {
    Back,
    Front,
}

/// The configuration of a simulated rig, as a technician would have entered it.
pub(crate) fn simulated_config(args: &SimulatedArgs) -> Result<Config, Failure> {
    let kind = args.sample.kind();
    let lit_face = match args.lit {
        LitFace::Back => Face::Back,
        LitFace::Front => Face::Front,
    };
    let spec = SampleSpec { kind, seed: args.seed };
    let rig = SimulatedRig::new(&spec, lit_face)?;
    let sensor = rig.sensor();
    let (columns, rows, square_mm) = rig.board();
    let name = format!("{:?}", kind).to_lowercase();
    Ok(Config {
        version: 1,
        sample: Sample {
            name: format!("{name}-{}", args.seed),
            grid: spec.solved_grid(),
            lit_face,
            eta: spec.eta(),
            boundary_constant: None,
            boundary: BoundaryConvention::default(),
            lateral: LateralBoundary::default(),
            illumination: Illumination::default(),
            scheme: Scheme::default(),
        },
        rig: RigConfig::Simulated {
            sample: spec,
            board: Board::chessboard(columns, rows, square_mm),
            noise: NoiseModel {
                black_level: sensor.black_code(),
                read_noise: sensor.read_noise_code(),
                gain: sensor.gain(),
                full_scale: sensor.full_scale(),
                saturation: 0.995 * sensor.full_scale(),
            },
            imperfections: Imperfections::default(),
            transport: args.transport.into(),
        },
        plan: PlanConfig {
            projector_px: rig.projector_px(),
            reference_patch: Some(rig.reference_patch()),
            ..PlanConfig::default()
        },
    })
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let rig_file = args.devices.rig.as_deref();
    let mut config = match rig_file {
        None => simulated_config(&args.simulated)?,
        Some(path) => devices::config(path, &args.devices, &args.session, args.simulated.lit)?,
    };
    config.plan.brackets = args.brackets;
    config.plan.scheme = args.scheme.into();
    if let Some(other) = &args.light {
        wheel::of_session(other)?.set(&mut config.plan);
    }
    let session = Session::create(&args.session, config, overwrite)?;
    if let Some(path) = rig_file {
        // So that it stays what the pictures were taken with.
        atomic_copy(path, &session.path(RIG_FILE), overwrite)?;
    }
    let folder = session.folder().display();
    let [nx, ny, nz] = session.config.sample.grid.cells();
    let [w, h, d] = session.config.sample.grid.size_mm();
    let text = format!(
        "{folder}: {} of {w:.1} × {h:.1} × {d:.1} mm on {nx} × {ny} × {nz} cells\nnext: {}",
        session.config.sample.name,
        session.command("calibrate all SESSION")
    );
    Ok(Done::new(json!({ "session": session.folder() }), text))
}
