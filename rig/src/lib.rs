//! The rig: camera, projector and bench behind traits, the capture plan as data, and the
//! runner that carries a plan out, frame by frame, so that nothing is lost when it stops.
//!
//! The simulated rig is just another rig: nothing here can tell it from hardware.

mod acquisition;
mod code;
mod device;
pub mod devices;
mod encode;
mod exposure_choice;
mod frame;
mod held;
mod journal;
mod multiplex;
mod pattern;
mod plan;
mod render;
mod rig_file;
mod runner;
mod survey;
mod timing;

pub use acquisition::{
    Acquisition, BLACK_SHOT, BURST_SHOT, DARK_SHOT, FULL_FACE_SHOT, NOISE_DARK_SHOT,
    NOISE_FLAT_SHOT, ProjectorMethod, SampleScheme, WHITE_AGAIN_SHOT, bracket, burst, code_shot,
    grey_shot, uneven_bracket,
};
pub use code::{CodeSequence, PhaseShift};
pub use device::{
    Bench, Camera, CameraInfo, DeviceError, DeviceErrorKind, Projector, ProjectorInfo, Readback,
    Rig, Target,
};
pub use exposure_choice::{
    ChannelBrightness, ExposureChoice, ExposureChoiceError, FrameNoise, NoiseGoal, choose_exposures,
};
pub use frame::{
    Frame, FrameError, FrameMetadata, FrameStats, PatchStats, read_frame, write_frame,
};
pub use held::HeldBoard;
pub use journal::{
    Entry, Event, Journal, JournalError, Recorded, StopStatus, journal_in_use, read_journal,
};
pub use multiplex::{DemultiplexError, Demultiplexed, SMatrix};
pub use pattern::{Axis, Chessboard, Pattern, PatternError, Rect};
pub use plan::{Plan, PlanError, PlanSummary, PlanWarning, Purpose, Shot};
pub use render::{FaceMap, ProjectorImage};
pub use rig_file::{
    Address, AxisConfig, CameraConfig, ControlConfig, DisplayConfig, GrblAxisConfig, HandsConfig,
    Letter, PlaceConfig, PlaceTarget, ProjectorConfig, RigFile, RigFileError, SimulatedDevices,
    StageConfig, Unit, ZaberAxisConfig,
};
pub use runner::{
    Inventory, Outcome, Progress, ReferencePatch, RunError, RunOptions, Step, Warning, carry_over,
    frame_path, free_bytes, run, set_aside,
};
pub use survey::PixelRect;
pub use timing::{PER_FRAME_S, Timing};
