//! OpenVDB's `.vdb` (file format 224), for Blender, Houdini, Arnold, RenderMan, Unreal and others.
//!
//! A file is a header and grids. A grid is a tree of fixed shape: a root, nodes of 32³ children,
//! nodes of 16³ children, leaves of 8³ voxels; masks say which of them are there. What is written
//! is a dense block: every voxel of a box is active. z is the fastest axis, and index (0, 0, 0) is
//! the centre of the first voxel. Voxels are compressed leaf by leaf with zlib, active ones alone:
//! what OpenVDB itself writes where it was built without Blosc, and reads everywhere.
//!
//! All numbers are little-endian. `docs/material-format.md` describes the layout for others.

mod export;
mod import;
mod metadata;
mod reader;
mod tree;
mod unpack;
mod writer;

pub use export::write;
pub use import::read;

/// Version of the file format that is written; OpenVDB 5 (2017) and later read it.
const FILE_VERSION: u32 = 224;
/// The version of the library that a file claims to be of: the first with this file format.
const LIBRARY_VERSION: [u32; 2] = [5, 0];
/// First eight bytes.
const MAGIC: i64 = 0x5644_4220;

/// Bits of a grid's compression.
mod compression {
    pub const ZIP: u32 = 1;
    pub const ACTIVE_MASK: u32 = 2;
}

/// Logarithm of the edge, in voxels, of what each level of the tree covers.
mod level {
    /// A leaf.
    pub const LEAF: u32 = 3;
    /// A node of leaves.
    pub const LOWER: u32 = 7;
    /// A node of such nodes.
    pub const UPPER: u32 = 12;
}
