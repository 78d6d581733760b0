//! The WGSL kernels, as text.
//!
//! One kernel, one file, one twin of the same name on the CPU, in `diffusion` or `renderer`: the
//! two can be read side by side, and one test runs both on the same problem. Data lie on the
//! GPU as they do in `diffusion::Batch` and `diffusion::Operator`: cells x fastest, then y, then
//! z; inside a cell the lanes of the batch side by side. Bindings are numbered in the order of
//! the twin's arguments, what is constant first.
//!
//! This crate knows no device: whoever runs a kernel compiles it.

/// r = b − A x for 16 lanes of the finite-volume operator; `Operator::residual` on the CPU.
///
/// Entry point `residual`, dispatched over ⌈16 nx / 64⌉ × ny × nz workgroups. Bindings of group 0:
/// 0 nx, ny, nz and one unused u32 (uniform); 1, 2, 3 the links along x, y and z; 4 the diagonal;
/// 5 b; 6 x; 7 r (to be written). All but the first are storage buffers of f32: one value a cell,
/// and 16 a cell from 5 on.
pub const RESIDUAL: &str = include_str!("residual.wgsl");
