//! The objective of an inverse problem on the GPU: from logarithms of coefficients to the misfit and
//! its gradient, with nothing brought back but sums.

use super::device::Pass;
use super::kernels::Kernel;
use super::krylov::{Krylov, System};
use super::level::{Hierarchy, whole};
use super::vector::{GpuVector, VectorSpace};
use super::{Gpu, GpuError, quads_that_fit};
use crate::conduction::Conduction;
use crate::inverse::{
    Device, InverseError, Misfit, OF_MU, Objective, Problem, RANGE, Work, pull, step_weights,
};
use crate::{SolveError, SurfaceModel};
use material::{Face, LateralBoundary, Scheme};
use std::rc::Rc;

/// Words of `Block` (block.wgsl), and where its origin and range, and its pull stand.
const BLOCK: usize = 24;
const ORIGIN: u64 = 8;
const PULL: u64 = 19;

/// A GPU that evaluates objectives.
pub(crate) struct OnGpu<'g>(pub &'g Gpu);

impl Device for OnGpu<'_> {
    type Objective<'a>
        = GpuObjective
    where
        Self: 'a;

    fn objective<'a>(&'a mut self, problem: &'a Problem) -> Result<GpuObjective, InverseError> {
        Ok(GpuObjective::new(self.0, problem).map_err(SolveError::from)?)
    }
}

/// Some of the patterns: as many as are solved at once.
struct Patterns {
    count: usize,
    fluence: System,
    adjoint: System,
    /// Right-hand side of the forward problem.
    illuminate: Pass,
    /// Radiance of the front face, and its sums.
    look: Vec<Pass>,
    /// Adjoint right-hand side and misfit, and the misfit's sums.
    compare: [Pass; 2],
    /// Onto the gradient by κ and μ.
    contract: Vec<Pass>,
}

/// See [`Objective`].
pub(crate) struct GpuObjective {
    gpu: Gpu,
    hierarchy: Hierarchy,
    krylov: Krylov,
    patterns: Vec<Patterns>,
    vectors: Rc<VectorSpace>,
    /// The point of the last forward solve.
    logs: GpuVector,
    block: wgpu::Buffer,
    totals: wgpu::Buffer,
    slopes: wgpu::Buffer,
    sums: wgpu::Buffer,
    kappa: wgpu::Buffer,
    mu: wgpu::Buffer,
    /// From logarithms to coefficients, conductances and the beam's source.
    prepare: Vec<Pass>,
    free_gain: bool,
    /// What the pull to the centre counts, once there is one.
    pull: f32,
    /// Σ w L_meas² and Σ L_meas².
    energies: [f64; 2],
    /// What weights were multiplied by.
    scale: f64,
    work: Work,
}

impl GpuObjective {
    pub fn new(gpu: &Gpu, problem: &Problem) -> Result<Self, GpuError> {
        let (grid, measurement) = (&problem.grid, &problem.measurement);
        let (cells, light) = (grid.cells(), measurement.light());
        let quads =
            quads_that_fit(gpu, cells, light.count().min(16).div_ceil(4).next_power_of_two())?;
        let groups = light.count().div_ceil(4 * quads);
        let allocate = || Self::allocate(gpu, problem, quads);
        gpu.allocating(allocate, || GpuError::OutOfMemory {
            adapter: gpu.name().into(),
            cells,
            lanes: 4 * quads,
            needed: Krylov::bytes(grid.len(), quads, 2 * groups),
            have: None,
        })
    }

