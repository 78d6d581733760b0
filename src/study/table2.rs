//! W08 Table II: time and solves on the grids of their four samples.

use super::figure11::name;
use super::scene::Scene;
use super::solving::{Device, Outcome, go_on};
use crate::Failure;
use crate::plot::{Axis, INKS, Legend, Line, Plot, Sheet};
use diffusion::{InverseSettings, Progress};
use material::Face;
use serde::{Deserialize, Serialize};
use simulator::{SampleKind, SampleSpec};
use std::fmt::Write as _;

/// One sample of the table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    pub name: &'static str,
    pub kind: SampleKind,
    pub cells: [usize; 3],
    pub lit: Face,
    /// What W08 needed on a GeForce 8800 GTX, hours.
    pub wang2008_hours: f64,
}

pub(crate) const SAMPLES: [Sample; 4] = [
    Sample {
        name: "wax-1",
        kind: SampleKind::Wax,
        cells: [130, 53, 37],
        lit: Face::Back,
        wang2008_hours: 2.0,
    },
    Sample {
        name: "wax-2",
        kind: SampleKind::Wax,
        cells: [140, 75, 48],
        lit: Face::Front,
        wang2008_hours: 4.0,
    },
    Sample {
        name: "marble",
        kind: SampleKind::Marble,
        cells: [256, 256, 20],
        lit: Face::Back,
        wang2008_hours: 11.0,
    },
    Sample {
        name: "stone",
        kind: SampleKind::Stone,
        cells: [128, 128, 41],
        lit: Face::Back,
        wang2008_hours: 3.0,
    },
];

/// Regions along each side of the lit face: 16 pictures.
const REGIONS: usize = 4;

/// One channel of one sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Channel {
    pub sample: String,
    pub channel: usize,
    pub cells: [usize; 3],
    #[serde(flatten)]
    pub outcome: Outcome,
}

/// One sample, all its channels.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    pub sample: &'static str,
    pub lit: Face,
    pub cells: [usize; 3],
    pub channels: usize,
    pub seconds: f64,
    pub gradient_evaluations: usize,
    pub linear_solves: usize,
    pub fine_solves: f64,
    /// The worst of the channels.
    pub fit: f64,
    pub chi2: f64,
    pub wang2008_hours: f64,
}

impl Sample {
    /// The block, `scale` times as small along every axis, in cells of the same size.
    ///
    /// # Errors
    /// So small that it is no grid.
    pub fn scene(&self, scale: f64, seed: u64, channel: usize) -> Result<Scene, Failure> {
        let cells = self.cells.map(|n| (n as f64 / scale).round() as usize);
        Scene::new(SampleSpec { kind: self.kind, seed }, channel, cells, self.lit)
    }

    /// Photographs and solves one channel.
    ///
    /// # Errors
    /// A solve fails, or Ctrl-C was pressed.
    pub fn measure(
        &self,
        scene: &Scene,
        (noise, seed): (f64, u64),
        device: &mut Device,
        watch: impl FnMut(&Progress),
    ) -> Result<Channel, Failure> {
        // Another noise for each channel.
        let seed = seed.wrapping_mul(3).wrapping_add(scene.channel as u64);
        let pictures = scene.photographed(REGIONS, noise, seed, &mut device.solver, go_on)?;
        let (found, seconds) =
            device.invert(scene, &pictures, &InverseSettings::default(), watch)?;
        Ok(Channel {
            sample: self.name.to_owned(),
            channel: scene.channel,
            cells: scene.grid.cells(),
            outcome: Outcome::new(&found, seconds),
        })
    }
}

/// The channels of each sample together.
pub(crate) fn rows(channels: &[&Channel]) -> Vec<Row> {
    let row = |sample: &Sample| {
        let own: Vec<&&Channel> = channels.iter().filter(|c| c.sample == sample.name).collect();
        let outcomes = || own.iter().map(|c| c.outcome);
        let worst =
            |figure: fn(&Outcome) -> f64| outcomes().map(|o| figure(&o)).fold(0.0, f64::max);
        Some(Row {
            sample: sample.name,
            lit: sample.lit,
            cells: own.first()?.cells,
            channels: own.len(),
            seconds: outcomes().map(|o| o.seconds).sum(),
            gradient_evaluations: outcomes().map(|o| o.gradient_evaluations).sum(),
            linear_solves: outcomes().map(|o| o.linear_solves).sum(),
            fine_solves: outcomes().map(|o| o.fine_solves).sum(),
            fit: worst(|o| o.fit),
            chi2: worst(|o| o.chi2),
            wang2008_hours: sample.wang2008_hours,
        })
    };
    SAMPLES.iter().filter_map(row).collect()
}

fn cells([nx, ny, nz]: [usize; 3]) -> String {
    format!("{nx}x{ny}x{nz}")
}

/// For other programs.
pub(crate) fn csv(rows: &[Row]) -> String {
    let mut out = String::from(
        "sample,cells,lit,channels,seconds,gradient_evaluations,linear_solves,fine_solves,fit,chi2,wang2008_hours_at_full_size\n",
    );
    for row in rows {
        let _ = writeln!(
            out,
            "{},{},{},{},{:.2},{},{},{:.1},{:.4e},{:.4},{}",
            row.sample,
            cells(row.cells),
            name(row.lit),
            row.channels,
            row.seconds,
            row.gradient_evaluations,
            row.linear_solves,
            row.fine_solves,
            row.fit,
            row.chi2,
            row.wang2008_hours
        );
    }
    out
}

/// For people.
pub(crate) fn describe(rows: &[Row]) -> String {
    let mut out = String::from(
        "sample  cells        lit    channels   seconds  solves  fine solves      fit  χ²/N\n",
    );
    for row in rows {
        let _ = writeln!(
            out,
            "{:7} {:12} {:5} {:9} {:9.1} {:7} {:12.0} {:8.2e} {:5.2}",
            row.sample,
            cells(row.cells),
            name(row.lit),
            row.channels,
            row.seconds,
            row.linear_solves,
            row.fine_solves,
            row.fit,
            row.chi2
        );
    }
    out
}

/// Seconds over unknowns, beside what was printed in 2008.
pub(crate) fn draw(rows: &[Row], title: &str) -> Option<String> {
    let size = |cells: [usize; 3], channels: usize| {
        (2 * channels * cells.iter().product::<usize>()) as f64
    };
    let mut ours: Vec<(f64, f64)> =
        rows.iter().map(|r| (size(r.cells, r.channels), r.seconds)).collect();
    let mut theirs: Vec<(f64, f64)> =
        SAMPLES.iter().map(|s| (size(s.cells, 3), 3600.0 * s.wang2008_hours)).collect();
    for points in [&mut ours, &mut theirs] {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    let all: Vec<(f64, f64)> = ours.iter().chain(&theirs).copied().collect();
    let plot = Plot {
        size: [760.0, 380.0],
        margins: [76.0, 220.0, 36.0, 52.0],
        title,
        x: Axis::decades("coefficients that are looked for", all.iter().map(|p| p.0))?,
        y: Axis::decades("seconds", all.iter().map(|p| p.1))?,
        lines: vec![
            Line { name: "this run", class: INKS[0], points: ours, dots: true },
            Line { name: "W08, GPU of 2008", class: "bound", points: theirs, dots: false },
        ],
        legend: Legend::Beside,
    };
    let mut sheet = Sheet::default();
    sheet.plot(&plot);
    Some(sheet.finish())
}
