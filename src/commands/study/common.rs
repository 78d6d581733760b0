//! What the studies that acquire a block have in common: options, progress, files.

use crate::Failure;
use crate::commands::init::{SampleName, devices::three};
use crate::output::{Progress, outputs};
use crate::study::kept::Kept;
use crate::study::scene::Scene;
use clap::ValueEnum;
use diffusion::{DeviceChoice, Stage};
use material::{Face, Overwrite, atomic_write};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::json;
use simulator::SampleSpec;
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

/// Noise of every pixel as a share of its radiance, where nothing else is said.
pub(super) const NOISE: f64 = 0.02;
/// The channel of studies that look at one: green.
pub(super) const CHANNEL: usize = 1;
/// Most cells of a face for which E is reckoned: the true BSSRDF takes the square of that, 4 bytes
/// each, so 1 GB.
const FACE: usize = 16_000;
/// Most cells of a block: their fields under 16 patterns, eight times as many where pictures are
/// made, take 60 GB.
const CELLS: usize = 60_000_000;

/// Weights of a [`Pace`] where one picture, solved, weighs 1: E of one material, and the true BSSRDF, which is on eight times the cells.
pub(super) const E_WEIGHT: f64 = 8.0;
pub(super) const TRUTH_WEIGHT: f64 = 40.0;

/// Where a study writes, and what works.
#[derive(clap::Args)]
pub(super) struct Files {
    /// Folder for the table (.csv) and the drawing (.svg)
    #[arg(long)]
    pub out: PathBuf,
    /// What does the work: auto (a GPU in hardware, else the CPU), cpu, gpu or gpu:NAME
    #[arg(long, default_value = "auto")]
    pub device: DeviceChoice,
    /// Replace results that are there
    #[arg(long)]
    force: bool,
}

/// The block that is acquired.
#[derive(clap::Args)]
pub(super) struct Block {
    /// What the simulated sample is made of
    #[arg(long, value_enum, default_value = "marble")]
    sample: SampleName,
    /// Cells of the grid that is solved; pictures come from one twice as fine. W08's patent has a
    /// volume of 72x72x10
    #[arg(long, value_name = "NXxNYxNZ", default_value = "40x40x10", value_parser = three::<usize>)]
    cells: [usize; 3],
}

impl Block {
    /// The block of that seed.
    ///
    /// # Errors
    /// Cells that are too few or too many.
    pub fn scene(&self, seed: u64, lit: Face) -> Result<Scene, Failure> {
        let [nx, ny, _] = self.cells;
        check_cells(self.cells)?;
        if nx.saturating_mul(ny) > FACE {
            let error = format!("--cells: expected at most {FACE} in a layer, found {nx} x {ny}");
            return Err(
                Failure::input(error).hint("the error E looks at every pair of cells of the faces")
            );
        }
        Scene::new(SampleSpec { kind: self.sample.kind(), seed }, CHANNEL, self.cells, lit)
    }

    /// For a drawing's title.
    pub fn title(&self) -> String {
        let [nx, ny, nz] = self.cells;
        format!("{}, {nx} × {ny} × {nz} cells", name_of(self.sample))
    }

    /// What rows depend on.
    pub fn key(&self) -> impl Serialize + use<> {
        (name_of(self.sample), self.cells)
    }
}

fn name_of(sample: SampleName) -> String {
    sample.to_possible_value().map_or(String::new(), |value| value.get_name().to_owned())
}

fn check_cells(cells: [usize; 3]) -> Result<(), Failure> {
    let all = cells.iter().fold(1usize, |all, n| all.saturating_mul(*n));
    if all > CELLS {
        let [nx, ny, nz] = cells;
        let error = format!("--cells: expected at most {CELLS}, found {nx} x {ny} x {nz}");
        return Err(Failure::input(error));
    }
    Ok(())
}

/// The two files of a study.
pub(super) struct Written {
    csv: PathBuf,
    svg: PathBuf,
    overwrite: Overwrite,
}

impl Files {
    fn overwrite(&self) -> Overwrite {
        if self.force { Overwrite::Replace } else { Overwrite::Refuse }
    }

    /// `NAME.csv` and `NAME.svg`; fails before the work where they could not be written.
    ///
    /// # Errors
    /// They are there and not to be replaced, or the folder takes no files.
    pub fn open(&self, csv: &str, svg: &str) -> Result<Written, Failure> {
        let overwrite = self.overwrite();
        let [csv, svg] = outputs(&self.out, [csv, svg], overwrite)?;
        Ok(Written { csv, svg, overwrite })
    }
}

impl Written {
    /// Rows that an interrupted run left.
    ///
    /// # Errors
    /// Those of [`Kept::open`].
    pub fn kept<T: Serialize + DeserializeOwned>(
        &self,
        settings: &impl Serialize,
    ) -> Result<Kept<T>, Failure> {
        Kept::open(&self.csv, settings, self.overwrite)
    }

    /// Writes table and drawing; a study with too little to draw has a table alone.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn write(&self, table: &str, drawing: Option<&str>) -> Result<(), Failure> {
        if let Some(drawing) = drawing {
            atomic_write(&self.svg, self.overwrite, |file| file.write_all(drawing.as_bytes()))?;
        }
        // The table last: once it is there the study is done.
        atomic_write(&self.csv, self.overwrite, |file| file.write_all(table.as_bytes()))?;
        Ok(())
    }

    /// For `--json`.
    pub fn json(&self, rows: &impl Serialize, settings: serde_json::Value) -> serde_json::Value {
        json!({ "table": self.csv, "drawing": self.svg, "settings": settings, "rows": rows })
    }

    /// For people.
    pub fn text(&self, rows: &str) -> String {
        format!("{rows}{}\n{}", self.csv.display(), self.svg.display())
    }
}

/// Progress over rows that take unlike long: the time that is left follows from their weights.
pub(super) struct Pace {
    progress: Progress,
    began: Instant,
    rows: usize,
    done: f64,
    left: f64,
}

impl Pace {
    /// `rows` have to be made, which together with what they need weigh `all`.
    pub fn new(label: &str, rows: usize, all: f64) -> Self {
        let progress = Progress::new(label, rows);
        Self { progress, began: Instant::now(), rows: 0, done: 0.0, left: all }
    }

    pub fn say(&mut self, message: &str) {
        let spent = self.began.elapsed().as_secs_f64();
        let left = (self.done > 0.0).then(|| spent / self.done * self.left);
        self.progress.set_left(self.rows, message, left);
    }

    /// Where an inverse solve is.
    pub fn step(&mut self, what: &str, p: &diffusion::Progress) {
        let stage = if p.stage == Stage::Homogeneous { ", homogeneous start" } else { "" };
        let solves = p.work.linear_solves;
        self.say(&format!("{what}{stage}: fit {:.2e}, {solves} solves", p.fit));
    }

    /// A row of that weight was made.
    pub fn made(&mut self, weight: f64) {
        self.rows += 1;
        self.spent(weight);
    }

    /// Something of that weight was made that rows need.
    pub fn spent(&mut self, weight: f64) {
        self.done += weight;
        self.left -= weight;
    }

    pub fn finish(self, message: &str) {
        self.progress.finish(message);
    }
}
