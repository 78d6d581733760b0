//! Inverse solves of a study, on the CPU or a GPU.

use super::scene::Scene;
use crate::Failure;
use crate::cli::STOP;
use diffusion::{
    CpuSolver, DeviceChoice, Gpu, GpuSolver, Inverse, InverseError, InverseSettings, LinearSolver,
    Measurement, Progress, invert, invert_on_gpu,
};
use serde::{Deserialize, Serialize};
use std::sync::atomic::Ordering;
use std::time::Instant;

/// What does the work.
pub(crate) struct Device {
    gpu: Option<Gpu>,
    /// For forward solves.
    pub solver: Box<dyn LinearSolver>,
}

/// Fails once Ctrl-C was pressed.
pub(crate) fn go_on() -> Result<(), Failure> {
    if STOP.load(Ordering::Relaxed) { Err(interrupted()) } else { Ok(()) }
}

fn interrupted() -> Failure {
    Failure::other("interrupted").hint("run the same command again")
}

impl Device {
    /// # Errors
    /// A GPU was asked for and there is none, or it will not do.
    pub fn open(choice: &DeviceChoice) -> Result<Self, Failure> {
        let gpu = choice.gpu()?;
        let solver: Box<dyn LinearSolver> = match &gpu {
            None => Box::new(CpuSolver::<f32>::new()),
            Some(gpu) => Box::new(GpuSolver::new(gpu.clone())),
        };
        Ok(Self { gpu, solver })
    }

    /// As the results name it.
    pub fn name(&self) -> &str {
        self.gpu.as_ref().map_or("CPU", Gpu::name)
    }

    /// κ and μ from pictures of a scene, and the seconds that took. `watch` sees every step.
    ///
    /// # Errors
    /// The solve fails, or Ctrl-C was pressed.
    pub fn invert(
        &mut self,
        scene: &Scene,
        pictures: &Measurement,
        settings: &InverseSettings,
        mut watch: impl FnMut(&Progress),
    ) -> Result<(Inverse, f64), Failure> {
        let began = Instant::now();
        let mut observe = |progress: &Progress| {
            watch(progress);
            !STOP.load(Ordering::Relaxed)
        };
        let (grid, optics) = (&scene.grid, &scene.optics());
        let found = match &self.gpu {
            None => invert(grid, optics, pictures, settings, &mut self.solver, &mut observe),
            Some(gpu) => invert_on_gpu(None, grid, optics, pictures, settings, gpu, &mut observe),
        };
        match found {
            Ok(found) => Ok((found, began.elapsed().as_secs_f64())),
            Err(InverseError::Interrupted) => Err(interrupted()),
            Err(other) => Err(other.into()),
        }
    }
}

/// What an inverse solve came to.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub fit: f64,
    pub chi2: f64,
    pub lambda: f64,
    pub gradient_evaluations: usize,
    /// Fields solved for, forward and adjoint, on any grid.
    pub linear_solves: usize,
    /// The same in solves on the finest grid.
    pub fine_solves: f64,
    /// Of the inverse solve alone.
    pub seconds: f64,
}

impl Outcome {
    /// Heads of [`csv`](Self::csv).
    pub const HEADS: &str =
        "fit,chi2,lambda,gradient_evaluations,linear_solves,fine_solves,seconds";

    pub fn new(found: &Inverse, seconds: f64) -> Self {
        Self {
            fit: found.fit,
            chi2: found.chi2,
            lambda: found.lambda,
            gradient_evaluations: found.work.gradient_evaluations,
            linear_solves: found.work.linear_solves,
            fine_solves: found.work.fine_solves,
            seconds,
        }
    }

    pub fn csv(&self) -> String {
        format!(
            "{:.4e},{:.4},{:.3e},{},{},{:.1},{:.2}",
            self.fit,
            self.chi2,
            self.lambda,
            self.gradient_evaluations,
            self.linear_solves,
            self.fine_solves,
            self.seconds
        )
    }
}
