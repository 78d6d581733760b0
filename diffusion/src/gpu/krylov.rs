//! Conjugate gradients for up to 16 fields in step, each with its own coefficients. Nothing comes
//! back from the GPU but the scalars, once for every run of iterations.

use super::device::Pass;
use super::kernels::Kernel;
use super::level::{Hierarchy, whole};
use super::multigrid::VCycle;
use super::{Gpu, GpuError};
use crate::{SolveError, SolveReport};
use std::num::NonZeroU64;

/// Words of `Scalars` (scalars_type.wgsl): eight arrays of 16 lanes, two numbers, and padding.
const SCALARS: usize = 8 * 16 + 4;
/// Where what is read back, or written, stands in it.
const RR: usize = 2 * 16;
const SPENT: usize = 7 * 16;
const LIMITS: usize = 8 * 16;
/// A residual carried along in single precision means nothing below this share of what a run
/// began with.
const RESIDUAL_FLOOR: f32 = 2e-6;
/// Tolerances below this are asked for where single precision itself is compared.
const NEAR_ROUNDING: f64 = 3e-7;
/// Iterations of a first run, when nothing is known yet.
const FIRST_RUN: usize = 8;
/// Most iterations of a run: a driver takes a submission that lasts for seconds as a hang.
const MAX_RUN: usize = 30;
/// Runs after which a solve that is still short of its tolerance is called stalled.
const MAX_RUNS: usize = 12;

/// What a solve took.
#[derive(Clone, Debug, Default)]
pub(crate) struct Taken {
    pub iterations: usize,
    pub converged: bool,
    /// Largest relative residual at the end.
    pub relative: f64,
    /// Largest relative residual after every run.
    pub history: Vec<f64>,
}

impl Taken {
    /// The same as the solver's users see it.
    pub fn report(&self, right_hand_sides: usize) -> SolveReport {
        let (iterations, relative_residual) = (self.iterations, self.relative);
        SolveReport { iterations, relative_residual, right_hand_sides }
    }
}

/// Work space for solutions of systems with the same matrix, one after the other.
pub(crate) struct Krylov {
    /// The right-hand side.
    pub b: wgpu::Buffer,
    /// What a solution lacks, see [`System`].
    pub low: wgpu::Buffer,
    r: wgpu::Buffer,
    p: wgpu::Buffer,
    p_next: wgpu::Buffer,
    partials: wgpu::Buffer,
    scalars: wgpu::Buffer,
    cycle: VCycle,
    /// Vectors of partial sums that a kernel of the finest level leaves.
    columns: usize,
}

/// One solution that is sought: `high` + the work space's `low`, two numbers of single precision.
///
/// A single `f32` cannot hold it: rounding alone leaves a residual of ε ‖A‖ ‖x‖, a few 10⁻⁶ of
/// ‖b‖ on a block 20 cells thick.
pub(crate) struct System {
    pub high: wgpu::Buffer,
    /// ‖b‖², r = b − A high, and the state of the lanes.
    begin: Vec<Pass>,
    /// r = b − A high, ‖r‖², and the state of the lanes.
    residual_of_high: Vec<Pass>,
    /// r = b − A high − A low, likewise.
    residual_of_both: Vec<Pass>,
    /// An iteration from p to p_next and one back, that improve `high` (0) or `low` (1).
    iterations: [[Vec<Pass>; 2]; 2],
    /// high += low.
    fold: Pass,
    /// Iterations that the first run of the last solve took, and one.
    expected: usize,
}

impl Krylov {
    pub fn new(gpu: &Gpu, hierarchy: &Hierarchy, quads: usize) -> Self {
        let level = &hierarchy.levels[0];
        let field = || gpu.buffer(level.len() * quads * 4);
        let [b, low, r, p, p_next] = std::array::from_fn(|_| field());
        let groups = level.columns.iter().product::<u32>() as usize;
        let columns = groups * quads;
        // A block that is solved directly has its own number of workgroups.
        let direct = (level.len() * quads).div_ceil(64) * quads;
        let partials = gpu.buffer(4 * columns.max(direct));
        let scalars = gpu.buffer(SCALARS);
        let cycle = VCycle::new(gpu, hierarchy, quads, &r, &partials);
        Self { b, low, r, p, p_next, partials, scalars, cycle, columns }
    }

    /// A solution, 0 to begin with.
    pub fn system(&self, gpu: &Gpu, hierarchy: &Hierarchy, quads: usize) -> System {
        let level = &hierarchy.levels[0];
        let Self { b, low, r, p, p_next, partials, scalars, cycle, columns } = self;
        let high = gpu.buffer(level.len() * quads * 4);
        let column = |kernel, fields: &[&wgpu::Buffer]| {
            let fields = fields.iter().map(|f| whole(f));
            gpu.pass(kernel, &level.group, fields, level.columns)
        };
        let sum = |kernel, vectors: usize| {
            let size = NonZeroU64::new(16 * vectors as u64);
            let left = wgpu::BufferBinding { buffer: partials, offset: 0, size };
            gpu.pass(kernel, &level.group, [left, whole(scalars)], [1; 3])
        };
        let residual_of_high =
            vec![column(Kernel::Residual, &[b, &high, r, partials]), sum(Kernel::Begin, *columns)];
        let mut begin =
            vec![column(Kernel::Square, &[b, partials]), sum(Kernel::Measure, *columns)];
        begin.extend(residual_of_high.iter().cloned());
        let residual_of_both = vec![
            column(Kernel::Residual, &[b, &high, p, partials]),
            column(Kernel::Residual, &[p, low, r, partials]),
            sum(Kernel::Begin, *columns),
        ];
        let iteration = |from: &wgpu::Buffer, to: &wgpu::Buffer, x: &wgpu::Buffer| {
            let mut passes = cycle.passes().to_vec();
            passes.extend([
                sum(Kernel::Beta, cycle.partials()),
                column(Kernel::SearchDirection, &[scalars, cycle.answer(), from, to, partials]),
                sum(Kernel::Alpha, *columns),
                column(Kernel::Advance, &[scalars, to, x, r, partials]),
                sum(Kernel::Settle, *columns),
            ]);
            passes
        };
        let iterations = [&high, low].map(|x| [iteration(p, p_next, x), iteration(p_next, p, x)]);
        let fold = column(Kernel::Fold, &[low, &high]);
        let expected = FIRST_RUN;
        System { fold, high, begin, residual_of_high, residual_of_both, iterations, expected }
    }

