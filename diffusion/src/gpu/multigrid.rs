//! One symmetric V-cycle as a list of dispatches; what it does is told in `cpu::multigrid`.

use super::Gpu;
use super::device::Pass;
use super::kernels::Kernel;
use super::level::{Hierarchy, whole};

/// The V-cycle with its work space.
pub(crate) struct VCycle {
    passes: Vec<Pass>,
    answer: wgpu::Buffer,
    /// Vectors of partial sums of (right-hand side · answer) that a cycle leaves.
    partials: usize,
}

impl VCycle {
    /// A cycle that takes its right-hand side from `b`, one value a lane and cell of the finest
    /// level, and leaves the partial sums of b · answer in `partials`.
    pub fn new(
        gpu: &Gpu,
        hierarchy: &Hierarchy,
        quads: usize,
        b: &wgpu::Buffer,
        partials: &wgpu::Buffer,
    ) -> Self {
        let levels = &hierarchy.levels;
        let field = |k: usize| gpu.buffer(levels[k].len() * quads * 4);
        let last = levels.len() - 1;
        let x: Vec<_> = (0..=last).map(field).collect();
        let half_way: Vec<_> = (0..last).map(field).collect();
        let right: Vec<_> = (0..=last).map(|k| if k == 0 { b.clone() } else { field(k) }).collect();
        let mut passes = Vec::new();
        for (k, level) in levels[..last].iter().enumerate() {
            let fields = [&level.inverse_diagonal, &right[k], &x[k]].map(whole);
            passes.push(gpu.pass(Kernel::SmoothFromZero, &level.group, fields, level.columns));
            let fields = [&right[k], &x[k], &right[k + 1]].map(whole);
            passes.push(gpu.pass(Kernel::RestrictResidual, &level.group, fields, level.parents));
        }
        let coarsest = &levels[last];
        let groups = [((coarsest.len() * quads) as u32).div_ceil(64), 1, 1];
        let fields = [&hierarchy.coarsest_inverse, &right[last], &x[last], partials].map(whole);
        passes.push(gpu.pass(Kernel::SolveDirectly, &coarsest.group, fields, groups));
        for (k, level) in levels[..last].iter().enumerate().rev() {
            let inverse = &level.inverse_diagonal;
            let fields = [inverse, &right[k], &x[k], &x[k + 1], &half_way[k]].map(whole);
            passes.push(gpu.pass(Kernel::FirstStepUp, &level.group, fields, level.columns));
            let fields = [inverse, &right[k], &half_way[k], &x[k + 1], &x[k], partials].map(whole);
            let kernel = if k == 0 { Kernel::SecondStepUp } else { Kernel::SecondStepUpOnly };
            passes.push(gpu.pass(kernel, &level.group, fields, level.columns));
        }
        let groups = if last == 0 { groups } else { levels[0].columns };
        let partials = groups.iter().product::<u32>() as usize * quads;
        Self { passes, answer: x[0].clone(), partials }
    }

    pub fn passes(&self) -> &[Pass] {
        &self.passes
    }

    pub fn answer(&self) -> &wgpu::Buffer {
        &self.answer
    }

    /// Vectors of partial sums that a cycle leaves.
    pub fn partials(&self) -> usize {
        self.partials
    }
}
