//! Where the nodes of a tree lie, and which of a node's places they take.

use super::level;

/// A box of voxels: lowest corner, and the corner behind the highest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Region {
    pub low: [i32; 3],
    pub high: [i32; 3],
}

impl Region {
    /// The box of `cells` whose lowest corner is the origin, wider by `margin` on every side.
    /// `None` where voxels could not be counted in 32 bits.
    pub fn around(cells: [usize; 3], margin: i32) -> Option<Self> {
        let mut high = [0; 3];
        for (high, cells) in high.iter_mut().zip(cells) {
            // Nodes begin at multiples of 4096, which must be there too.
            *high = i32::try_from(cells).ok().filter(|&n| n < i32::MAX - 8192)? + margin;
        }
        Some(Self { low: [-margin; 3], high })
    }

    /// Voxels along each axis; 0 where the corners are the wrong way round.
    pub fn size(&self) -> [u64; 3] {
        let along = |axis: usize| i64::from(self.high[axis]) - i64::from(self.low[axis]);
        [along(0), along(1), along(2)].map(|n| u64::try_from(n).unwrap_or(0))
    }

    /// How many voxels there are.
    pub fn voxels(&self) -> u64 {
        self.size().into_iter().fold(1, u64::saturating_mul)
    }

    /// What two boxes have in common.
    pub fn common(&self, other: &Self) -> Self {
        let axis = |of: &dyn Fn(usize) -> i32| [of(0), of(1), of(2)];
        Self {
            low: axis(&|i| self.low[i].max(other.low[i])),
            high: axis(&|i| self.high[i].min(other.high[i])),
        }
    }

    pub fn holds(&self, voxel: [i32; 3]) -> bool {
        (0..3).all(|axis| (self.low[axis]..self.high[axis]).contains(&voxel[axis]))
    }

    /// The part of it that the node of edge `1 << log2` at `origin` covers.
    fn within(&self, origin: [i32; 3], log2: u32) -> Self {
        self.common(&Self { low: origin, high: origin.map(|n| n + (1 << log2)) })
    }

    /// Origins of the nodes of edge `1 << log2` that the box touches, in the order of files: by
    /// x, then y, then z.
    fn nodes(&self, log2: u32) -> Vec<[i32; 3]> {
        let along = |axis: usize| {
            let first = self.low[axis] >> log2;
            let last = (self.high[axis] - 1) >> log2;
            (first..=last).map(move |n| n << log2)
        };
        let mut out = Vec::new();
        for x in along(0) {
            for y in along(1) {
                out.extend(along(2).map(|z| [x, y, z]));
            }
        }
        out
    }

    /// Origins of the root's children.
    pub fn roots(&self) -> Vec<[i32; 3]> {
        self.nodes(level::UPPER)
    }

    /// Origins of a node's children; `log2` is the node's own edge.
    pub fn children(&self, origin: [i32; 3], log2: u32) -> Vec<[i32; 3]> {
        self.within(origin, log2).nodes(below(log2))
    }

    /// Origins of all leaves in the order of files.
    pub fn leaves(&self) -> Vec<[i32; 3]> {
        let mut out = Vec::new();
        for upper in self.roots() {
            for lower in self.children(upper, level::UPPER) {
                out.extend(self.children(lower, level::LOWER));
            }
        }
        out
    }
}

/// Logarithm of the edge of a node's children.
pub(super) fn below(log2: u32) -> u32 {
    if log2 == level::UPPER { level::LOWER } else { level::LEAF }
}

/// The place among a node's children, or a leaf's voxels (`child` 0), of what lies at `at`.
pub(super) fn place(at: [i32; 3], log2: u32, child: u32) -> usize {
    let bits = log2 - child;
    let along = |axis: usize| (at[axis] >> child) as usize & ((1 << bits) - 1);
    (along(0) << (2 * bits)) | (along(1) << bits) | along(2)
}

/// A voxel of the leaf at `origin`, by its place.
pub(super) fn voxel(origin: [i32; 3], place: usize) -> [i32; 3] {
    let place = place as i32;
    [origin[0] + (place >> 6), origin[1] + (place >> 3 & 7), origin[2] + (place & 7)]
}

/// Sets a bit of a mask.
pub(super) fn set(mask: &mut [u8], place: usize) {
    mask[place / 8] |= 1 << (place % 8);
}

/// Which of a leaf's voxels lie in the box.
pub(super) fn leaf_mask(region: &Region, origin: [i32; 3]) -> [u8; 64] {
    let holds = |axis: usize, at: i32| (region.low[axis]..region.high[axis]).contains(&at);
    // A byte is a row along z.
    let row = (0..8).filter(|&z| holds(2, origin[2] + z)).fold(0, |row, z| row | 1 << z);
    std::array::from_fn(|byte| {
        let [x, y, _] = voxel(origin, 8 * byte);
        if holds(0, x) && holds(1, y) { row } else { 0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_cover_the_box_once() {
        let region = Region { low: [-2, -2, -2], high: [130, 11, 9] };
        assert_eq!(region.roots().len(), 8);
        assert_eq!(region.roots()[1], [-4096, -4096, 0]);
        let leaves = region.leaves();
        // 18 × 3 × 3: -8 to 136, -8 to 16, -8 to 16.
        assert_eq!(leaves.len(), 18 * 3 * 3);
        let voxels: u32 = leaves
            .iter()
            .flat_map(|&leaf| leaf_mask(&region, leaf))
            .map(|byte| byte.count_ones())
            .sum();
        assert_eq!(u64::from(voxels), region.voxels());
        assert_eq!(region.voxels(), 132 * 13 * 11);
    }

    #[test]
    fn places_are_z_fastest() {
        assert_eq!(place([1, 2, 3], level::LEAF, 0), 64 + 16 + 3);
        assert_eq!(voxel([8, -8, 0], 64 + 16 + 3), [9, -6, 3]);
        assert_eq!(place([-8, 0, 8], level::LOWER, level::LEAF), (15 << 8) | 1);
        assert_eq!(place([128, 0, -1], level::UPPER, level::LOWER), (1 << 10) | 31);
    }
}
