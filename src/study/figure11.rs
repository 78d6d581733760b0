//! W08 figure 11: how good a material gets with the number of pictures.

use super::scene::Scene;
use super::solving::{Device, Outcome, go_on};
use super::truth::{Errors, Truth};
use crate::Failure;
use crate::plot::{Axis, INKS, Legend, Line, Plot, Sheet};
use diffusion::{InverseSettings, Progress};
use material::Face;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;

/// A material from n × n pictures.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Row {
    pub lit: Face,
    /// Regions along each side of the lit face.
    pub n: usize,
    #[serde(flatten)]
    pub outcome: Outcome,
    #[serde(flatten)]
    pub errors: Errors,
    /// E with the true κ and μ on the solved grid.
    pub grid_e: f64,
}

/// Least n: lit from the front, one region that is all of the face leaves no pixel to look at.
pub(crate) fn least(lit: Face) -> usize {
    if lit == Face::Front { 2 } else { 1 }
}

/// As tables name a face.
pub(crate) fn name(face: Face) -> &'static str {
    match face {
        Face::Front => "front",
        Face::Back => "back",
    }
}

/// Acquires the block from n × n pictures. `truth` is of the same scene, with the E of its grid.
///
/// # Errors
/// A solve fails, or Ctrl-C was pressed.
pub(crate) fn measure(
    scene: &Scene,
    n: usize,
    (noise, seed): (f64, u64),
    (truth, grid_e): (&Truth, f64),
    device: &mut Device,
    watch: impl FnMut(&Progress),
) -> Result<Row, Failure> {
    let pictures = scene.photographed(n, noise, seed, &mut device.solver, go_on)?;
    let (found, seconds) = device.invert(scene, &pictures, &InverseSettings::default(), watch)?;
    let errors = truth.errors(&found.kappa_mm, &found.mu_per_mm, device)?;
    let outcome = Outcome::new(&found, seconds);
    Ok(Row { lit: scene.lit, n, outcome, errors, grid_e })
}

/// For other programs.
pub(crate) fn csv(rows: &[&Row]) -> String {
    let mut out =
        format!("lit,n,pictures,e,e_of_the_grid,log_kappa_rms,log_mu_rms,{}\n", Outcome::HEADS);
    for row in rows {
        let Errors { e, log_kappa, log_mu } = row.errors;
        let _ = writeln!(
            out,
            "{},{},{},{e:.4e},{:.4e},{log_kappa:.4},{log_mu:.4},{}",
            name(row.lit),
            row.n,
            row.n * row.n,
            row.grid_e,
            row.outcome.csv()
        );
    }
    out
}

/// For people.
pub(crate) fn describe(rows: &[&Row]) -> String {
    let mut out = String::from(
        "lit     n  pictures        E  of the grid  log κ  log μ      fit  solves  seconds\n",
    );
    for row in rows {
        let (errors, outcome) = (row.errors, row.outcome);
        let _ = writeln!(
            out,
            "{:5} {:3} {:9} {:8.2e} {:12.2e} {:6.3} {:6.3} {:8.2e} {:7} {:8.1}",
            name(row.lit),
            row.n,
            row.n * row.n,
            errors.e,
            row.grid_e,
            errors.log_kappa,
            errors.log_mu,
            outcome.fit,
            outcome.linear_solves,
            outcome.seconds
        );
    }
    out
}

/// E over n, a line for each face, and what the grid leaves.
pub(crate) fn draw(rows: &[&Row], title: &str) -> Option<String> {
    let last = rows.iter().map(|r| r.n).max()?;
    let line = |lit: Face, figure: fn(&Row) -> f64| -> Vec<(f64, f64)> {
        rows.iter().filter(|r| r.lit == lit).map(|r| (r.n as f64, figure(r))).collect()
    };
    let all = [
        ("lit from the back", INKS[0], true, line(Face::Back, |r| r.errors.e)),
        ("true κ, μ: back", "bound one", false, line(Face::Back, |r| r.grid_e)),
        ("lit from the front", INKS[1], true, line(Face::Front, |r| r.errors.e)),
        ("true κ, μ: front", "bound two", false, line(Face::Front, |r| r.grid_e)),
    ];
    let values = rows.iter().flat_map(|r| [r.errors.e, r.grid_e]);
    let plot = Plot {
        size: [760.0, 380.0],
        margins: [76.0, 200.0, 36.0, 52.0],
        title,
        x: Axis::with_ticks(
            "n: pictures of n × n regions",
            [1.0, (last as f64).max(2.0)],
            (1..=last).map(|n| (n as f64, n.to_string())).collect(),
        ),
        y: Axis::steps("BSSRDF error E", values)?,
        lines: all
            .into_iter()
            .filter(|(_, _, _, points)| !points.is_empty())
            .map(|(name, class, dots, points)| Line { name, class, points, dots })
            .collect(),
        legend: Legend::Beside,
    };
    let mut sheet = Sheet::default();
    sheet.plot(&plot);
    Some(sheet.finish())
}
