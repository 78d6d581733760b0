//! Dense grids into a file.

use std::io::{self, Write};

use libdeflater::{CompressionLvl, Compressor};
use rayon::prelude::*;

use super::metadata::{self, Metadata, Value, put_text};
use super::tree::{self, Region, below, leaf_mask, place};
use super::{FILE_VERSION, LIBRARY_VERSION, MAGIC, compression, level};

/// Of libdeflate. Coefficients have hardly a byte that repeats: what makes them smaller is the code
/// of their exponents, which every level has, and further search finds nothing. What is left is as
/// small as by zlib's own default, 6, which is OpenVDB's.
const EFFORT: i32 = 1;
/// Leaves that a thread takes at a time.
const BATCH: usize = 64;

/// What all grids of a file have in common.
pub(super) struct Frame {
    /// Active voxels.
    pub region: Region,
    /// Edges of a voxel in the scene's unit.
    pub spacing: [f64; 3],
}

/// One grid of `N` numbers a voxel, 1 or 3, which `V` knows.
pub(super) struct Field<'a, const N: usize, V> {
    pub name: &'a str,
    /// `fog volume` for what is a density.
    pub class: &'a str,
    /// Further names.
    pub metadata: Metadata,
    pub value: V,
}

/// The start of a file of so many grids.
pub(super) fn head(
    out: &mut impl Write,
    uuid: &str,
    metadata: &Metadata,
    grids: u32,
) -> io::Result<()> {
    let mut bytes = MAGIC.to_le_bytes().to_vec();
    for number in [FILE_VERSION, LIBRARY_VERSION[0], LIBRARY_VERSION[1]] {
        bytes.extend(number.to_le_bytes());
    }
    // Grids can be found by their offsets.
    bytes.push(1);
    bytes.extend(uuid.as_bytes());
    metadata::put(&mut bytes, metadata);
    bytes.extend(grids.to_le_bytes());
    out.write_all(&bytes)
}

impl<const N: usize, V: Fn([i32; 3]) -> [f32; N] + Sync> Field<'_, N, V> {
    /// Writes the grid where the file is `at` bytes long; how long it is then.
    pub fn write(&self, out: &mut impl Write, frame: &Frame, at: u64) -> io::Result<u64> {
        let leaves = frame.region.leaves();
        let mut name = Vec::new();
        put_text(&mut name, self.name);
        put_text(&mut name, if N == 1 { "Tree_float_5_4_3" } else { "Tree_vec3s_5_4_3" });
        // No other grid's tree is shared.
        put_text(&mut name, "");
        let head = self.head(frame);
        // All of the grid has to be there before its offsets are known; compressed, it is small.
        let batches: Vec<Vec<u8>> = leaves
            .par_chunks(BATCH)
            .map_init(Packer::new, |packer, leaves| self.leaves(&frame.region, leaves, packer))
            .collect();
        let start = at + name.len() as u64 + 24;
        let blocks = start + head.len() as u64;
        let end = blocks + batches.iter().map(|batch| batch.len() as u64).sum::<u64>();
        out.write_all(&name)?;
        [start, blocks, end].iter().try_for_each(|offset| out.write_all(&offset.to_le_bytes()))?;
        out.write_all(&head)?;
        batches.iter().try_for_each(|batch| out.write_all(batch))?;
        Ok(end)
    }

    /// Everything but the voxels.
    fn head(&self, frame: &Frame) -> Vec<u8> {
        let Frame { region, spacing } = frame;
        let mut out = Vec::new();
        out.extend((compression::ZIP | compression::ACTIVE_MASK).to_le_bytes());
        let text = |text: &str| Value::Text(text.into());
        let mut all = vec![
            ("class", text(self.class)),
            ("file_bbox_max", Value::Voxel(region.high.map(|n| n - 1))),
            ("file_bbox_min", Value::Voxel(region.low)),
            ("file_compression", text("zip + active values")),
            ("file_voxel_count", Value::Count(region.voxels() as i64)),
            ("is_saved_as_half_float", Value::Truth(false)),
            ("name", text(self.name)),
        ];
        if N == 3 {
            // Colours are not turned with the object.
            all.push(("vector_type", text("invariant")));
        }
        all.extend(self.metadata.iter().cloned());
        metadata::put(&mut out, &all);
        transform(&mut out, *spacing);
        topology::<N>(&mut out, region);
        out
    }

    /// Masks and voxels of some leaves.
    fn leaves(&self, region: &Region, leaves: &[[i32; 3]], packer: &mut Packer) -> Vec<u8> {
        let mut out = Vec::with_capacity(leaves.len() * 512 * 4 * N);
        for &origin in leaves {
            let mask = leaf_mask(region, origin);
            out.extend(mask);
            // Voxels that are not active are all background: none of them is written.
            out.push(0);
            packer.raw.clear();
            for place in (0..512).filter(|place| mask[place / 8] >> (place % 8) & 1 == 1) {
                for number in (self.value)(tree::voxel(origin, place)) {
                    packer.raw.extend(number.to_le_bytes());
                }
            }
            packer.put(&mut out);
        }
        out
    }
}

