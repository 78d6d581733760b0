//! Forward, adjoint and inverse diffusion on a regular grid: from coefficients to images and
//! from images to coefficients.

mod adjoint;
mod batch;
mod beam;
mod cpu;
mod forward;
mod illumination;
mod medium;
mod operator;
mod solver;
mod surface;

pub use adjoint::Gradient;
pub use batch::Batch;
pub use cpu::{CpuSolver, Real};
pub use forward::Forward;
pub use illumination::{IlluminationError, Illuminations};
pub use medium::{Medium, MediumError};
pub use operator::Operator;
pub use solver::{LinearSolver, SolveError, SolveReport};
pub use surface::SurfaceModel;