    fn allocate(gpu: &Gpu, problem: &Problem, quads: usize) -> Self {
        let (grid, measurement) = (&problem.grid, &problem.measurement);
        let (cells, n) = (grid.cells(), grid.len());
        let hierarchy = Hierarchy::new(gpu, cells, grid.spacing_mm(), quads);
        let krylov = Krylov::new(gpu, &hierarchy, quads);
        let finest = &hierarchy.levels[0];
        let vectors = VectorSpace::new(gpu, &finest.group, 2 * n);
        let logs = vectors.zeros();
        let [kappa, mu, conducts, source] = std::array::from_fn(|_| gpu.buffer(n));
        let (slopes, totals, block) = (gpu.buffer(3 * n), gpu.buffer(12), gpu.buffer(BLOCK));
        let [x, y, z] = cells.map(|c| c as u32);
        let by_cell = [x.div_ceil(64), y, z];
        let by_column = [x.div_ceil(64), y, 1];
        let by_pixel = [(x * quads as u32).div_ceil(64), y, 1];
        let of = |groups: [u32; 3]| groups.iter().product::<u32>() as usize;
        let sums = gpu.buffer(4 * of(by_cell).max(of(by_pixel)));

        // Weights such that w'L is about 1: what comes of them stays within single precision.
        let energies = [measurement.weighted_energy(), measurement.energy()];
        let pixels = measurement.data().max(1) as f64;
        let scale = (pixels * (energies[1] / pixels).sqrt()).log2().round().exp2();
        let surface = SurfaceModel::new(&problem.optics);
        write_block(gpu, &block, problem, &surface, scale);

        let pass = |kernel, fields: &[&wgpu::Buffer], groups| {
            gpu.pass(kernel, &finest.group, fields.iter().map(|f| whole(f)), groups)
        };
        let add = |kernel, groups: [u32; 3]| {
            let size = std::num::NonZeroU64::new(16 * of(groups) as u64);
            let left = wgpu::BufferBinding { buffer: &sums, offset: 0, size };
            gpu.pass(kernel, &finest.group, [left, whole(&totals)], [1; 3])
        };
        let [fx, fy, fz] = &finest.faces;
        let outline = |kernel, fields: &[&wgpu::Buffer], groups| {
            gpu.pass(kernel, &finest.outline, fields.iter().map(|f| whole(f)), groups)
        };
        let mut prepare = vec![
            outline(
                Kernel::Coefficients,
                &[&block, &logs.buffer, &kappa, &mu, &conducts, &finest.absorption],
                by_cell,
            ),
            outline(
                Kernel::Conduct,
                &[&block, &conducts, fx, fy, fz],
                [(x + 1).div_ceil(64), y + 1, z + 1],
            ),
        ];
        prepare.extend(hierarchy.set_up().iter().cloned());
        prepare.push(pass(Kernel::FirstScatter, &[&block, &kappa, &mu, &source], by_column));

        let light = measurement.light();
        let group = 4 * quads;
        let plane = grid.face_len();
        let face = |maps: &[Vec<f64>], factor: f64| {
            let mut out = vec![0.0f32; plane * group];
            for (lane, map) in maps.iter().enumerate() {
                map.iter()
                    .enumerate()
                    .for_each(|(c, v)| out[c * group + lane] = (v * factor) as f32);
            }
            let buffer = gpu.buffer(out.len());
            gpu.write(&buffer, &out);
            buffer
        };
        let patterns = (0..light.count())
            .step_by(group)
            .map(|first| {
                let range = first..(first + group).min(light.count());
                let irradiance = face(&light.maps()[range.clone()], 1.0);
                let measured = face(&measurement.radiance()[range.clone()], 1.0);
                let weight = face(&measurement.weight()[range.clone()], scale / energies[0]);
                let [radiance, by_radiance] = std::array::from_fn(|_| gpu.buffer(plane * group));
                let fluence = krylov.system(gpu, &hierarchy, quads);
                let adjoint = krylov.system(gpu, &hierarchy, quads);
                let illuminate = pass(
                    Kernel::Illuminate,
                    &[&block, &source, &irradiance, &krylov.b],
                    finest.columns,
                );
                let look = vec![
                    pass(
                        Kernel::ExitRadiance,
                        &[&block, &irradiance, &fluence.high, &measured, &weight, &radiance, &sums],
                        by_pixel,
                    ),
                    add(Kernel::AddOfRadiance, by_pixel),
                ];
                let compare = [
                    pass(
                        Kernel::Misfit,
                        &[
                            &block,
                            &totals,
                            &radiance,
                            &measured,
                            &weight,
                            &by_radiance,
                            &krylov.b,
                            &sums,
                        ],
                        by_pixel,
                    ),
                    add(Kernel::AddOfMisfit, by_pixel),
                ];
                let mut contract = vec![pass(
                    Kernel::Gradient,
                    &[
                        &block,
                        &conducts,
                        &irradiance,
                        &fluence.high,
                        &adjoint.high,
                        &by_radiance,
                        &slopes,
                    ],
                    by_cell,
                )];
                if surface.beam != 0.0 {
                    contract.push(pass(
                        Kernel::BeamGradient,
                        &[&block, &kappa, &mu, &irradiance, &adjoint.high, &slopes],
                        by_column,
                    ));
                }
                let count = range.len();
                Patterns { count, fluence, adjoint, illuminate, look, compare, contract }
            })
            .collect();
        let free_gain = problem.free_gain;
        let (gpu, work) = (gpu.clone(), Work::default());
        Self {
            gpu,
            hierarchy,
            krylov,
            patterns,
            vectors,
            logs,
            block,
            totals,
            slopes,
            sums,
            kappa,
            mu,
            prepare,
            free_gain,
            pull: pull(grid) as f32,
            energies,
            scale,
            work,
        }
    }

