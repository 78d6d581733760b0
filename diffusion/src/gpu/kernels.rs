//! The compiled kernels.

use crate::chebyshev::WEIGHTS;

/// A kernel of `shaders`, by the name of its entry point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kernel {
    SmoothFromZero,
    RestrictResidual,
    FirstStepUp,
    /// On the finest level, with the dot that the conjugate gradients need.
    SecondStepUp,
    /// On the others, without.
    SecondStepUpOnly,
    SolveDirectly,
    SearchDirection,
    Advance,
    Residual,
    Square,
    Measure,
    Begin,
    Beta,
    Alpha,
    Settle,
    CoarsenX,
    CoarsenY,
    CoarsenZ,
    CoarsenCells,
    InvertDiagonal,
    InvertCoarsest,
    Fold,
    Coefficients,
    Conduct,
    FirstScatter,
    Illuminate,
    ExitRadiance,
    Misfit,
    AddOfRadiance,
    AddOfMisfit,
    AddOfSmoothness,
    Gradient,
    BeamGradient,
    ByLogs,
    SquaredGradient,
    AddScaled,
    Scale,
    DotProduct,
    Largest,
}

/// What a kernel is compiled from: its text and entry point, how it sees its fields (r reads, w
/// writes as well), and its constants.
type Recipe = (Kernel, &'static str, &'static str, &'static str, &'static [(&'static str, f64)]);

const RECIPES: [Recipe; 39] = {
    use Kernel::*;
    use shaders::*;
    const SMOOTH: &[(&str, f64)] = &[("own", WEIGHTS.own), ("others", WEIGHTS.others)];
    const FIRST: &[(&str, f64)] = &[("first", WEIGHTS.first)];
    const SECOND: &[(&str, f64)] = &[("momentum", WEIGHTS.momentum), ("step", WEIGHTS.step)];
    const SECOND_ONLY: &[(&str, f64)] =
        &[("momentum", WEIGHTS.momentum), ("step", WEIGHTS.step), ("with_dot", 0.0)];
    [
        (SmoothFromZero, SMOOTH_FROM_ZERO, "smooth_from_zero", "rrw", SMOOTH),
        (RestrictResidual, RESTRICT_RESIDUAL, "restrict_residual", "rrw", &[]),
        (FirstStepUp, FIRST_STEP_UP, "first_step_up", "rrrrw", FIRST),
        (SecondStepUp, SECOND_STEP_UP, "second_step_up", "rrrrww", SECOND),
        (SecondStepUpOnly, SECOND_STEP_UP, "second_step_up", "rrrrww", SECOND_ONLY),
        (SolveDirectly, SOLVE_DIRECTLY, "solve_directly", "rrww", &[]),
        (SearchDirection, SEARCH_DIRECTION, "search_direction", "rrrww", &[]),
        (Advance, ADVANCE, "advance", "rrwww", &[]),
        (Residual, RESIDUAL, "residual", "rrww", &[]),
        (Square, SQUARE, "square", "rw", &[]),
        (Measure, SCALARS, "measure", "rw", &[]),
        (Begin, SCALARS, "begin", "rw", &[]),
        (Beta, SCALARS, "beta", "rw", &[]),
        (Alpha, SCALARS, "alpha", "rw", &[]),
        (Settle, SCALARS, "settle", "rw", &[]),
        (CoarsenX, COARSEN, "coarsen_x", "wwww", &[]),
        (CoarsenY, COARSEN, "coarsen_y", "wwww", &[]),
        (CoarsenZ, COARSEN, "coarsen_z", "wwww", &[]),
        (CoarsenCells, COARSEN, "coarsen_cells", "wwww", &[]),
        (InvertDiagonal, INVERT_DIAGONAL, "invert_diagonal", "w", &[]),
        (InvertCoarsest, INVERT_COARSEST, "invert_coarsest", "w", &[]),
        (Fold, FOLD, "fold", "rw", &[]),
        (Coefficients, COEFFICIENTS, "coefficients", "rrwwww", &[]),
        (Conduct, CONDUCT, "conduct", "rrwww", &[]),
        (FirstScatter, FIRST_SCATTER, "first_scatter", "rrrw", &[]),
        (Illuminate, ILLUMINATE, "illuminate", "rrrw", &[]),
        (ExitRadiance, EXIT_RADIANCE, "exit_radiance", "rrrrrww", &[]),
        (Misfit, MISFIT, "misfit", "rrrrrwww", &[]),
        (AddOfRadiance, ADD_SUMS, "add_of_radiance", "rw", &[]),
        (AddOfMisfit, ADD_SUMS, "add_of_misfit", "rw", &[]),
        (AddOfSmoothness, ADD_SUMS, "add_of_smoothness", "rw", &[]),
        (Gradient, GRADIENT, "gradient", "rrrrrrw", &[]),
        (BeamGradient, BEAM_GRADIENT, "beam_gradient", "rrrrrw", &[]),
        (ByLogs, BY_LOGS, "by_logs", "rrrrrw", &[]),
        (SquaredGradient, SQUARED_GRADIENT, "squared_gradient", "rrww", &[]),
        (AddScaled, ADD_SCALED, "add_scaled", "rrw", &[]),
        (Scale, SCALE, "scale", "rw", &[]),
        (DotProduct, INNER, "dot_product", "rrw", &[]),
        (Largest, INNER, "largest", "rrw", &[]),
    ]
};

/// All kernels, compiled for a device.
pub(crate) struct Pipelines {
    level: wgpu::BindGroupLayout,
    compiled: Vec<(wgpu::ComputePipeline, wgpu::BindGroupLayout)>,
}

impl Pipelines {
    pub fn new(device: &wgpu::Device) -> Self {
        let level = bind_group_layout(device, true, "rrrr");
        let compiled = RECIPES
            .iter()
            .map(|&(_, source, entry, fields, constants)| {
                let fields = bind_group_layout(device, false, fields);
                let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some(entry),
                    bind_group_layouts: &[Some(&level), Some(&fields)],
                    immediate_size: 0,
                });
                let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(entry),
                    source: wgpu::ShaderSource::Wgsl(source.into()),
                });
                let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry),
                    layout: Some(&layout),
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants,
                        ..Default::default()
                    },
                    cache: None,
                });
                (pipeline, fields)
            })
            .collect();
        Self { level, compiled }
    }

    pub fn level_layout(&self) -> &wgpu::BindGroupLayout {
        &self.level
    }

    pub fn fields_layout(&self, kernel: Kernel) -> &wgpu::BindGroupLayout {
        &self.compiled[kernel as usize].1
    }

    pub fn get(&self, kernel: Kernel) -> &wgpu::ComputePipeline {
        &self.compiled[kernel as usize].0
    }
}

/// A layout of storage buffers, behind one uniform if `uniform` is set.
fn bind_group_layout(device: &wgpu::Device, uniform: bool, access: &str) -> wgpu::BindGroupLayout {
    let storage = access.chars().map(|a| wgpu::BufferBindingType::Storage { read_only: a == 'r' });
    let types = uniform.then_some(wgpu::BufferBindingType::Uniform).into_iter().chain(storage);
    let entries: Vec<_> = (0..)
        .zip(types)
        .map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &entries,
    })
}

#[cfg(test)]
mod tests {
    use super::RECIPES;

    #[test]
    fn recipes_stand_in_the_order_of_their_names() {
        for (k, (kernel, ..)) in RECIPES.iter().enumerate() {
            assert_eq!(*kernel as usize, k, "{kernel:?}");
        }
    }
}
