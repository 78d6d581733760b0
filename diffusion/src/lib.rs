//! Forward, adjoint and inverse diffusion on a regular grid: from coefficients to images and
//! from images to coefficients.

mod adjoint;
mod batch;
mod beam;
mod bssrdf;
mod chebyshev;
mod conduction;
mod cpu;
mod field;
mod forward;
mod gpu;
mod hierarchy;
mod illumination;
mod inverse;
mod medium;
mod operator;
mod resample;
mod solver;
mod surface;

pub use adjoint::Gradient;
pub use batch::Batch;
pub use bssrdf::{BssrdfError, average, bssrdf_error};
pub use cpu::{CpuSolver, Real};
pub use forward::Forward;
pub use gpu::{DeviceChoice, Gpu, GpuError, GpuSolver};
pub use illumination::{IlluminationError, Illuminations};
pub use inverse::{
    Determination, Evaluation, Inverse, InverseError, InverseSettings, Iterate, Lambda,
    Measurement, MeasurementError, Method, Observer, PROBING_TOLERANCE, Progress, Solved, Stage,
    Work, evaluate, evaluate_on_gpu, invert, invert_from, invert_on_gpu, widest_patch_mm,
};
pub use medium::{Medium, MediumError};
pub use operator::Operator;
pub use resample::overlaps;
pub use solver::{LinearSolver, SolveError, SolveReport};
pub use surface::SurfaceModel;
