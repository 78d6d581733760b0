//! The WGSL kernels, as text.
//!
//! One kernel, one file, one twin of the same name on the CPU, in `diffusion` or `renderer`: the
//! two can be read side by side, and tests run both on the same problem. What several kernels
//! share (`level.wgsl`, `columns.wgsl`, `stencil.wgsl`, `dot.wgsl`, `total.wgsl`, `block.wgsl`,
//! `scalars_type.wgsl`) stands in front of each of
//! them. Fields lie on the GPU as they do in `diffusion::Batch`: cells x fastest, then y, then z;
//! inside a cell the lanes of the batch side by side, four to a vector.
//!
//! This crate knows no device: whoever runs a kernel compiles it. Group 0 of every kernel is its
//! level of the grid hierarchy, group 1 what it works on, in the order in which the file lists it.
//! The name of a kernel is that of its entry point, unless its file has several.

macro_rules! kernel {
    ($($file:literal),+) => { concat!($(include_str!($file), "\n"),+) };
}

/// x += α p and r −= α A p.
pub const ADVANCE: &str = kernel!(
    "level.wgsl",
    "columns.wgsl",
    "stencil.wgsl",
    "dot.wgsl",
    "scalars_type.wgsl",
    "advance.wgsl"
);
/// The next level's coefficients: `coarsen_x`, `coarsen_y`, `coarsen_z`, `coarsen_cells`.
pub const COARSEN: &str = kernel!("level.wgsl", "coarsen.wgsl");
/// The first Chebyshev step after the coarse correction.
pub const FIRST_STEP_UP: &str =
    kernel!("level.wgsl", "columns.wgsl", "stencil.wgsl", "first_step_up.wgsl");
/// The dense inverse of the coarsest matrix.
pub const INVERT_COARSEST: &str = kernel!("level.wgsl", "invert_coarsest.wgsl");
/// The inverse of every cell's diagonal.
pub const INVERT_DIAGONAL: &str = kernel!("level.wgsl", "invert_diagonal.wgsl");
/// r = b − A x.
pub const RESIDUAL: &str =
    kernel!("level.wgsl", "columns.wgsl", "stencil.wgsl", "dot.wgsl", "residual.wgsl");
/// The coarse right-hand side.
pub const RESTRICT_RESIDUAL: &str = kernel!("level.wgsl", "stencil.wgsl", "restrict_residual.wgsl");
/// What the conjugate gradients know of each lane: `measure`, `begin`, `beta`, `alpha`, `settle`.
pub const SCALARS: &str = kernel!("level.wgsl", "total.wgsl", "scalars_type.wgsl", "scalars.wgsl");
/// The next search direction.
pub const SEARCH_DIRECTION: &str = kernel!(
    "level.wgsl",
    "columns.wgsl",
    "stencil.wgsl",
    "dot.wgsl",
    "scalars_type.wgsl",
    "search_direction.wgsl"
);
/// The second Chebyshev step after the coarse correction.
pub const SECOND_STEP_UP: &str =
    kernel!("level.wgsl", "columns.wgsl", "stencil.wgsl", "dot.wgsl", "second_step_up.wgsl");
/// Two Chebyshev steps from zero.
pub const SMOOTH_FROM_ZERO: &str =
    kernel!("level.wgsl", "columns.wgsl", "stencil.wgsl", "smooth_from_zero.wgsl");
/// The coarsest level's answer.
pub const SOLVE_DIRECTLY: &str = kernel!("level.wgsl", "dot.wgsl", "solve_directly.wgsl");
/// b · b.
pub const SQUARE: &str = kernel!("level.wgsl", "columns.wgsl", "dot.wgsl", "square.wgsl");

/// Adds up the sums that workgroups left: `add_of_radiance`, `add_of_misfit`, `add_of_smoothness`.
pub const ADD_SUMS: &str = kernel!("level.wgsl", "total.wgsl", "add_sums.wgsl");
/// y += factor · x.
pub const ADD_SCALED: &str = kernel!("add_scaled.wgsl");
/// What the first-scatter source adds to the gradient.
pub const BEAM_GRADIENT: &str =
    kernel!("level.wgsl", "block.wgsl", "beam.wgsl", "beam_gradient.wgsl");
/// The gradient by logarithms.
pub const BY_LOGS: &str = kernel!("level.wgsl", "block.wgsl", "by_logs.wgsl");
/// κ, μ and absorption from logarithms.
pub const COEFFICIENTS: &str = kernel!("level.wgsl", "block.wgsl", "coefficients.wgsl");
/// Conductances from κ.
pub const CONDUCT: &str = kernel!("level.wgsl", "block.wgsl", "conduct.wgsl");
/// The radiance of the front face: `exit_radiance`.
pub const EXIT_RADIANCE: &str =
    kernel!("level.wgsl", "block.wgsl", "dot.wgsl", "exit_radiance.wgsl");
/// The first-scatter source.
pub const FIRST_SCATTER: &str =
    kernel!("level.wgsl", "block.wgsl", "beam.wgsl", "first_scatter.wgsl");
/// high += low.
pub const FOLD: &str = kernel!("level.wgsl", "columns.wgsl", "fold.wgsl");
/// The gradient by κ and μ.
pub const GRADIENT: &str = kernel!("level.wgsl", "block.wgsl", "gradient.wgsl");
/// The right-hand side.
pub const ILLUMINATE: &str = kernel!("level.wgsl", "columns.wgsl", "block.wgsl", "illuminate.wgsl");
/// `dot_product` and `largest`.
pub const INNER: &str = kernel!("inner.wgsl");
/// The misfit and the adjoint problem's right-hand side.
pub const MISFIT: &str = kernel!("level.wgsl", "block.wgsl", "dot.wgsl", "misfit.wgsl");
/// y *= factor.
pub const SCALE: &str = kernel!("scale.wgsl");
/// The smoothness and its gradient.
pub const SQUARED_GRADIENT: &str =
    kernel!("level.wgsl", "block.wgsl", "dot.wgsl", "squared_gradient.wgsl");
