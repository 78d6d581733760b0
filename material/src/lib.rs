//! The acquired material: volumes of κ and μ, what they mean, where they came from,
//! and every file format that they are read from and written to.

mod grid;
mod optics;

pub use grid::{Grid, GridError};
pub use optics::{
    BoundaryConvention, Face, Illumination, LateralBoundary, Optics, boundary_constant,
    diffuse_reflectance, normal_reflectance,
};
