//! The paper's method against the default, on the same pictures.

use super::scene::Scene;
use super::solving::{Device, Outcome, go_on};
use super::truth::{Errors, Truth};
use crate::Failure;
use crate::plot::{Axis, INKS, Legend, Line, Plot, Sheet};
use diffusion::{Forward, InverseSettings, Measurement, Method, Progress};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::time::Instant;

/// ε of W08 section 4, as a fit.
pub(crate) const EPSILON: f64 = 1e-4;
/// Regions along each side of the lit face.
const REGIONS: usize = 4;

/// Relative residual of the forward solve of the truth.
const TOLERANCE: f64 = 1e-6;

/// The methods that are compared.
pub(crate) const METHODS: [(&str, Method); 2] =
    [("paper", Method::Paper), ("default", Method::Lbfgs)];

/// What it took to ε, the homogeneous start included.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct ToEpsilon {
    pub linear_solves: usize,
    pub fine_solves: f64,
    pub seconds: f64,
}

/// One method on the pictures of one seed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Row {
    pub seed: u64,
    pub method: String,
    /// Fit of the true κ and μ on the solved grid: noise, and what the grid gets wrong. Who comes to
    /// a smaller one has fitted these.
    pub true_fit: f64,
    /// None where the method ended before.
    pub to_epsilon: Option<ToEpsilon>,
    /// Where it ended by itself.
    #[serde(flatten)]
    pub outcome: Outcome,
    #[serde(flatten)]
    pub errors: Errors,
}

/// A row, and the best fit so far over the solves it took.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Traced {
    pub row: Row,
    trace: Vec<(f64, f64)>,
}

/// Solves by one method; pictures and noise follow from `seed` alone.
///
/// # Errors
/// A solve fails, or Ctrl-C was pressed.
pub(crate) fn measure(
    scene: &Scene,
    (name, method): (&str, Method),
    (noise, seed): (f64, u64),
    truth: &Truth,
    device: &mut Device,
    mut watch: impl FnMut(&Progress),
) -> Result<Traced, Failure> {
    let pictures = scene.photographed(REGIONS, noise, seed, &mut device.solver, go_on)?;
    let settings = InverseSettings { method, ..InverseSettings::default() };
    let began = Instant::now();
    let (mut to_epsilon, mut trace): (_, Vec<(f64, f64)>) = (None, Vec::new());
    let (found, seconds) = device.invert(scene, &pictures, &settings, |progress| {
        let work = progress.work;
        // On coarser grids the pictures are averaged, and have less noise to fit.
        if progress.cells != scene.grid.cells() {
            return watch(progress);
        }
        if progress.fit <= EPSILON && to_epsilon.is_none() {
            to_epsilon = Some(ToEpsilon {
                linear_solves: work.linear_solves,
                fine_solves: work.fine_solves,
                seconds: began.elapsed().as_secs_f64(),
            });
        }
        if trace.last().is_none_or(|(_, best)| progress.fit < *best) {
            trace.push((work.fine_solves, progress.fit));
        }
        watch(progress);
    })?;
    let true_fit = true_fit(scene, &pictures, device)?;
    let errors = truth.errors(&found.kappa_mm, &found.mu_per_mm, device)?;
    let outcome = Outcome::new(&found, seconds);
    trace.push((outcome.fine_solves, trace.last().map_or(outcome.fit, |last| last.1)));
    let row = Row { seed, method: name.to_owned(), true_fit, to_epsilon, outcome, errors };
    Ok(Traced { row, trace })
}

fn true_fit(scene: &Scene, pictures: &Measurement, device: &mut Device) -> Result<f64, Failure> {
    let mut forward = Forward::new(scene.truth()?, &scene.optics(), &mut device.solver)?;
    let images = forward.images(pictures.light(), TOLERANCE)?;
    let pairs = images.iter().flatten().zip(pictures.radiance().iter().flatten());
    Ok(pairs.map(|(l, seen)| (l - seen).powi(2)).sum::<f64>() / pictures.energy())
}

/// How many times the default's solves the paper's method takes to ε, on fine-grid equivalents, for
/// each seed for which both get there.
pub(crate) fn ratios(rows: &[&Row]) -> Vec<(u64, f64)> {
    let to_epsilon = |method: &str, seed: u64| {
        let own = rows.iter().find(|r| r.method == method && r.seed == seed);
        own.and_then(|r| r.to_epsilon).map(|t| t.fine_solves)
    };
    let seeds = rows.iter().filter(|r| r.method == METHODS[0].0).map(|r| r.seed);
    seeds
        .filter_map(|seed| {
            Some((seed, to_epsilon(METHODS[0].0, seed)? / to_epsilon(METHODS[1].0, seed)?))
        })
        .collect()
}

