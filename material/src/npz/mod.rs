//! NumPy's `.npz` archives: named arrays, for people who work in Python.

mod material;
mod npy;
mod reader;
mod writer;

pub use reader::{Array, NpzReader};
pub use writer::{NpzWriter, write};

/// Element types that are read. Numbers of every one come out as f64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    F32,
    F64,
    I32,
    I64,
    U8,
    /// Text of so many characters, four bytes each.
    Text(usize),
}

impl Kind {
    /// Bytes of one element.
    fn size(self) -> Option<usize> {
        match self {
            Kind::U8 => Some(1),
            Kind::F32 | Kind::I32 => Some(4),
            Kind::F64 | Kind::I64 => Some(8),
            Kind::Text(characters) => characters.checked_mul(4),
        }
    }
}
