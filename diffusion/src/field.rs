//! Memory for large fields.

use bytemuck::Pod;
use memmap2::MmapMut;
use std::ops::{Deref, DerefMut};

/// A huge page. Smaller fields stand on the heap.
const HUGE_PAGE: usize = 1 << 21;

/// `L` values a cell for every cell, 0 to begin with.
///
/// Large ones are mapped and ask for huge pages: a solve goes through hundreds of megabytes again
/// and again, and with pages of 4 KiB a fifth of its time went into faults and address
/// translation. Where a system has none the memory is as good as any other.
pub(crate) enum Field<T, const L: usize> {
    Heap(Vec<[T; L]>),
    Pages(MmapMut),
}

impl<T: Pod, const L: usize> Field<T, L> {
    pub fn zeros(cells: usize) -> Self {
        let bytes = cells * L * size_of::<T>();
        if bytes >= HUGE_PAGE
            && let Ok(map) = MmapMut::map_anon(bytes)
        {
            // Advice that is not taken costs nothing but time.
            #[cfg(target_os = "linux")]
            let _ = map.advise(memmap2::Advice::HugePage);
            return Self::Pages(map);
        }
        Self::Heap(vec![[T::zeroed(); L]; cells])
    }
}

impl<T: Pod, const L: usize> Deref for Field<T, L> {
    type Target = [[T; L]];

    fn deref(&self) -> &[[T; L]] {
        match self {
            Self::Heap(values) => values,
            Self::Pages(map) => bytemuck::cast_slice(map).as_chunks().0,
        }
    }
}

impl<T: Pod, const L: usize> DerefMut for Field<T, L> {
    fn deref_mut(&mut self) -> &mut [[T; L]] {
        match self {
            Self::Heap(values) => values,
            Self::Pages(map) => bytemuck::cast_slice_mut(map).as_chunks_mut().0,
        }
    }
}

impl<T: Pod, const L: usize> Clone for Field<T, L> {
    fn clone(&self) -> Self {
        let mut copy = Self::zeros(self.len());
        copy.copy_from_slice(self);
        copy
    }
}

impl<T: Pod + std::fmt::Debug, const L: usize> std::fmt::Debug for Field<T, L> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::Field;

    #[test]
    fn mapped_and_heap_memory_behave_alike() {
        for cells in [3, 1 << 17] {
            let mut field = Field::<f32, 4>::zeros(cells);
            assert_eq!(matches!(field, Field::Pages(_)), cells > 3);
            assert_eq!(field.len(), cells);
            assert!(field.iter().all(|v| *v == [0.0; 4]));
            field[cells - 1][3] = 7.0;
            assert_eq!(field.clone()[cells - 1], [0.0, 0.0, 0.0, 7.0]);
        }
    }
}
