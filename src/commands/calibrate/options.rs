//! Flags that the geometric calibrations share.

use crate::Failure;
use crate::output::check_output;
use crate::report::calibration_page;
use calibration::{
    Assessment, Board, Choice, Device, Distortion, Geometry, Grade, Sight, Verdict, write_geometry,
};
use material::{Overwrite, atomic_write};
use serde_json::{Value, json};
use std::io::Write;
use std::path::PathBuf;

/// The printed board.
#[derive(clap::Args)]
pub(super) struct BoardArgs {
    /// Inner corners of the board, columns x rows; or charuco:11x8:4x4_50:18 (squares,
    /// dictionary, marker edge in mm)
    #[arg(long)]
    board: String,
    /// Edge of a square, mm
    #[arg(long)]
    square: f64,
}

impl BoardArgs {
    pub fn board(&self) -> Result<Board, Failure> {
        Ok(Board::parse(&self.board, self.square)?)
    }
}

/// What is solved for.
#[derive(clap::Args)]
pub(super) struct ChoiceArgs {
    /// The camera's distortion: none, k1, k1-k2, k1-k2-p1-p2, five, rational; auto takes the
    /// simplest that cross-validation supports
    #[arg(long, default_value = "auto")]
    distortion: String,
    /// Let the camera's rows and columns stand at other than right angles
    #[arg(long)]
    skew: bool,
    /// Let the board be bent
    #[arg(long)]
    warp: bool,
}

impl ChoiceArgs {
    pub fn choice(&self) -> Result<Choice, Failure> {
        let camera = distortion(&self.distortion)?;
        Ok(Choice { camera, projector: None, skew: self.skew, warp: self.warp })
    }
}

/// A distortion by name; None for `auto`.
pub(super) fn distortion(name: &str) -> Result<Option<Distortion>, Failure> {
    match name {
        "auto" => Ok(None),
        name => Ok(Some(Distortion::parse(name).map_err(|e| Failure::input(e).hint("or auto"))?)),
    }
}

/// Where the result goes.
#[derive(clap::Args)]
pub(super) struct ResultArgs {
    /// Write the calibration with its observations, as TOML
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write a page about how good it is: pictures, figures and what to do next, as HTML
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Replace files that are there
    #[arg(long)]
    force: bool,
}

impl ResultArgs {
    fn overwrite(&self) -> Overwrite {
        if self.force { Overwrite::Replace } else { Overwrite::Refuse }
    }

    /// Fails before the work where a result may not be written after it.
    pub fn check(&self) -> Result<(), Failure> {
        let files = [&self.output, &self.page].into_iter().flatten();
        files.into_iter().try_for_each(|path| check_output(path, self.overwrite()))
    }

    /// Writes what was asked for. `source` is what was calibrated from, in a word; `missed` says
    /// for each picture without a board why it has none.
    pub fn write(
        &self,
        source: &str,
        geometry: &Geometry,
        missed: &[String],
    ) -> Result<Assessment, Failure> {
        let assessment = Assessment::of(geometry, missed)?;
        if let Some(path) = &self.output {
            write_geometry(path, geometry, self.overwrite())?;
        }
        if let Some(path) = &self.page {
            let page =
                calibration_page(&format!("Calibration of {source}"), geometry, &assessment)?;
            atomic_write(path, self.overwrite(), |file| file.write_all(page.as_bytes()))?;
        }
        Ok(assessment)
    }
}

/// The verdict, for people: its grade, what keeps it from being good, and what to do.
pub(super) fn verdict_text(verdict: &Verdict) -> String {
    let mut out = format!("verdict: {}", verdict.grade.word());
    for reason in verdict.reasons.iter().filter(|r| r.grade != Grade::Good) {
        out += &format!("\n  {}", reason.text);
    }
    for advice in &verdict.advice {
        out += &format!("\n  next: {advice}");
    }
    out
}

/// `640x480` as [width, height].
pub(super) fn size(text: &str) -> Result<[usize; 2], String> {
    let sides = text.split_once(['x', 'X', '×']).and_then(|(w, h)| {
        let side = |s: &str| s.trim().parse().ok().filter(|n| (1..=100_000).contains(n));
        Some([side(w)?, side(h)?])
    });
    sides.ok_or_else(|| "expected WIDTHxHEIGHT in pixels, for instance 1024x768".into())
}

/// fx ± σ and so on, one line.
pub(super) fn device_text(name: &str, device: &Device) -> String {
    let m = &device.model;
    let of = |k: usize, value: f64| format!("{value:.2} ± {:.2}", device.standard_deviations[k]);
    let skew = if m.skew == 0.0 { String::new() } else { format!(", skew {}", of(4, m.skew)) };
    let [k1, k2, p1, p2, k3, k4, k5, k6] = m.distortion;
    let coefficients = [k1, k2, p1, p2, k3, k4, k5, k6].map(|c| format!("{c:.5}"));
    let used = m.distortion.iter().rposition(|d| *d != 0.0).map_or(0, |last| last + 1);
    format!(
        "{name}: fx {}, fy {}, cx {}, cy {}{skew}\n{:width$}  distortion {} {}",
        of(0, m.fx),
        of(1, m.fy),
        of(2, m.cx),
        of(3, m.cy),
        "",
        device.selection.distortion.name(),
        coefficients[..used].join(" "),
        width = name.len()
    )
}

/// A device for `--json`.
pub(super) fn device_json(device: &Device) -> Value {
    let m = &device.model;
    json!({
        "rms_px": device.rms_px,
        "noise_px": device.noise_px,
        "fx": m.fx,
        "fy": m.fy,
        "cx": m.cx,
        "cy": m.cy,
        "skew": m.skew,
        "distortion": m.distortion,
        "distortion_model": device.selection.distortion.name(),
        "trials": device.selection.trials,
        "standard_deviations": device.standard_deviations,
    })
}

/// The points that were left out, one line each.
pub(super) fn outlier_text(geometry: &Geometry) -> String {
    let line = |o: &calibration::Outlier| {
        let [x, y] = o.residual_px;
        let kind = match o.sight {
            Sight::Printed => "corner",
            Sight::Coded => "coded corner",
            Sight::Projected => "projected point",
        };
        let off = x.hypot(y);
        format!("left out: {} {kind} {}, {off:.2} px off ({x:+.2}, {y:+.2})\n", o.view, o.point)
    };
    geometry.outliers.iter().map(line).collect()
}