    fn submit<'a>(&self, passes: impl IntoIterator<Item = &'a Pass>) {
        let mut encoder = self.gpu.encoder();
        self.gpu.record(&mut encoder, passes);
        self.gpu.queue.submit([encoder.finish()]);
    }

    /// The sums of radiance (0..4), misfit (4..8) and smoothness (8..12).
    fn totals(&self) -> Result<Vec<f32>, InverseError> {
        let read = self.gpu.submit_and_read(self.gpu.encoder(), &self.totals, 12);
        Ok(read.map_err(SolveError::from)?)
    }

    fn clear(&self, buffers: &[&wgpu::Buffer]) {
        let mut encoder = self.gpu.encoder();
        buffers.iter().for_each(|buffer| encoder.clear_buffer(buffer, 0, None));
        self.gpu.queue.submit([encoder.finish()]);
    }

    fn pass(&self, kernel: Kernel, fields: &[&wgpu::Buffer]) -> Pass {
        let level = &self.hierarchy.levels[0];
        let [x, y, z] = level.cells.map(|c| c as u32);
        let fields = fields.iter().map(|f| whole(f));
        self.gpu.pass(kernel, &level.group, fields, [x.div_ceil(64), y, z])
    }
}

impl Objective for GpuObjective {
    type Vector = GpuVector;

    fn cells(&self) -> usize {
        self.hierarchy.levels[0].cells.iter().product()
    }

    fn vector(&self, host: Vec<f64>) -> GpuVector {
        let out = self.vectors.zeros();
        self.gpu.write(&out.buffer, &host.iter().map(|v| *v as f32).collect::<Vec<f32>>());
        out
    }

    fn host(&self, u: &GpuVector) -> Result<Vec<f64>, InverseError> {
        let len = self.logs.buffer.size() as usize / 4;
        let read = self.gpu.submit_and_read(self.gpu.encoder(), &u.buffer, len);
        Ok(read.map_err(SolveError::from)?.into_iter().map(f64::from).collect())
    }

    fn centre(&mut self, centre: [f64; 2]) {
        let words = [centre[0] as f32, centre[1] as f32, RANGE as f32];
        self.gpu.queue.write_buffer(&self.block, 4 * ORIGIN, bytemuck::cast_slice(&words));
        self.gpu.queue.write_buffer(&self.block, 4 * PULL, bytemuck::bytes_of(&self.pull));
    }

    fn forward(&mut self, u: &GpuVector, tolerance: f64) -> Result<Misfit, InverseError> {
        let mut encoder = self.gpu.encoder();
        let size = u.buffer.size();
        encoder.copy_buffer_to_buffer(&u.buffer, 0, &self.logs.buffer, 0, size);
        encoder.clear_buffer(&self.totals, 0, None);
        self.gpu.record(&mut encoder, &self.prepare);
        self.gpu.queue.submit([encoder.finish()]);
        for k in 0..self.patterns.len() {
            self.submit([&self.patterns[k].illuminate]);
            let patterns = &mut self.patterns[k];
            let taken = self.krylov.solve_rounded(&self.gpu, &mut patterns.fluence, tolerance)?;
            self.work.add_solve(patterns.count, &taken.report(patterns.count));
            let patterns = &self.patterns[k];
            self.submit(&patterns.look);
        }
        // The gain needs all radiances; what is compared leaves the adjoint problem's right-hand
        // side in the work space too, which only the last of several groups still finds there.
        for patterns in &self.patterns {
            self.submit(&patterns.compare);
        }
        let totals = self.totals()?;
        let gain = if self.free_gain && totals[0] > 0.0 { totals[1] / totals[0] } else { 1.0 };
        let weighted = f64::from(totals[4]) / self.scale * self.energies[0];
        let kept_out = f64::from(totals[6]) / self.scale * self.energies[0];
        let fit = f64::from(totals[5]) / self.energies[1];
        Ok(Misfit { weighted, kept_out, fit, gain: f64::from(gain) })
    }

