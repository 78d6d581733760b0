//! The grids of a material.

use std::fs::File;
use std::io::{self, BufWriter, Seek};
use std::path::Path;

use super::metadata::{Metadata, Value};
use super::tree::Region;
use super::writer::{Field, Frame, head};
use crate::header::{Header, KEY};
use crate::{FileError, Overwrite, ScatteringMedium, atomic_write};

/// Voxels beyond the block on every side. Renderers interpolate towards what lies outside, which
/// darkens the block's edges (Blender's Principled Volume by a third) unless colours go on there.
/// All grids are as large, which some readers ask for; what scatters is zero there.
const MARGIN: i32 = 2;

/// Name of the metadata that holds the scene's unit of length.
pub(super) const UNIT: &str = "diaphane_scene_unit";

/// Writes a material as grids, in the renderer's frame of [`ScatteringMedium`]:
///
/// | grid | voxel | beyond the block |
/// |---|---|---|
/// | `density` | largest σt of the channels, per scene unit | 0 |
/// | `color` | albedo σs'/σt of each channel | as at the edge |
/// | `sigma_a`, `sigma_s` | σa, σs' of each channel, per scene unit | 0 |
/// | `kappa`, `mu` | κ in mm and μ in 1/mm, as they are, of each channel | as at the edge |
///
/// All but `density` are vectors (R, G, B); of a material of one channel all but `color` are
/// numbers. The block's first voxel has the index (0, 0, 0). Units, the convention and the
/// material's provenance stand in the metadata of the file and of each grid.
///
/// # Errors
/// Another number of channels than 1 or 3, more cells than the format can count, the file is
/// there already and `overwrite` refuses, or the system does.
pub fn write(
    path: &Path,
    medium: &ScatteringMedium<'_>,
    overwrite: Overwrite,
) -> Result<(), FileError> {
    let channels = medium.one_or_three(path, "OpenVDB")?;
    let region = Region::around(medium.material().grid().cells(), MARGIN).ok_or_else(|| {
        let reason = "OpenVDB counts voxels with 32 bits: too many cells".into();
        FileError::CannotHold { path: path.into(), reason }
    })?;
    let frame = Frame { region, spacing: medium.spacing() };
    let header = Header::of(medium.material());
    atomic_write(path, overwrite, |file| {
        let header = serde_json::to_string(&header)?;
        head(file, &uuid(&header), &about(medium, &header), 6)?;
        let grids = Grids { medium, frame, header };
        if channels == 1 { grids.write::<1>(file) } else { grids.write::<3>(file) }
    })
}

/// What the file says of itself.
fn about(medium: &ScatteringMedium<'_>, header: &str) -> Metadata {
    let provenance = medium.material().provenance();
    let text = |text: String| Value::Text(text);
    vec![
        ("creator", text(format!("{} {}", provenance.software, provenance.version))),
        (KEY, text(header.into())),
        (UNIT, text(medium.unit().symbol().into())),
        ("diaphane_clamped", Value::Count(medium.clamped() as i64)),
    ]
}

/// A name for the file that depends on nothing but what it holds, in the form of a random UUID.
fn uuid(header: &str) -> String {
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&blake3::hash(header.as_bytes()).as_bytes()[..16]);
    bytes[6] = bytes[6] & 0x0f | 0x40;
    bytes[8] = bytes[8] & 0x3f | 0x80;
    let hex = bytes.map(|byte| format!("{byte:02x}")).concat();
    [&hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..]].join("-")
}

struct Grids<'a> {
    medium: &'a ScatteringMedium<'a>,
    frame: Frame,
    header: String,
}

impl Grids<'_> {
    /// All six; `N` is the number of channels.
    fn write<const N: usize>(&self, file: &mut BufWriter<File>) -> io::Result<()> {
        let medium = self.medium;
        let unit = medium.unit().symbol();
        let (per_unit, channels) = (format!("1/{unit}"), medium.material().channels());
        let density = |voxel| match self.index(voxel) {
            (index, true) => [medium.density(index) as f32],
            (_, false) => [0.0],
        };
        self.grid::<1>(file, "density", &per_unit, "largest extinction of the channels", density)?;
        let albedo = |voxel| {
            let (index, _) = self.index(voxel);
            std::array::from_fn(|c| {
                // A single channel makes grey.
                let (a, s) = medium.sigma(c.min(N - 1), index);
                (s / (a + s)) as f32
            })
        };
        self.grid::<3>(file, "color", "1", "albedo: scattering over extinction", albedo)?;
        let about = "absorption of each channel";
        self.grid::<N>(file, "sigma_a", &per_unit, about, self.sigma(|(a, _)| a))?;
        let about = "reduced scattering of each channel; isotropic, g = 0";
        self.grid::<N>(file, "sigma_s", &per_unit, about, self.sigma(|(_, s)| s))?;
        let kappa = |index| std::array::from_fn(|c| channels[c].kappa_mm[index]);
        let kappa = |voxel| kappa(self.index(voxel).0);
        self.grid::<N>(file, "kappa", "mm", "diffusion coefficient of each channel", kappa)?;
        let mu = |index| std::array::from_fn(|c| channels[c].mu_per_mm[index]);
        let mu = |voxel| mu(self.index(voxel).0);
        self.grid::<N>(file, "mu", "1/mm", "absorption of each channel, as acquired", mu)
    }

    /// One coefficient of each channel in the block, nothing beyond it.
    fn sigma<const N: usize>(
        &self,
        of: impl Fn((f64, f64)) -> f64,
    ) -> impl Fn([i32; 3]) -> [f32; N] {
        move |voxel| match self.index(voxel) {
            (index, true) => std::array::from_fn(|c| of(self.medium.sigma(c, index)) as f32),
            (_, false) => [0.0; N],
        }
    }

    fn grid<const N: usize>(
        &self,
        file: &mut BufWriter<File>,
        name: &str,
        unit: &str,
        description: &str,
        value: impl Fn([i32; 3]) -> [f32; N] + Sync,
    ) -> io::Result<()> {
        let class = if name == "density" { "fog volume" } else { "unknown" };
        let text = |text: &str| Value::Text(text.into());
        let metadata = vec![
            ("unit", text(unit)),
            ("description", text(description)),
            (KEY, text(&self.header)),
            (UNIT, text(self.medium.unit().symbol())),
        ];
        let at = file.stream_position()?;
        Field { name, class, metadata, value }.write(file, &self.frame, at).map(drop)
    }

    /// Index into the material's arrays of the voxel, or of the nearest one of the block; and
    /// whether it lies in the block.
    fn index(&self, voxel: [i32; 3]) -> (usize, bool) {
        let cells = self.medium.material().grid().cells();
        let inside = |axis: usize| usize::try_from(voxel[axis]).unwrap_or(0).min(cells[axis] - 1);
        let nearest = [inside(0), inside(1), inside(2)];
        let same = (0..3).all(|axis| voxel[axis] == nearest[axis] as i32);
        (self.medium.index(nearest), same)
    }
}
