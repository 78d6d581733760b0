//! A session: one folder that holds everything about one sample on one rig.

mod check;
mod way_out;

use crate::Failure;
use crate::adaptive::Brackets;
use crate::wheel::KnownWheel;
use material::{Face, Grid, LateralBoundary, Optics, Overwrite, atomic_write};
use rig::{Acquisition, Chessboard, ProjectorMethod, SampleScheme};
use serde::{Deserialize, Serialize};
use simulator::{Imperfections, SampleSpec, SimulatedRig, Transport};
use std::io::Write;
use std::path::{Path, PathBuf};
use way_out::quoted;

/// What makes a folder a session.
pub(crate) const FILE: &str = "session.toml";

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
    /// `stam` to reproduce Wang et al. 2008.
    #[serde(default)]
    pub scheme: material::Scheme,
}

impl Sample {
    pub fn optics(&self) -> Result<Optics, Failure> {
        self.check().map_err(|e| Failure::input(format!("session.toml: {e}")))?;
        let mut optics = Optics::with_boundary(self.eta, self.boundary);
        if let Some(c) = self.boundary_constant {
            optics.boundary_constant = c;
        }
        optics.lateral = self.lateral;
        optics.illumination = self.illumination;
        optics.scheme = self.scheme;
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
        config.check().map_err(|e| {
            Failure::input(e).hint("what can be given: diaphane init --help, docs/import.md")
        })?;
        std::fs::create_dir_all(folder)
            .map_err(|e| Failure::input(format!("{}: cannot be made: {e}", folder.display())))?;
        let text = toml::to_string(&config).map_err(Failure::other)?;
        atomic_write(&folder.join(FILE), overwrite, |file| file.write_all(text.as_bytes()))?;
        Ok(Self { folder: folder.into(), config, wheel: KnownWheel::read(folder) })
    }

    pub fn open(folder: &Path) -> Result<Self, Failure> {
        Self::refuse_none(folder)?;
        let path = folder.join(FILE);
        let told = path.display();
        let text = std::fs::read_to_string(&path)
            .map_err(|e| Failure::input(format!("{told}: cannot be read: {e}")))?;
        let bad = |e: &dyn std::fmt::Display| {
            let error = format!("{told}: {}", e.to_string().trim_end());
            Failure::input(error).hint(format!(
                "put that right in {told}; diaphane init in another folder writes one that is whole, to compare with"
            ))
        };
        // The version first: a newer file may well hold keys that mean nothing here.
        #[derive(Deserialize)]
        struct Version {
            version: u32,
        }
        let found = toml::from_str::<Version>(&text).map_err(|e| bad(&e))?.version;
        if found > VERSION {
            let error = format!(
                "{told}: written by a newer version of Diaphane: layout {found}, this version reads up to {VERSION}"
            );
            return Err(Failure::input(error).hint("update Diaphane"));
        }
        let config: Config = toml::from_str(&text).map_err(|e| bad(&e))?;
        config.check().map_err(|e| bad(&e))?;
        Ok(Self { folder: folder.into(), config, wheel: KnownWheel::read(folder) })
    }

    /// Fails where a folder is no session, or not there.
    pub fn refuse_none(folder: &Path) -> Result<(), Failure> {
        let path = folder.join(FILE);
        if path.is_file() {
            return Ok(());
        }
        let why = if folder.is_dir() { "is not there" } else { "its folder is not there" };
        Err(Failure::input(format!("{}: {why}", path.display())).hint(format!(
            "a session is a folder with a session.toml; make one with: diaphane init {}",
            quoted(folder)
        )))
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
        Err(Failure::missing(&path.display().to_string(), &self.filled(command)))
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
            Failure::input(error)
                .hint(format!("make it again with: {} --force", self.filled(command)))
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
            return Err(crate::steps::is_there(self, relative));
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
