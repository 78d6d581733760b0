//! A session: one folder that holds everything about one sample on one rig.

use crate::Failure;
use crate::adaptive::Brackets;
use crate::wheel::KnownWheel;
use material::{Face, Grid, LateralBoundary, Optics, Overwrite, atomic_write};
use rig::{Acquisition, Chessboard, ProjectorMethod, SampleScheme};
use serde::{Deserialize, Serialize};
use simulator::{Imperfections, SampleSpec, SimulatedRig, Transport};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Version of `session.toml` that this program writes, and the newest that it reads.
const VERSION: u32 = 1;

/// `session.toml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Config {
    /// Version of this file's layout.
    pub version: u32,
    pub sample: Sample,
    pub rig: RigConfig,
    pub plan: PlanConfig,
}

/// The block.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sample {
    pub name: String,
    /// The grid that κ and μ are solved on; its size is the block's size.
    pub grid: Grid,
    pub lit_face: Face,
    /// Refractive index.
    pub eta: f64,
    /// C of the boundary condition, where it is not to follow from the refractive index.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub boundary_constant: Option<f64>,
    #[serde(default)]
    pub boundary: material::BoundaryConvention,
    #[serde(default)]
    pub lateral: LateralBoundary,
    #[serde(default)]
    pub illumination: material::Illumination,
}

impl Sample {
    pub fn optics(&self) -> Result<Optics, Failure> {
        if !(self.eta.is_finite() && self.eta >= 1.0) {
            let error = format!("session.toml: sample.eta must be at least 1, found {}", self.eta);
            return Err(Failure::input(error));
        }
        let mut optics = Optics::with_boundary(self.eta, self.boundary);
        if let Some(c) = self.boundary_constant {
            if !(c.is_finite() && c > 0.0) {
                let error =
                    format!("session.toml: sample.boundary_constant must be positive, found {c}");
                return Err(Failure::input(error));
            }
            optics.boundary_constant = c;
        }
        optics.lateral = self.lateral;
        optics.illumination = self.illumination;
        Ok(optics)
    }
}

/// Where the pictures come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
#[allow(clippy::large_enum_variant, reason = "there is one in a program")]
pub(crate) enum RigConfig {
    /// The simulator.
    Simulated {
        /// What the simulator puts on the rig.
        sample: SampleSpec,
        /// The printed chessboard.
        board: calibration::Board,
        /// The camera's noise figures.
        noise: calibration::NoiseModel,
        /// What the simulated rig gets wrong.
        #[serde(default, skip_serializing_if = "is_plain")]
        imperfections: Imperfections,
        /// How light gets through the sample.
        #[serde(default, skip_serializing_if = "is_diffusion")]
        transport: Transport,
    },
    /// The devices that the session's `rig.toml` names.
    Devices {
        /// The camera, as it described itself when the session was made.
        camera: rig::CameraInfo,
        /// The printed chessboard.
        board: calibration::Board,
        /// The camera's noise figures; `diaphane calibrate noise` measures better ones.
        noise: calibration::NoiseModel,
    },
    /// Pictures that were taken elsewhere; there is nothing to capture.
    Imported,
}

fn is_plain(imperfections: &Imperfections) -> bool {
    *imperfections == Imperfections::default()
}

fn is_diffusion(transport: &Transport) -> bool {
    *transport == Transport::Diffusion
}

/// What is captured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PlanConfig {
    /// Columns and rows of regions on the lit face.
    pub regions: [usize; 2],
    /// How its regions are lit.
    #[serde(default)]
    pub scheme: SampleScheme,
    /// How the exposures of the sample come about.
    #[serde(default)]
    pub brackets: Brackets,
    /// Exposures of the sample, seconds; the most there are, where they are adaptive.
    pub bracket_s: Vec<f64>,
    /// Exposures of chart and white sheet, seconds.
    pub reference_bracket_s: Vec<f64>,
    /// Exposures of the chart for the camera's response, seconds, in uneven steps.
    pub response_bracket_s: Vec<f64>,
    /// Exposure of a chessboard, seconds.
    pub board_exposure_s: f64,
    /// Poses of the chessboard.
    pub board_poses: usize,
    /// The chessboard that the projector shows.
    pub projector_board: Chessboard,
    /// What the projector shows to be calibrated by.
    #[serde(default)]
    pub projector_method: ProjectorMethod,
    /// Columns and rows of the projector.
    #[serde(default = "default_projector_px")]
    pub projector_px: [u32; 2],
    /// Grey levels that the projector's response is measured at.
    #[serde(default = "default_ramp_levels")]
    pub ramp_levels: usize,
    /// A white patch beside the sample that tells of a drifting lamp or lens.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_patch: Option<rig::ReferencePatch>,
}

/// Those of sessions from before codes could be shown.
fn default_projector_px() -> [u32; 2] {
    [1024, 768]
}

/// Every fifth level of 8 bits.
fn default_ramp_levels() -> usize {
    52
}