/// For other programs.
pub(crate) fn csv(rows: &[&Row]) -> String {
    let mut out = format!(
        "seed,method,fit_of_the_truth,linear_solves_to_epsilon,fine_solves_to_epsilon,seconds_to_epsilon,e,log_kappa_rms,log_mu_rms,{}\n",
        Outcome::HEADS
    );
    for row in rows {
        let to_epsilon = row.to_epsilon.map_or(",,".to_owned(), |t| {
            format!("{},{:.1},{:.2}", t.linear_solves, t.fine_solves, t.seconds)
        });
        let Errors { e, log_kappa, log_mu } = row.errors;
        let _ = writeln!(
            out,
            "{},{},{:.4e},{to_epsilon},{e:.4e},{log_kappa:.4},{log_mu:.4},{}",
            row.seed,
            row.method,
            row.true_fit,
            row.outcome.csv()
        );
    }
    out
}

/// For people.
pub(crate) fn describe(rows: &[&Row]) -> String {
    let mut out = String::from(
        "seed  method   fit of the truth  fine solves to ε  seconds  at its end: fine solves      fit        E  log κ  log μ\n",
    );
    for row in rows {
        let to_epsilon = row.to_epsilon.map_or(format!("{:>16}  {:>7}", "not reached", ""), |t| {
            format!("{:16.0}  {:7.1}", t.fine_solves, t.seconds)
        });
        let (errors, outcome) = (row.errors, row.outcome);
        let _ = writeln!(
            out,
            "{:4}  {:7}  {:16.2e}  {to_epsilon}  {:23.0} {:8.2e} {:8.2e} {:6.3} {:6.3}",
            row.seed,
            row.method,
            row.true_fit,
            outcome.fine_solves,
            outcome.fit,
            errors.e,
            errors.log_kappa,
            errors.log_mu
        );
    }
    for (seed, ratio) in ratios(rows) {
        let _ =
            writeln!(out, "seed {seed}: the paper's method takes {ratio:.1} times the solves to ε");
    }
    out
}

/// The best fit so far over solves, of the first seed.
pub(crate) fn draw(rows: &[&Traced], title: &str) -> Option<String> {
    let seed = rows.first()?.row.seed;
    let own: Vec<_> = rows.iter().filter(|r| r.row.seed == seed).collect();
    let all: Vec<(f64, f64)> = own.iter().flat_map(|r| r.trace.iter().copied()).collect();
    let x =
        Axis::decades("solves on the finest grid, forward and adjoint", all.iter().map(|p| p.0))?;
    let fits = all.iter().map(|p| p.1).chain([EPSILON]);
    let ends = [x.ticks.first()?.0, x.ticks.last()?.0];
    let mut lines: Vec<Line<'_>> = own
        .iter()
        .zip(INKS)
        .map(|(r, class)| Line { name: &r.row.method, class, points: r.trace.clone(), dots: false })
        .collect();
    let epsilon = ends.map(|x| (x, EPSILON)).to_vec();
    lines.push(Line { name: "ε", class: "bound", points: epsilon, dots: false });
    let plot = Plot {
        size: [760.0, 380.0],
        margins: [76.0, 160.0, 36.0, 52.0],
        title,
        y: Axis::decades("best fit so far", fits)?,
        x,
        lines,
        legend: Legend::Beside,
    };
    let mut sheet = Sheet::default();
    sheet.plot(&plot);
    Some(sheet.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(seed: u64, method: &str, fine_solves: Option<f64>) -> Row {
        let outcome = Outcome {
            fit: 1e-4,
            chi2: 1.0,
            lambda: 1e-5,
            gradient_evaluations: 1,
            linear_solves: 1,
            fine_solves: 1.0,
            seconds: 1.0,
        };
        let to_epsilon = fine_solves.map(|fine_solves| ToEpsilon {
            linear_solves: 1,
            fine_solves,
            seconds: 1.0,
        });
        let errors = Errors { e: 1e-3, log_kappa: 0.1, log_mu: 0.5 };
        Row { seed, method: method.into(), true_fit: 1e-4, to_epsilon, outcome, errors }
    }

    #[test]
    fn a_ratio_needs_both_methods_of_a_seed() {
        let rows = [
            row(1, "paper", Some(4000.0)),
            row(1, "default", Some(500.0)),
            row(2, "paper", Some(4000.0)),
            row(2, "default", None),
            row(3, "paper", Some(4000.0)),
        ];
        assert_eq!(ratios(&rows.iter().collect::<Vec<_>>()), [(1, 8.0)]);
    }
}