    fn gradient(&mut self, tolerance: f64) -> Result<GpuVector, InverseError> {
        self.clear(&[&self.slopes]);
        for k in 0..self.patterns.len() {
            self.clear(&[&self.krylov.b]);
            self.submit(&self.patterns[k].compare[..1]);
            let patterns = &mut self.patterns[k];
            let taken = self.krylov.solve_rounded(&self.gpu, &mut patterns.adjoint, tolerance)?;
            self.work.add_solve(patterns.count, &taken.report(patterns.count));
            self.submit(&self.patterns[k].contract);
        }
        self.work.gradient_evaluations += 1;
        let out = self.vectors.zeros();
        self.submit([&self.pass(
            Kernel::ByLogs,
            &[&self.block, &self.logs.buffer, &self.kappa, &self.mu, &self.slopes, &out.buffer],
        )]);
        Ok(out)
    }

    fn smoothness(&mut self, u: &GpuVector) -> (f64, GpuVector) {
        let out = self.vectors.zeros();
        let bend =
            self.pass(Kernel::SquaredGradient, &[&self.block, &u.buffer, &out.buffer, &self.sums]);
        let level = &self.hierarchy.levels[0];
        let [x, y, z] = level.cells;
        let size = std::num::NonZeroU64::new(16 * (x.div_ceil(64) * y * z) as u64);
        let left = wgpu::BufferBinding { buffer: &self.sums, offset: 0, size };
        let add = self.gpu.pass(
            Kernel::AddOfSmoothness,
            &level.group,
            [left, whole(&self.totals)],
            [1; 3],
        );
        let mut encoder = self.gpu.encoder();
        encoder.clear_buffer(&self.totals, 32, None);
        self.gpu.record(&mut encoder, [&bend, &add]);
        self.gpu.queue.submit([encoder.finish()]);
        let sums = self.totals();
        (sums.map_or(f64::NAN, |t| f64::from(t[8]) + f64::from(t[9])), out)
    }

    fn forget(&mut self) {
        for patterns in &self.patterns {
            self.clear(&[&patterns.fluence.high, &patterns.adjoint.high]);
        }
    }

    fn work(&self) -> Work {
        self.work
    }
}

fn write_block(
    gpu: &Gpu,
    block: &wgpu::Buffer,
    problem: &Problem,
    surface: &SurfaceModel,
    scale: f64,
) {
    let grid = &problem.grid;
    let h = grid.spacing_mm().map(|h| h as f32);
    let weights = step_weights(grid).map(|c| c as f32);
    let flag = |set: bool| f32::from_bits(u32::from(set));
    let words: [f32; BLOCK] = [
        h[0],
        h[1],
        h[2],
        grid.cell_volume_mm3() as f32,
        weights[0],
        weights[1],
        weights[2],
        surface.boundary_constant as f32,
        0.0,
        0.0,
        // No limit until there is a centre; e^80 is still a number of single precision.
        80.0,
        (1.0 / scale) as f32,
        surface.drive as f32,
        surface.beam as f32,
        surface.exit_per_flux as f32,
        surface.exit_per_irradiance as f32,
        flag(problem.measurement.light().face() == Face::Front),
        flag(problem.optics.lateral == LateralBoundary::NoFlux),
        flag(problem.free_gain),
        // No pull either.
        0.0,
        problem.edge.map_or(0.0, |edge| 1.0 / edge as f32),
        flag(problem.optics.scheme == Scheme::Stam),
        flag(Conduction::of(&problem.optics) == Conduction::Asymptotic),
        OF_MU as f32,
    ];
    gpu.write(block, &words);
}
