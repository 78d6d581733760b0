//! The grid hierarchy on the GPU: coefficients of every level, and the dispatches that make the
//! coarser ones from the finest.

use super::Gpu;
use super::device::Pass;
use super::kernels::Kernel;
use crate::hierarchy;

/// Invocations that a dispatch should have before one of them goes through more than one plane:
/// about what fills the largest GPUs.
const INVOCATIONS: usize = 1 << 18;
/// Planes that an invocation goes through at most.
const PLANES: usize = 32;

/// One grid of the hierarchy.
pub(crate) struct Level {
    pub cells: [usize; 3],
    /// Conductances on the faces across x, y and z (see level.wgsl).
    pub faces: [wgpu::Buffer; 3],
    /// μ times the cell's volume.
    pub absorption: wgpu::Buffer,
    pub inverse_diagonal: wgpu::Buffer,
    /// Bind group 0.
    pub group: wgpu::BindGroup,
    /// The same without the coefficients, for the kernels that write them.
    pub outline: wgpu::BindGroup,
    /// Workgroups of a kernel that takes a column a lane quadruple.
    pub columns: [u32; 3],
    /// Workgroups of a kernel that takes a child's parent.
    pub parents: [u32; 3],
}

/// All levels, finest first, and the coarsest matrix's inverse.
pub(crate) struct Hierarchy {
    pub levels: Vec<Level>,
    pub coarsest_inverse: wgpu::Buffer,
    /// Makes everything below the finest level's faces and absorption.
    set_up: Vec<Pass>,
}

impl Level {
    pub fn new(gpu: &Gpu, cells: [usize; 3], coarse: [usize; 3], quads: usize) -> Self {
        let [nx, ny, nz] = cells;
        let faces = std::array::from_fn(|a| gpu.buffer(face_count(cells, a)));
        let absorption = gpu.buffer(nx * ny * nz);
        let planes = (nx * ny * nz * quads / INVOCATIONS).clamp(1, PLANES.min(nz));
        let shift: [u32; 3] = std::array::from_fn(|a| u32::from(coarse[a] != cells[a]));
        let [n, m] = [cells, coarse].map(|c| c.map(|c| c as u32));
        let words = [
            n[0],
            n[1],
            n[2],
            quads as u32,
            m[0],
            m[1],
            m[2],
            planes as u32,
            shift[0],
            shift[1],
            shift[2],
            0,
        ];
        let [fx, fy, fz] = &faces;
        let (uniform, nothing) = (gpu.uniform(&words), gpu.buffer(0));
        let group = gpu.level_group(&uniform, [fx, fy, fz, &absorption]);
        let outline = gpu.level_group(&uniform, [&nothing; 4]);
        let columns = [(n[0] * quads as u32).div_ceil(64), n[1], n[2].div_ceil(planes as u32)];
        let parents = [(m[0] * quads as u32).div_ceil(64), m[1], m[2]];
        let inverse_diagonal = gpu.buffer(nx * ny * nz);
        Self { cells, faces, absorption, inverse_diagonal, group, outline, columns, parents }
    }

    pub fn len(&self) -> usize {
        self.cells.iter().product()
    }
}

impl Hierarchy {
    /// Levels for a grid and `quads` quadruples of fields, without coefficients yet.
    pub fn new(gpu: &Gpu, cells: [usize; 3], spacing_mm: [f64; 3], quads: usize) -> Self {
        let all = hierarchy::levels(cells, spacing_mm);
        let below = all.iter().skip(1).chain(all.last());
        let levels: Vec<Level> =
            all.iter().zip(below).map(|(&c, &b)| Level::new(gpu, c, b, quads)).collect();
        let coarsest = all[all.len() - 1].iter().product::<usize>();
        let coarsest_inverse = gpu.buffer(coarsest * coarsest);
        let set_up = set_up(gpu, &levels, &coarsest_inverse);
        Self { levels, coarsest_inverse, set_up }
    }

    /// The dispatches that bring all levels up to date with the finest one's faces and absorption.
    pub fn set_up(&self) -> &[Pass] {
        &self.set_up
    }
}

fn set_up(gpu: &Gpu, levels: &[Level], inverse: &wgpu::Buffer) -> Vec<Pass> {
    let mut passes = Vec::new();
    for (level, coarse) in levels.iter().zip(levels.iter().skip(1)) {
        let [x, y, z] = coarse.cells.map(|n| n as u32);
        for (kernel, groups) in [
            (Kernel::CoarsenX, [(x + 1).div_ceil(64), y, z]),
            (Kernel::CoarsenY, [x.div_ceil(64), y + 1, z]),
            (Kernel::CoarsenZ, [x.div_ceil(64), y, z + 1]),
            (Kernel::CoarsenCells, [x.div_ceil(64), y, z]),
        ] {
            let fields = coarse.faces.iter().chain([&coarse.absorption]).map(whole);
            passes.push(gpu.pass(kernel, &level.group, fields, groups));
        }
    }
    for level in levels {
        let [x, y, z] = level.cells.map(|n| n as u32);
        let fields = [whole(&level.inverse_diagonal)];
        let groups = [x.div_ceil(64), y, z];
        passes.push(gpu.pass(Kernel::InvertDiagonal, &level.group, fields, groups));
    }
    if let Some(last) = levels.last() {
        let fields = [whole(inverse)];
        passes.push(gpu.pass(Kernel::InvertCoarsest, &last.group, fields, [1; 3]));
    }
    passes
}

/// A buffer from end to end.
pub(crate) fn whole(buffer: &wgpu::Buffer) -> wgpu::BufferBinding<'_> {
    buffer.as_entire_buffer_binding()
}

/// Faces across an axis, those on the surface included.
pub(crate) fn face_count(cells: [usize; 3], axis: usize) -> usize {
    cells.iter().product::<usize>() / cells[axis] * (cells[axis] + 1)
}
