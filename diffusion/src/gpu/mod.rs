//! The GPU backend: the same multigrid-preconditioned conjugate gradients as on the CPU, by WGSL
//! kernels through wgpu (Vulkan, Metal, DX12).

mod choice;
mod device;
mod error;
mod kernels;
mod krylov;
mod level;
mod multigrid;
mod objective;
#[cfg(test)]
mod tests;
mod vector;

pub use choice::DeviceChoice;
pub use device::Gpu;
pub use error::GpuError;
pub(crate) use objective::OnGpu;

use crate::{Batch, LinearSolver, Operator, SolveError, SolveReport};
use krylov::{Krylov, System};
use level::{Hierarchy, face_count};

/// Half a unit in the last place of single precision.
const ROUNDING: f64 = f32::EPSILON as f64 / 2.0;

/// Solves on a GPU, in single precision: the coefficients are rounded to it (by 6e-8 of themselves
/// at most), the solution is two numbers of it. The residual that decides is worked out in double
/// precision on the CPU, for the rounded coefficients.
pub struct GpuSolver {
    gpu: Gpu,
    operator: Option<Operator>,
    space: Option<Space>,
}

/// What is allocated for a grid and a number of lanes.
struct Space {
    cells: [usize; 3],
    spacing_mm: [f64; 3],
    quads: usize,
    hierarchy: Hierarchy,
    krylov: Krylov,
    system: System,
    /// Whether the coefficients are those of the operator.
    current: bool,
}

impl GpuSolver {
    /// A solver on a GPU, without an operator yet.
    pub fn new(gpu: Gpu) -> Self {
        Self { gpu, operator: None, space: None }
    }

    /// The GPU.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Work space for the operator and `lanes` fields, with the operator's coefficients in it.
    fn space(&mut self, lanes: usize) -> Result<(), SolveError> {
        let operator = self.operator.as_ref().ok_or(SolveError::NotPrepared)?;
        let quads = quads_that_fit(&self.gpu, operator.cells(), lanes / 4)?;
        let fits = |s: &Space| {
            (s.cells, s.spacing_mm, s.quads) == (operator.cells(), operator.spacing_mm(), quads)
        };
        if !self.space.as_ref().is_some_and(fits) {
            // The old one first: there may not be room for both.
            self.space = None;
            self.space = Some(Space::new(&self.gpu, operator, quads)?);
        }
        if let Some(space) = self.space.as_mut().filter(|space| !space.current) {
            upload(&self.gpu, &space.hierarchy, operator);
            space.current = true;
        }
        Ok(())
    }
}

/// The most quadruples of lanes, up to `wanted`, of which a field fits into a binding.
fn quads_that_fit(gpu: &Gpu, cells: [usize; 3], wanted: usize) -> Result<usize, GpuError> {
    let have = gpu.largest_binding();
    let needed = |quads: usize| (cells.iter().product::<usize>() * quads * 16) as u64;
    let mut quads = wanted;
    while quads > 1 && needed(quads) > have {
        quads /= 2;
    }
    if needed(quads) <= have {
        return Ok(quads);
    }
    let (adapter, lanes, needed) = (gpu.name().into(), 4, needed(1));
    Err(GpuError::OutOfMemory { adapter, cells, lanes, needed, have: Some(have) })
}

impl Space {
    fn new(gpu: &Gpu, operator: &Operator, quads: usize) -> Result<Self, GpuError> {
        let (cells, spacing_mm) = (operator.cells(), operator.spacing_mm());
        let (hierarchy, krylov, system) = gpu.allocating(
            || {
                let hierarchy = Hierarchy::new(gpu, cells, spacing_mm, quads);
                let krylov = Krylov::new(gpu, &hierarchy, quads);
                let system = krylov.system(gpu, &hierarchy, quads);
                (hierarchy, krylov, system)
            },
            || GpuError::OutOfMemory {
                adapter: gpu.name().into(),
                cells,
                lanes: 4 * quads,
                needed: Krylov::bytes(operator.len(), quads, 1),
                have: None,
            },
        )?;
        Ok(Self { cells, spacing_mm, quads, hierarchy, krylov, system, current: false })
    }
}

/// Brings an operator to the finest level, and all others up to date.
fn upload(gpu: &Gpu, hierarchy: &Hierarchy, operator: &Operator) {
    let finest = &hierarchy.levels[0];
    for axis in 0..3 {
        gpu.write(&finest.faces[axis], &face_conductances(operator, axis));
    }
    let absorption: Vec<f32> = operator.absorption.iter().map(|a| *a as f32).collect();
    gpu.write(&finest.absorption, &absorption);
    let mut encoder = gpu.encoder();
    gpu.record(&mut encoder, hierarchy.set_up());
    gpu.queue.submit([encoder.finish()]);
}

