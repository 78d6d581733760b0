//! The acquired material: volumes of κ and μ, what they mean, where they came from,
//! and every file format that they are read from and written to.

mod atomic;
mod file_error;
mod grid;
mod header;
pub mod mitsuba;
mod native;
pub mod npz;
mod optics;
mod provenance;
mod resolution;
mod volume;

pub use atomic::{Overwrite, Unfinished, atomic_copy, atomic_write};
pub use file_error::FileError;
pub use grid::{Grid, GridError};
pub use optics::{
    BoundaryConvention, Face, Illumination, LateralBoundary, Optics, boundary_constant,
    diffuse_reflectance, normal_reflectance, partial_current_constant,
};
pub use provenance::{Input, Provenance, hash_file};
pub use resolution::Resolution;
pub use volume::{Channel, Coefficient, Material, MaterialError};
