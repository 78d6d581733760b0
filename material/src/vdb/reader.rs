//! Grids out of a file that need not be honest.

use std::collections::BTreeMap;

use flate2::Decompress;

use super::tree::{Region, below, voxel};
use super::unpack::inflate;
use super::{FILE_VERSION, MAGIC, compression, level};
use crate::cursor::Cursor;

/// First file format that says for each node how its voxels are stored (OpenVDB 3).
const OLDEST: u32 = 222;
/// No more voxels than this for each byte of a file: a block that is the same throughout takes
/// about a tenth of that. It bounds what a false size can make us allocate.
const MOST_VOXELS_A_BYTE: u64 = 64;

/// A file's table of contents.
pub(super) struct VdbFile<'a> {
    bytes: &'a [u8],
    /// Those that are texts.
    pub metadata: BTreeMap<String, String>,
    pub grids: Vec<Entry>,
}

/// A grid and where it is.
pub(super) struct Entry {
    pub name: String,
    kind: String,
    start: u64,
}

/// A grid before its voxels are read.
pub(super) struct Grid<'a> {
    cursor: Cursor<'a>,
    /// Texts only.
    pub metadata: BTreeMap<String, String>,
    /// Edges of a voxel in the scene's unit.
    pub spacing: [f64; 3],
    /// Numbers a voxel, 1 or 3.
    pub width: usize,
    compression: u32,
    background: [f32; 3],
    tiles: Vec<Tile>,
    leaves: Vec<Leaf>,
    most_voxels: u64,
    /// Used again for each leaf.
    zlib: Decompress,
}

/// A part that has one value throughout.
struct Tile {
    part: Region,
    value: [f32; 3],
}

struct Leaf {
    origin: [i32; 3],
    active: [u8; 64],
}

/// How a node's values that are not active are stored.
mod inactive {
    /// All values are there.
    pub const ALL_VALUES: u8 = 6;
    /// Numbers of values, and masks, that come before the active values, for 0 to 6.
    pub const VALUES: [usize; 7] = [0, 0, 1, 0, 1, 2, 0];
    pub const MASKS: [usize; 7] = [0, 0, 0, 1, 1, 1, 0];
}

impl<'a> VdbFile<'a> {
    pub fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let mut cursor = Cursor::new(bytes);
        if cursor.i64()? != MAGIC {
            return Err("expected an OpenVDB file, found something else".into());
        }
        let version = cursor.u32()?;
        if !(OLDEST..=FILE_VERSION).contains(&version) {
            let range = format!("{OLDEST} to {FILE_VERSION}");
            return Err(format!("expected OpenVDB's file format {range}, found {version}"));
        }
        // Version of the library.
        cursor.take(8)?;
        if cursor.array::<1>()? != [1] {
            return Err("expected a file with a table of its grids, found a stream".into());
        }
        // UUID.
        cursor.take(36)?;
        let metadata = texts(&mut cursor)?;
        let mut grids = Vec::new();
        for _ in 0..cursor.u32()? {
            let name = cursor.text()?;
            // Of grids of one name all but the first carry a number behind a control character.
            let name = name.split('\u{1e}').next().unwrap_or_default().to_owned();
            let kind = cursor.text()?;
            let shared = cursor.text()?;
            if !shared.is_empty() {
                return Err(format!(
                    "grid {name:?}: expected a tree of its own, found {shared:?}'s"
                ));
            }
            let [start, _, end] = [cursor.i64()?, cursor.i64()?, cursor.i64()?];
            let offset =
                |n: i64| u64::try_from(n).map_err(|_| format!("grid {name:?}: at byte {n}"));
            let (start, end) = (offset(start)?, offset(end)?);
            // Descriptors that point back would make a small file endless.
            if start < cursor.at() || end <= start {
                return Err(format!(
                    "grid {name:?}: it cannot lie from byte {start} to byte {end}"
                ));
            }
            cursor.seek(end)?;
            grids.push(Entry { name, kind, start });
        }
        Ok(Self { bytes, metadata, grids })
    }

    /// The names of its grids.
    pub fn names(&self) -> Vec<String> {
        self.grids.iter().map(|grid| grid.name.clone()).collect()
    }

    /// The first grid of that name, up to its voxels.
    pub fn grid(&self, name: &str) -> Option<Result<Grid<'a>, String>> {
        let entry = self.grids.iter().find(|grid| grid.name == name)?;
        Some(self.read(entry).map_err(|error| format!("grid {name:?}: {error}")))
    }

    fn read(&self, entry: &Entry) -> Result<Grid<'a>, String> {
        let width = match entry.kind.as_str() {
            "Tree_float_5_4_3" => 1,
            "Tree_vec3s_5_4_3" => 3,
            other => {
                return Err(format!("expected float or vec3s in single precision, found {other}"));
            }
        };
        let mut cursor = Cursor::new(self.bytes);
        cursor.seek(entry.start)?;
        let compression = cursor.u32()?;
        if compression & !(compression::ZIP | compression::ACTIVE_MASK) != 0 {
            return Err("expected zip or no compression, found Blosc or another one".into());
        }
        let metadata = texts(&mut cursor)?;
        let spacing = transform(&mut cursor)?;
        let most_voxels = self.bytes.len() as u64 * MOST_VOXELS_A_BYTE;
        let mut grid = Grid {
            cursor,
            metadata,
            spacing,
            width,
            compression,
            background: [0.0; 3],
            tiles: Vec::new(),
            leaves: Vec::new(),
            most_voxels,
            zlib: Decompress::new(true),
        };
        grid.topology()?;
        Ok(grid)
    }
}

