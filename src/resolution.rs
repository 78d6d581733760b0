//! How far the images determine a material: found with it, and told by depth.

use crate::Failure;
use crate::cli::STOP;
use crate::compute;
use crate::output::Progress;
use diffusion::{DeviceChoice, InverseError, Solved, widest_patch_mm};
use material::{Material, Resolution};
use serde::Serialize;
use std::sync::atomic::Ordering;

/// Random vectors: these leave 12 to 15 % in a voxel's resolution, and cost 2 to 3 % of a solve.
pub(crate) const PROBES: usize = 8;
pub(crate) const SEED: u64 = 16;

/// The resolution of every voxel of a channel; none where nothing smooths (λ = 0, the paper's method).
pub(crate) fn map(
    channel: &str,
    solved: &Solved<'_>,
    device: &DeviceChoice,
) -> Result<Option<Resolution>, Failure> {
    let (mut solver, _) = compute::solver(device, diffusion::PROBING_TOLERANCE)?;
    let mut progress = Progress::new(&format!("resolution {channel}"), PROBES);
    let found = solved.determination(PROBES, SEED, &mut solver, |done, _| {
        progress.set(done, "probes");
        !STOP.load(Ordering::Relaxed)
    });
    let found = found.map_err(|e| match e {
        InverseError::Interrupted => {
            Failure::other("interrupted").hint("run the same command again")
        }
        other => other.into(),
    })?;
    let Some(found) = found else {
        progress.finish("no smoothness to weigh the images against");
        return Ok(None);
    };
    progress.finish(&format!("{PROBES} probes"));
    let narrow = |v: &[f64]| v.iter().map(|x| *x as f32).collect();
    Ok(Some(Resolution { kappa_mm: narrow(&found.kappa_mm), mu_mm: narrow(&found.mu_mm) }))
}

/// The medians over the layers of a material.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ByDepth {
    /// Of each layer's middle, mm.
    pub depth_mm: Vec<f64>,
    /// Of the block, mm.
    pub thickness_mm: f64,
    /// The largest detail that was looked at, half the block's longest edge, mm.
    pub largest_mm: f64,
    pub channels: Vec<ChannelByDepth>,
}

/// One channel: the finest detail that is determined in each layer, mm; None where none is.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ChannelByDepth {
    pub channel: String,
    pub kappa_mm: Vec<Option<f64>>,
    pub mu_mm: Vec<Option<f64>>,
}

impl ByDepth {
    /// None for a material without a resolution.
    pub fn of(material: &Material) -> Option<Self> {
        let grid = material.grid();
        let layers = |values: &[f32]| -> Vec<Option<f64>> {
            values.chunks(grid.face_len()).map(median).collect()
        };
        let channels = material.channels().iter().zip(material.resolution()?);
        let channels = channels.map(|(channel, resolution)| ChannelByDepth {
            channel: channel.name.clone(),
            kappa_mm: layers(&resolution.kappa_mm),
            mu_mm: layers(&resolution.mu_mm),
        });
        let depth_mm = (0..grid.cells()[2]).map(|z| grid.centre_mm(0, 0, z)[2]).collect();
        let [_, _, thickness_mm] = grid.size_mm();
        let (largest_mm, channels) = (widest_patch_mm(grid), channels.collect());
        Some(Self { depth_mm, thickness_mm, largest_mm, channels })
    }

    /// A table of a few depths, for people.
    pub fn table(&self) -> String {
        let column =
            |symbol: &str, c: &ChannelByDepth| format!("{:>8}", format!("{symbol} {}", c.channel));
        let heads = self.channels.iter().map(|c| column("κ", c));
        let heads: String = heads.chain(self.channels.iter().map(|c| column("μ", c))).collect();
        let mut out = format!(
            "finest detail that the images determine, mm (what is finer comes from smoothness)\n{:>10}{heads}\n",
            "depth"
        );
        let layers = self.depth_mm.len();
        let rows = layers.min(6);
        for row in 0..rows {
            let z = row * (layers - 1) / (rows - 1).max(1);
            let kappa = self.channels.iter().map(|c| c.kappa_mm.get(z));
            let values = kappa.chain(self.channels.iter().map(|c| c.mu_mm.get(z)));
            let value = |v: Option<&Option<f64>>| match v.copied().flatten() {
                Some(mm) => format!("{mm:8.2}"),
                None => format!("{:>8}", format!("> {:.2}", self.largest_mm)),
            };
            out +=
                &format!("{:7.2} mm{}\n", self.depth_mm[z], values.map(value).collect::<String>());
        }
        out
    }
}

/// None where the middle one is infinite, or there is none.
fn median(values: &[f32]) -> Option<f64> {
    let mut values = values.to_vec();
    values.sort_unstable_by(f32::total_cmp);
    values.get(values.len() / 2).filter(|v| v.is_finite()).map(|v| f64::from(*v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use material::{Channel, Face, Grid, Optics, Provenance};

    /// Two of three values decide a layer; of nine layers the table shows six, the first and the last
    /// among them.
    #[test]
    fn layers_are_told_by_their_median() {
        let grid = Grid::new([3, 2, 9], [0.5, 0.5, 0.25]).unwrap();
        let channel = Channel {
            name: "Y".into(),
            kappa_mm: vec![0.3; grid.len()],
            mu_per_mm: vec![0.01; grid.len()],
            gain: 1.0,
        };
        let plain = Material::new(
            grid,
            vec![channel],
            Optics::from_eta(1.3),
            Face::Back,
            Provenance::default(),
        )
        .unwrap();
        assert!(ByDepth::of(&plain).is_none());
        let of = |f: fn(usize) -> f32| (0..grid.len()).map(f).collect::<Vec<f32>>();
        let kappa_mm = of(|i| if i % 6 == 0 { 99.0 } else { 1.0 + (i / 6) as f32 });
        let mu_mm = of(|i| if i % 6 < 2 && i >= 48 { 2.0 } else { f32::INFINITY });
        let material = plain.with_resolution(vec![Resolution { kappa_mm, mu_mm }]).unwrap();
        let told = ByDepth::of(&material).unwrap();
        assert_eq!(told.channels[0].kappa_mm[3], Some(4.0));
        assert_eq!(told.channels[0].mu_mm, vec![None; 9]);
        assert_eq!(told.depth_mm[8], 2.125);
        let table = told.table();
        let rows: Vec<&str> = table.lines().skip(2).collect();
        assert_eq!(rows.len(), 6, "{table}");
        assert!(rows[0].ends_with("1.00  > 1.12") && rows[5].ends_with("9.00  > 1.12"), "{table}");
    }
}