    /// One V-cycle on what `r` is given; its answer.
    #[cfg(test)]
    pub fn v_cycle(&self, gpu: &Gpu, r: &[f32]) -> Result<Vec<f32>, GpuError> {
        gpu.write(&self.r, r);
        let mut encoder = gpu.encoder();
        gpu.record(&mut encoder, self.cycle.passes());
        gpu.submit_and_read(encoder, self.cycle.answer(), r.len())
    }

    /// Bytes that the work space and `systems` solutions take, those of the hierarchy included.
    pub fn bytes(cells: usize, quads: usize, systems: usize) -> u64 {
        // Five vectors here, x and half-way of the finest level, three of all coarser ones (1/7 of
        // the finest together), and five values a cell of coefficients.
        let vectors = systems as f64 + 7.0 + 3.0 / 7.0;
        (cells as f64 * (vectors * 16.0 * quads as f64 + 20.0 * 8.0 / 7.0)) as u64
    }

    /// Solves A (high + low) = b from what `high` holds, until ‖r‖ ≤ `tolerance` ‖b‖ in every lane.
    ///
    /// # Errors
    /// The device was lost.
    pub fn solve(&self, gpu: &Gpu, system: &mut System, tolerance: f64) -> Result<Taken, GpuError> {
        // A little below the tolerance, so that rounding does not cost another run; where it is near
        // rounding itself, well below: a lane that is there after the first run stays as it is.
        let below = if tolerance < NEAR_ROUNDING { 0.1 } else { 0.7 };
        let aim = (below * tolerance).powi(2) as f32;
        let limits = [aim.max(f32::MIN_POSITIVE), RESIDUAL_FLOOR * RESIDUAL_FLOOR];
        gpu.queue.write_buffer(&self.scalars, 4 * LIMITS as u64, bytemuck::cast_slice(&limits));
        let mut taken = Taken::default();
        let mut run = system.expected;
        for number in 0..MAX_RUNS {
            let mut encoder = gpu.encoder();
            encoder.clear_buffer(&self.p, 0, None);
            let low = usize::from(number > 0);
            if number == 0 {
                encoder.clear_buffer(&self.low, 0, None);
                gpu.record(&mut encoder, &system.begin);
            }
            let pair = &system.iterations[low];
            gpu.record(&mut encoder, (0..run).flat_map(|k| &pair[k % 2]));
            let check = if low == 0 { &system.residual_of_high } else { &system.residual_of_both };
            gpu.record(&mut encoder, check);
            let scalars = gpu.submit_and_read(encoder, &self.scalars, SCALARS)?;
            let spent = scalars[SPENT..SPENT + 16].iter().fold(0.0f32, |a, n| a.max(*n)) as usize;
            let here = spent - taken.iterations;
            taken.iterations = spent;
            let (rr, bb) = (&scalars[RR..RR + 16], &scalars[..16]);
            let lit = rr.iter().zip(bb).filter(|(_, b)| **b > 0.0);
            let relative = lit.map(|(r, b)| (f64::from(*r) / f64::from(*b)).sqrt());
            let worst = relative.fold(0.0, |a: f64, r| if r.is_nan() { r } else { a.max(r) });
            if number == 0 {
                // One more than it took, for blocks change from solve to solve.
                system.expected = here + 1;
            }
            let before = taken.history.last().copied().unwrap_or(1.0);
            taken.history.push(worst);
            taken.relative = worst;
            if worst <= tolerance {
                taken.converged = true;
                break;
            }
            // What is left can be a matter of rounding, which another run takes away; one that
            // gains less than half has nothing left to gain.
            if !worst.is_finite() || (number > 0 && worst > 0.5 * before) {
                break;
            }
            let rate = (worst / before).ln().min(-0.5) / here.max(1) as f64;
            run = (((0.5 * tolerance / worst).ln() / rate).ceil() as usize).clamp(1, MAX_RUN);
        }
        Ok(taken)
    }

    /// Solves, and leaves the solution in `high` alone, rounded to single precision.
    ///
    /// # Errors
    /// The device was lost, or the solve stalled.
    pub fn solve_rounded(
        &self,
        gpu: &Gpu,
        system: &mut System,
        tolerance: f64,
    ) -> Result<Taken, SolveError> {
        let taken = self.solve(gpu, system, tolerance)?;
        if !taken.converged {
            let Taken { iterations, relative: reached, history, .. } = taken;
            return Err(SolveError::Stalled { wanted: tolerance, reached, iterations, history });
        }
        if taken.history.len() > 1 {
            let mut encoder = gpu.encoder();
            gpu.record(&mut encoder, [&system.fold]);
            gpu.queue.submit([encoder.finish()]);
        }
        Ok(taken)
    }
}