/// A list of metadata, of which the texts are kept.
fn texts(cursor: &mut Cursor<'_>) -> Result<BTreeMap<String, String>, String> {
    let mut out = BTreeMap::new();
    for _ in 0..cursor.u32()? {
        let (name, kind) = (cursor.text()?, cursor.text()?);
        let value = cursor.counted()?;
        if kind == "string" {
            out.insert(name, String::from_utf8_lossy(value).into_owned());
        }
    }
    Ok(out)
}

/// Edges of a voxel; turned and sheared grids are refused.
fn transform(cursor: &mut Cursor<'_>) -> Result<[f64; 3], String> {
    let map = cursor.text()?;
    let numbers = match map.as_str() {
        "UniformScaleTranslateMap" | "ScaleTranslateMap" => 18,
        "UniformScaleMap" | "ScaleMap" => 15,
        "TranslationMap" => 3,
        "AffineMap" => 16,
        other => return Err(format!("expected a grid of boxes along the axes, found a {other}")),
    };
    let numbers: Vec<f64> = (0..numbers).map(|_| cursor.f64()).collect::<Result<_, _>>()?;
    let spacing = match numbers.len() {
        18 => [numbers[3], numbers[4], numbers[5]],
        15 => [numbers[0], numbers[1], numbers[2]],
        3 => [1.0; 3],
        _ => {
            let turned = (0..12).any(|i| i % 5 != 0 && numbers[i] != 0.0);
            if turned {
                return Err("expected a grid along the axes, found a turned one".into());
            }
            [numbers[0], numbers[5], numbers[10]]
        }
    };
    Ok(spacing.map(f64::abs))
}