impl Default for PlanConfig {
    fn default() -> Self {
        Self {
            regions: [4, 4],
            scheme: SampleScheme::default(),
            brackets: Brackets::default(),
            bracket_s: rig::bracket(1.0 / 30.0, 8.0, 9),
            reference_bracket_s: rig::bracket(1.0 / 30.0, 1.0, 6),
            response_bracket_s: rig::uneven_bracket(1.0 / 30.0, 2.0, 14),
            board_exposure_s: 1.0 / 30.0,
            board_poses: 12,
            projector_board: Chessboard { columns: 8, rows: 5, square_px: 50, x0: 287, y0: 234 },
            projector_method: ProjectorMethod::default(),
            projector_px: default_projector_px(),
            ramp_levels: default_ramp_levels(),
            reference_patch: None,
        }
    }
}

/// Most cells of a grid: 512³, some 20 GB of work space.
const MOST_CELLS: usize = 1 << 27;

impl Config {
    /// What is written by hand may be anything.
    fn check(&self) -> Result<(), String> {
        let plan = &self.plan;
        if self.sample.grid.len() > MOST_CELLS {
            return Err(format!(
                "sample.grid: at most {MOST_CELLS} cells, found {}",
                self.sample.grid.len()
            ));
        }
        if plan.regions.iter().any(|n| !(1..=64).contains(n)) {
            return Err(format!("plan.regions: from 1 to 64 each, found {:?}", plan.regions));
        }
        if plan.scheme == SampleScheme::Multiplexed && self.sample.lit_face == Face::Front {
            return Err(
                "plan.scheme: \"multiplexed\" needs a block that is lit from the back: lit \
                        from the front, half of each picture would be lit directly and masked"
                    .into(),
            );
        }
        if plan.board_poses > 1000 {
            return Err(format!("plan.board_poses: at most 1000, found {}", plan.board_poses));
        }
        if plan.projector_px.iter().any(|n| !(8..=16384).contains(n)) {
            return Err(format!(
                "plan.projector_px: from 8 to 16384 each, found {:?}",
                plan.projector_px
            ));
        }
        if !(5..=256).contains(&plan.ramp_levels) {
            return Err(format!("plan.ramp_levels: from 5 to 256, found {}", plan.ramp_levels));
        }
        if let ProjectorMethod::PhaseShift(phase) = plan.projector_method
            && (!(4..=1024).contains(&phase.period_px) || !(3..=64).contains(&phase.steps))
        {
            return Err(format!(
                "plan.projector_method: a period of 4 to 1024 pixels and 3 to 64 steps, found {} and {}",
                phase.period_px, phase.steps
            ));
        }
        let shown = &plan.projector_board;
        if (shown.columns + shown.rows).is_multiple_of(2) {
            return Err(format!(
                "plan.projector_board: one side must be odd and one even, so that a half turn shows; found {} x {}",
                shown.columns, shown.rows
            ));
        }
        match &self.rig {
            RigConfig::Simulated { board, imperfections, transport, .. } => {
                imperfections.check().map_err(|e| format!("rig.imperfections.{e}"))?;
                transport.check().map_err(|e| format!("rig.transport: {e}"))?;
                board.check().map_err(|e| format!("rig.{e}"))?;
            }
            RigConfig::Devices { board, camera, .. } => {
                board.check().map_err(|e| format!("rig.{e}"))?;
                let good = camera.width > 0
                    && camera.height > 0
                    && matches!(camera.channels, 1 | 3)
                    && (8..=16).contains(&camera.bit_depth);
                if !good {
                    return Err(format!(
                        "rig.camera: at least a pixel, 1 or 3 channels, 8 to 16 bits; found {} x {}, {} and {}",
                        camera.width, camera.height, camera.channels, camera.bit_depth
                    ));
                }
            }
            RigConfig::Imported => {}
        }
        Ok(())
    }
}

/// An open session.
pub(crate) struct Session {
    folder: PathBuf,
    pub config: Config,
    /// The projector's colour wheel, once it is measured.
    pub wheel: Option<KnownWheel>,
}

impl Session {
    /// Makes the folder and writes `session.toml`.
    pub fn create(folder: &Path, config: Config, overwrite: Overwrite) -> Result<Self, Failure> {
        config.check().map_err(Failure::input)?;
        std::fs::create_dir_all(folder)
            .map_err(|e| Failure::input(format!("{}: cannot be made: {e}", folder.display())))?;
        let text = toml::to_string(&config).map_err(Failure::other)?;
        atomic_write(&folder.join("session.toml"), overwrite, |file| {
            file.write_all(text.as_bytes())
        })?;
        Ok(Self { folder: folder.into(), config, wheel: KnownWheel::read(folder) })
    }

