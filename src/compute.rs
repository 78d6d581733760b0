//! What does the work of a solve: the CPU, or a GPU.

use crate::Failure;
use diffusion::{CpuSolver, DeviceChoice, GpuSolver, LinearSolver};

/// The least relative residual that single precision reaches on any block, with some to spare.
const SINGLE: f64 = 3e-7;

/// A solver for a relative residual, and the name of what it works on.
///
/// # Errors
/// A GPU was asked for and there is none, or it will not do.
pub(crate) fn solver(
    device: &DeviceChoice,
    tolerance: f64,
) -> Result<(Box<dyn LinearSolver>, String), Failure> {
    let gpu = match device {
        DeviceChoice::Auto if tolerance < SINGLE => None,
        device => device.gpu()?,
    };
    Ok(match gpu {
        None => (Box::new(CpuSolver::<f32>::new()), "CPU".into()),
        Some(gpu) => {
            let name = gpu.name().to_owned();
            (Box::new(GpuSolver::new(gpu)), name)
        }
    })
}
