//! The acquired material: volumes of κ and μ, what they mean, where they came from,
//! and every file format that they are read from and written to.

mod atomic;
mod average;
mod cursor;
pub mod exr_stack;
mod file_error;
mod format;
pub mod gltf;
mod grid;
mod header;
mod milne;
pub mod mitsuba;
mod native;
pub mod npz;
pub mod nrrd;
pub mod openpbr;
mod optics;
pub mod pbrt;
mod provenance;
mod reading;
mod resolution;
mod scattering;
mod surface;
mod template;
pub mod vdb;
mod volume;

pub use atomic::{Overwrite, Unfinished, atomic_copy, atomic_write};
pub use average::Average;
pub use file_error::FileError;
pub use format::{Conversion, Format, Written, readers, write_all};
pub use grid::{Grid, GridError};
pub use milne::{SurfaceLayer, surface_layer};
pub use optics::{
    BoundaryConvention, Face, Illumination, LateralBoundary, Optics, Scheme, boundary_constant,
    diffuse_reflectance, fresnel_reflectance, normal_reflectance, transport_constant,
};
pub use provenance::{Input, Provenance, hash_file};
pub use reading::Reading;
pub use resolution::Resolution;
pub use scattering::{
    Impossible, ScatteringMedium, SceneUnit, absorption_and_scattering, diffusion_and_absorption,
    impossible_voxels,
};
pub use surface::{Surface, lit_response, single_scattering};
pub use volume::{Channel, Coefficient, Material, MaterialError};
