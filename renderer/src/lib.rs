//! Renders acquired materials. Today a slab on its own grid: the front face under any pattern of
//! light on the lit face.

mod slab;

pub use slab::{RelightError, relight, surface_radiance};