/// What is used again for each leaf.
struct Packer {
    zlib: Compressor,
    raw: Vec<u8>,
    packed: Vec<u8>,
}

impl Packer {
    fn new() -> Self {
        let effort = CompressionLvl::new(EFFORT).unwrap_or_default();
        // The largest leaf.
        let bytes = 512 * 12;
        Self {
            zlib: Compressor::new(effort),
            raw: Vec::with_capacity(bytes),
            packed: vec![0; bytes],
        }
    }

    /// The bytes of `raw`, compressed where that makes them fewer, after their number, which is
    /// negative where they stand as they are.
    fn put(&mut self, out: &mut Vec<u8>) {
        let Self { zlib, raw, packed } = self;
        // All that can go wrong is that there is no room for what does not become smaller.
        match zlib.zlib_compress(raw, &mut packed[..raw.len()]) {
            Ok(length) if length < raw.len() => {
                out.extend((length as i64).to_le_bytes());
                out.extend(&packed[..length]);
            }
            _ => {
                out.extend((-(raw.len() as i64)).to_le_bytes());
                out.extend(raw.as_slice());
            }
        }
    }
}

/// Index to scene: the first voxel's centre lies half a voxel inside the block's corner.
fn transform(out: &mut Vec<u8>, spacing: [f64; 3]) {
    let cubes = spacing.iter().all(|h| (h / spacing[0] - 1.0).abs() < 1e-9);
    // Some readers take nothing but cubes; these must not be told otherwise for a rounding error.
    let spacing = if cubes { [spacing[0]; 3] } else { spacing };
    put_text(out, if cubes { "UniformScaleTranslateMap" } else { "ScaleTranslateMap" });
    let parts: [fn(f64) -> f64; 6] =
        [|h| 0.5 * h, |h| h, |h| h, |h| 1.0 / h, |h| 1.0 / (h * h), |h| 0.5 / h];
    for part in parts {
        spacing.iter().for_each(|&h| out.extend(part(h).to_le_bytes()));
    }
}

/// The tree without its voxels.
fn topology<const N: usize>(out: &mut Vec<u8>, region: &Region) {
    // One buffer of voxels.
    out.extend(1_i32.to_le_bytes());
    // What is not there is nothing.
    out.extend([0_f32; N].map(f32::to_le_bytes).concat());
    let roots = region.roots();
    // No tiles.
    out.extend(0_u32.to_le_bytes());
    out.extend((roots.len() as u32).to_le_bytes());
    for root in roots {
        out.extend(root.map(i32::to_le_bytes).concat());
        node(out, region, root, level::UPPER);
    }
}

/// A node and what is below it.
fn node(out: &mut Vec<u8>, region: &Region, origin: [i32; 3], log2: u32) {
    let child = below(log2);
    let children = region.children(origin, log2);
    let mut mask = vec![0; 1 << (3 * (log2 - child) - 3)];
    children.iter().for_each(|&at| tree::set(&mut mask, place(at, log2, child)));
    out.extend(&mask);
    // No place is a value of its own: an empty mask, and no values, compressed.
    out.extend(vec![0; mask.len()]);
    out.push(0);
    out.extend(0_i64.to_le_bytes());
    for at in children {
        if child == level::LEAF {
            out.extend(leaf_mask(region, at));
        } else {
            node(out, region, at, child);
        }
    }
}