/// The conductances across all faces of an axis, in the order of level.wgsl.
fn face_conductances(operator: &Operator, axis: usize) -> Vec<f32> {
    let cells = operator.cells();
    let n = cells[axis];
    let stride: usize = cells[..axis].iter().product();
    let mut out = Vec::with_capacity(face_count(cells, axis));
    let outer = operator.len() / (n * stride);
    let [low, high] = &operator.edge[axis];
    for o in 0..outer {
        let edge = o * stride..(o + 1) * stride;
        out.extend(low[edge.clone()].iter().map(|g| *g as f32));
        let first = o * n * stride;
        let links = &operator.link[axis][first..first + (n - 1) * stride];
        out.extend(links.iter().map(|t| *t as f32));
        out.extend(high[edge].iter().map(|g| *g as f32));
    }
    out
}

impl LinearSolver for GpuSolver {
    fn prepare(&mut self, operator: Operator) -> Result<(), SolveError> {
        self.operator = Some(operator.rounded());
        if let Some(space) = &mut self.space {
            space.current = false;
        }
        Ok(())
    }

    fn solve(
        &mut self,
        b: &Batch,
        x: &mut Batch,
        tolerance: f64,
    ) -> Result<SolveReport, SolveError> {
        let operator = self.operator.as_ref().ok_or(SolveError::NotPrepared)?;
        for found in [b.cells(), x.cells()] {
            if found != operator.len() {
                return Err(SolveError::WrongSize { expected: operator.len(), found });
            }
        }
        self.space(b.lanes())?;
        let mut report = SolveReport { right_hand_sides: b.count(), ..SolveReport::default() };
        let mut history = Vec::new();
        let (Some(space), Some(operator)) = (&mut self.space, &self.operator) else {
            return Err(SolveError::NotPrepared);
        };
        let group = 4 * space.quads;
        // The right-hand side is rounded on its way, and that much of the residual is not seen there.
        let inner = (tolerance.powi(2) - ROUNDING.powi(2)).max((tolerance / 2.0).powi(2)).sqrt();
        for first in (0..b.count()).step_by(group) {
            let lanes = first..(first + group).min(b.count());
            let scale =
                lanes.clone().map(|field| scale_of(b, field)).collect::<Result<Vec<_>, _>>()?;
            let gather = |batch: &Batch| -> Vec<f32> {
                let mut out = vec![0.0; operator.len() * group];
                for (lane, field) in lanes.clone().enumerate() {
                    for cell in 0..operator.len() {
                        out[cell * group + lane] = (batch.get(field, cell) * scale[lane]) as f32;
                    }
                }
                out
            };
            self.gpu.write(&space.krylov.b, &gather(b));
            self.gpu.write(&space.system.high, &gather(x));
            let taken = space.krylov.solve(&self.gpu, &mut space.system, inner)?;
            report.iterations = report.iterations.max(taken.iterations);
            history.extend(taken.history);
            let len = operator.len() * group;
            let read = |buffer| self.gpu.submit_and_read(self.gpu.encoder(), buffer, len);
            let (high, low) = (read(&space.system.high)?, read(&space.krylov.low)?);
            for (lane, field) in lanes.clone().enumerate() {
                let unscale = if scale[lane] > 0.0 { 1.0 / scale[lane] } else { 0.0 };
                for cell in 0..operator.len() {
                    let i = cell * group + lane;
                    let value = f64::from(high[i]) + f64::from(low[i]);
                    x.set(field, cell, value * unscale);
                }
            }
        }
        report.relative_residual = operator.relative_residual(b, x);
        if report.relative_residual <= tolerance {
            Ok(report)
        } else {
            let (reached, iterations) = (report.relative_residual, report.iterations);
            Err(SolveError::Stalled { wanted: tolerance, reached, iterations, history })
        }
    }

    fn operator(&self) -> Option<&Operator> {
        self.operator.as_ref()
    }
}

/// The power of two that brings a right-hand side's norm near 1, so that its squares stay within
/// single precision; 0 for a field of zeros.
fn scale_of(b: &Batch, field: usize) -> Result<f64, SolveError> {
    let norm = (0..b.cells()).map(|cell| b.get(field, cell).powi(2)).sum::<f64>().sqrt();
    if !norm.is_finite() {
        return Err(SolveError::NotFinite { field });
    }
    Ok(if norm > 0.0 { (-norm.log2().round()).exp2() } else { 0.0 })
}