    pub fn open(folder: &Path) -> Result<Self, Failure> {
        let path = folder.join("session.toml");
        let text = std::fs::read_to_string(&path).map_err(|e| {
            Failure::input(format!("{}: cannot be read: {e}", path.display())).hint(format!(
                "a session is a folder with a session.toml; make one with: diaphane init {}",
                folder.display()
            ))
        })?;
        let bad = |e: toml::de::Error| Failure::input(format!("{}: {e}", path.display()));
        // The version first: a newer file may well hold keys that mean nothing here.
        #[derive(Deserialize)]
        struct Version {
            version: u32,
        }
        let found = toml::from_str::<Version>(&text).map_err(bad)?.version;
        if found > VERSION {
            let error = format!(
                "{}: written by a newer version of Diaphane: layout {found}, this version reads up to {VERSION}",
                path.display()
            );
            return Err(Failure::input(error).hint("update Diaphane"));
        }
        let config: Config = toml::from_str(&text).map_err(bad)?;
        config.check().map_err(|e| Failure::input(format!("{}: {e}", path.display())))?;
        Ok(Self { folder: folder.into(), config, wheel: KnownWheel::read(folder) })
    }

    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// A file of the session.
    pub fn path(&self, relative: &str) -> PathBuf {
        self.folder.join(relative)
    }

    /// The file that an earlier step should have written.
    pub fn required(&self, relative: &str, command: &str) -> Result<PathBuf, Failure> {
        let path = self.path(relative);
        if path.is_file() {
            return Ok(path);
        }
        let command = command.replace("SESSION", &self.folder.display().to_string());
        Err(Failure::missing(&path.display().to_string(), &command))
    }

    /// A path for a result; its folder is made.
    pub fn result(&self, relative: &str) -> Result<PathBuf, Failure> {
        let path = self.path(relative);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|e| {
                Failure::other(format!("{}: cannot be made: {e}", folder.display()))
            })?;
        }
        Ok(path)
    }

    /// Reads a result that was written by [`Session::write_json`].
    pub fn read_json<T: serde::de::DeserializeOwned>(
        &self,
        relative: &str,
        command: &str,
    ) -> Result<T, Failure> {
        let path = self.required(relative, command)?;
        let bytes = std::fs::read(&path)
            .map_err(|e| Failure::input(format!("{}: cannot be read: {e}", path.display())))?;
        serde_json::from_slice(&bytes).map_err(|e| {
            let error = format!("{}: damaged or of another version: {e}", path.display());
            let command = command.replace("SESSION", &self.folder.display().to_string());
            Failure::input(error).hint(format!("make it again with: {command} --force"))
        })
    }

    pub fn write_json(
        &self,
        relative: &str,
        value: &impl Serialize,
        overwrite: Overwrite,
    ) -> Result<PathBuf, Failure> {
        let path = self.result(relative)?;
        let text = serde_json::to_vec_pretty(value).map_err(Failure::other)?;
        atomic_write(&path, overwrite, |file| file.write_all(&text))?;
        Ok(path)
    }

    /// Fails early where a result is there already and is not to be replaced.
    pub fn refuse_existing(&self, relative: &str, overwrite: Overwrite) -> Result<(), Failure> {
        let path = self.path(relative);
        if overwrite == Overwrite::Refuse && path.exists() {
            return Err(material::FileError::Exists { path }.into());
        }
        Ok(())
    }

    /// Exposures of the sample, seconds: whole turns of the projector's colour wheel, if known.
    pub fn sample_bracket_s(&self) -> Vec<f64> {
        let asked = &self.config.plan.bracket_s;
        self.wheel.as_ref().map_or_else(|| asked.clone(), |known| known.bracket_s(asked))
    }

    /// The two plans of a standard acquisition.
    pub fn acquisition(&self) -> Acquisition {
        let plan = &self.config.plan;
        Acquisition {
            lit_face: self.config.sample.lit_face,
            regions: plan.regions,
            scheme: plan.scheme,
            bracket_s: self.sample_bracket_s(),
            reference_bracket_s: plan.reference_bracket_s.clone(),
            response_bracket_s: plan.response_bracket_s.clone(),
            board_exposure_s: plan.board_exposure_s,
            poses: plan.board_poses,
            projector_board: plan.projector_board,
            projector_method: plan.projector_method,
            projector_px: plan.projector_px,
            ramp_levels: plan.ramp_levels,
            repeats: 1,
        }
    }

    /// The simulated rig, if that is what this session has.
    pub fn simulated(&self) -> Result<Option<SimulatedRig>, Failure> {
        match &self.config.rig {
            RigConfig::Simulated { sample, imperfections, transport, .. } => {
                let lit_face = self.config.sample.lit_face;
                Ok(Some(SimulatedRig::with(sample, lit_face, imperfections, *transport)?))
            }
            RigConfig::Devices { .. } | RigConfig::Imported => Ok(None),
        }
    }

    /// Where the pictures of this session would come from, had they not been imported.
    pub fn nothing_to_capture(&self) -> Failure {
        Failure::input(format!(
            "{}: the pictures of this session were imported; there is nothing to capture",
            self.folder().display()
        ))
    }
}