impl Grid<'_> {
    fn topology(&mut self) -> Result<(), String> {
        let buffers = self.cursor.i32()?;
        if buffers != 1 {
            return Err(format!("expected 1 buffer, found {buffers}"));
        }
        self.background = self.value()?;
        let (tiles, children) = (self.cursor.u32()?, self.cursor.u32()?);
        for _ in 0..tiles {
            let (origin, value) = (self.origin()?, self.value()?);
            if self.cursor.array::<1>()? != [0] {
                self.tile(origin, level::UPPER, value);
            }
        }
        for _ in 0..children {
            let origin = self.origin()?;
            self.node(origin, level::UPPER)?;
        }
        Ok(())
    }

    fn origin(&mut self) -> Result<[i32; 3], String> {
        let origin = [self.cursor.i32()?, self.cursor.i32()?, self.cursor.i32()?];
        // Nothing that is added to it below can leave 32 bits then.
        if origin.iter().any(|n| n.unsigned_abs() > 1 << 30) {
            return Err(format!("expected a node near the origin, found one at {origin:?}"));
        }
        Ok(origin)
    }

    fn value(&mut self) -> Result<[f32; 3], String> {
        let mut value = [0.0; 3];
        for number in &mut value[..self.width] {
            *number = self.cursor.f32()?;
        }
        Ok(value)
    }

    fn tile(&mut self, origin: [i32; 3], log2: u32, value: [f32; 3]) {
        let part = Region { low: origin, high: origin.map(|n| n + (1 << log2)) };
        self.tiles.push(Tile { part, value });
    }

    fn node(&mut self, origin: [i32; 3], log2: u32) -> Result<(), String> {
        let child = below(log2);
        let bits = log2 - child;
        let bytes = 1 << (3 * bits - 3);
        let (children, active) = (self.cursor.take(bytes)?, self.cursor.take(bytes)?);
        let values = self.values(active)?;
        let at = |place: usize| {
            let along = |shift: u32| ((place >> shift) as i32 & ((1 << bits) - 1)) << child;
            [origin[0] + along(2 * bits), origin[1] + along(bits), origin[2] + along(0)]
        };
        for place in (0..bytes * 8).filter(|&place| is_set(active, place)) {
            let mut value = [0.0; 3];
            let numbers = &values[place * self.width..(place + 1) * self.width];
            value[..self.width].copy_from_slice(numbers);
            self.tile(at(place), child, value);
        }
        for place in (0..bytes * 8).filter(|&place| is_set(children, place)) {
            if child == level::LEAF {
                let active = self.cursor.array()?;
                self.leaves.push(Leaf { origin: at(place), active });
            } else {
                self.node(at(place), child)?;
            }
        }
        Ok(())
    }

    /// The values of a node, one for each bit of its mask; those that are not active are of no
    /// interest.
    fn values(&mut self, active: &[u8]) -> Result<Vec<f32>, String> {
        let all = active.len() * 8;
        let stored = self.cursor.array::<1>()?[0];
        let (Some(values), Some(masks)) =
            (inactive::VALUES.get(usize::from(stored)), inactive::MASKS.get(usize::from(stored)))
        else {
            return Err(format!("expected a node's storage 0 to 6, found {stored}"));
        };
        self.cursor.take(values * 4 * self.width + masks * active.len())?;
        let sparse =
            self.compression & compression::ACTIVE_MASK != 0 && stored != inactive::ALL_VALUES;
        let on = active.iter().map(|byte| byte.count_ones() as usize).sum();
        let count = if sparse { on } else { all };
        let numbers = self.numbers(count * self.width)?;
        if !sparse {
            return Ok(numbers);
        }
        let mut spread = vec![0.0; all * self.width];
        let places = (0..all).filter(|&place| is_set(active, place));
        for (place, value) in places.zip(numbers.chunks_exact(self.width)) {
            spread[place * self.width..(place + 1) * self.width].copy_from_slice(value);
        }
        Ok(spread)
    }

    fn numbers(&mut self, count: usize) -> Result<Vec<f32>, String> {
        let bytes = if self.compression & compression::ZIP == 0 {
            self.cursor.take(4 * count)?.to_vec()
        } else {
            let packed = self.cursor.i64()?;
            let length = usize::try_from(packed.unsigned_abs()).unwrap_or(usize::MAX);
            let packed_bytes = self.cursor.take(length)?;
            if packed > 0 {
                inflate(&mut self.zlib, packed_bytes, 4 * count)?
            } else {
                packed_bytes.to_vec()
            }
        };
        if bytes.len() != 4 * count {
            return Err(format!("expected {} bytes of voxels, found {}", 4 * count, bytes.len()));
        }
        Ok(bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    /// The box that holds all active voxels; `None` where there is none.
    pub fn extent(&self) -> Option<Region> {
        let of_leaf = |leaf: &Leaf| {
            let on = (0..512).filter(|&place| is_set(&leaf.active, place));
            let at = on.map(|place| voxel(leaf.origin, place));
            at.map(|low| Region { low, high: low.map(|n| n + 1) }).reduce(union)
        };
        let tiles = self.tiles.iter().map(|tile| tile.part);
        self.leaves.iter().filter_map(of_leaf).chain(tiles).reduce(union)
    }

    /// All numbers of a box, by component (slowest), then z, y, x (fastest); background where
    /// nothing is active.
    pub fn dense(mut self, region: Region) -> Result<Vec<f32>, String> {
        let voxels = region.voxels();
        if voxels > self.most_voxels {
            return Err(format!("{voxels} voxels are more than a file of this size can hold"));
        }
        let size = region.size().map(|n| n as usize);
        let all = voxels as usize;
        let mut out = Vec::with_capacity(all * self.width);
        (0..self.width).for_each(|c| out.extend(std::iter::repeat_n(self.background[c], all)));
        let index = |at: [i32; 3]| {
            let along = |axis: usize| (at[axis] - region.low[axis]) as usize;
            (along(2) * size[1] + along(1)) * size[0] + along(0)
        };
        let mut filled = 0_u64;
        for Tile { part, value } in &self.tiles {
            let Region { low, high } = part.common(&region);
            // Tiles that lie on each other would make a small file take for ever.
            filled = filled.saturating_add(Region { low, high }.voxels());
            if filled > voxels {
                return Err("its tiles overlap".into());
            }
            for z in low[2]..high[2] {
                for y in low[1]..high[1] {
                    for x in low[0]..high[0] {
                        let at = index([x, y, z]);
                        (0..self.width).for_each(|c| out[c * all + at] = value[c]);
                    }
                }
            }
        }
        for Leaf { origin, active } in std::mem::take(&mut self.leaves) {
            // The mask stands before the voxels once more.
            self.cursor.take(active.len())?;
            let values = self.values(&active)?;
            for place in (0..512).filter(|&place| is_set(&active, place)) {
                let at = voxel(origin, place);
                if region.holds(at) {
                    let at = index(at);
                    let value = &values[place * self.width..];
                    (0..self.width).for_each(|c| out[c * all + at] = value[c]);
                }
            }
        }
        Ok(out)
    }
}

fn is_set(mask: &[u8], place: usize) -> bool {
    mask[place / 8] >> (place % 8) & 1 == 1
}

fn union(a: Region, b: Region) -> Region {
    let axis = |of: &dyn Fn(usize) -> i32| [of(0), of(1), of(2)];
    Region { low: axis(&|i| a.low[i].min(b.low[i])), high: axis(&|i| a.high[i].max(b.high[i])) }
}
