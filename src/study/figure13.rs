//! W08 figure 13: smoothness that is too strong, right, and too weak.

use super::scene::Scene;
use super::solving::{Device, Outcome};
use super::truth::{Errors, Truth};
use crate::Failure;
use crate::plot::{Axis, INKS, Legend, Line, Plot, Sheet};
use crate::report::picture;
use diffusion::{
    Forward, Illuminations, Inverse, InverseSettings, Lambda, Measurement, Medium, Progress,
};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;

/// λ over the one that the noise chooses.
pub(crate) const FACTORS: [f64; 7] = [1e-3, 1e-2, 0.1, 1.0, 10.0, 1e2, 1e3];
/// Those that are shown in pictures.
const SHOWN: [(f64, &str); 3] = [(1e3, "too large"), (1.0, "as chosen"), (1e-3, "too small")];
/// Regions along each side of the lit face.
pub(crate) const REGIONS: usize = 4;
/// The pattern whose picture is shown: one from the middle.
const PATTERN: usize = 5;
/// Relative residual of the relit picture.
const TOLERANCE: f64 = 1e-6;

/// A material at one λ.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Row {
    /// λ over the one that the noise chooses.
    pub factor: f64,
    #[serde(flatten)]
    pub outcome: Outcome,
    #[serde(flatten)]
    pub errors: Errors,
}

/// A row, and what is shown of it: slices at the front face and halfway down.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Pictured {
    pub row: Row,
    relit: Vec<f64>,
    slices: [Vec<f32>; 4],
}

/// Names of the slices.
const SLICES: [&str; 4] = ["κ, front", "κ, halfway", "μ, front", "μ, halfway"];

/// Front and middle layers of both coefficients.
fn slices(scene: &Scene, kappa: &[f64], mu: &[f64]) -> [Vec<f32>; 4] {
    let (face, nz) = (scene.grid.face_len(), scene.grid.cells()[2]);
    let layer = |values: &[f64], z: usize| -> Vec<f32> {
        values[z * face..(z + 1) * face].iter().map(|v| *v as f32).collect()
    };
    [layer(kappa, 0), layer(kappa, nz / 2), layer(mu, 0), layer(mu, nz / 2)]
}

/// Solves at `factor` times `chosen`; at the λ that the noise chooses where none is given.
///
/// # Errors
/// A solve fails, or Ctrl-C was pressed.
pub(crate) fn measure(
    scene: &Scene,
    pictures: &Measurement,
    (factor, chosen): (f64, Option<f64>),
    truth: &Truth,
    device: &mut Device,
    watch: impl FnMut(&Progress),
) -> Result<Pictured, Failure> {
    let mut settings = InverseSettings::default();
    if let Some(chosen) = chosen {
        settings.lambda = Lambda::Fixed(factor * chosen);
    }
    let (found, seconds) = device.invert(scene, pictures, &settings, watch)?;
    let errors = truth.errors(&found.kappa_mm, &found.mu_per_mm, device)?;
    let relit = relit(scene, &found, pictures, device)?;
    let slices = slices(scene, &found.kappa_mm, &found.mu_per_mm);
    let row = Row { factor, outcome: Outcome::new(&found, seconds), errors };
    Ok(Pictured { row, relit, slices })
}

fn relit(
    scene: &Scene,
    found: &Inverse,
    pictures: &Measurement,
    device: &mut Device,
) -> Result<Vec<f64>, Failure> {
    let map = pictures.light().maps()[PATTERN].clone();
    let light = Illuminations::new(&scene.grid, scene.lit, vec![map])?;
    let medium = Medium::new(scene.grid, found.kappa_mm.clone(), found.mu_per_mm.clone())?;
    let mut forward = Forward::new(medium, &scene.optics(), &mut device.solver)?;
    let images = forward.images(&light, TOLERANCE)?;
    Ok(images.into_iter().flatten().map(|l| found.gain * l).collect())
}

/// For other programs.
pub(crate) fn csv(rows: &[&Row]) -> String {
    let mut out = format!("lambda_over_chosen,e,log_kappa_rms,log_mu_rms,{}\n", Outcome::HEADS);
    for row in rows {
        let Errors { e, log_kappa, log_mu } = row.errors;
        let (factor, rest) = (row.factor, row.outcome.csv());
        let _ = writeln!(out, "{factor:e},{e:.4e},{log_kappa:.4},{log_mu:.4},{rest}");
    }
    out
}

/// For people.
pub(crate) fn describe(rows: &[&Row]) -> String {
    let mut out =
        String::from("λ over chosen        λ      fit  χ²/N        E  log κ  log μ  solves\n");
    for row in rows {
        let (errors, outcome) = (row.errors, row.outcome);
        let _ = writeln!(
            out,
            "{:13.0e} {:8.1e} {:8.2e} {:5.2} {:8.2e} {:6.3} {:6.3} {:7}",
            row.factor,
            outcome.lambda,
            outcome.fit,
            outcome.chi2,
            errors.e,
            errors.log_kappa,
            errors.log_mu,
            outcome.linear_solves
        );
    }
    out
}

/// Edge of a picture in the drawing, and what lies between.
const EDGE: f64 = 108.0;
const GAP: f64 = 10.0;
const LEFT: f64 = 96.0;

/// Pictures of the truth and of three λ, a scanline through each picture, and figures over λ.
///
/// # Errors
/// A picture cannot be encoded.
pub(crate) fn draw(
    scene: &Scene,
    pictures: &Measurement,
    truth: &Truth,
    rows: &[&Pictured],
    title: &str,
) -> Result<String, Failure> {
    let [nx, ny, _] = scene.grid.cells();
    let captured = &pictures.radiance()[PATTERN];
    let white = captured.iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let true_slices = slices(scene, truth.kappa_mm(), truth.mu_per_mm());
    // One scale for each coefficient: what the truth spans, and half as much again.
    let range = |coefficient: usize| {
        let values = true_slices[2 * coefficient..2 * coefficient + 2].iter().flatten();
        let values = || values.clone().map(|v| f64::from(*v));
        [values().fold(f64::INFINITY, f64::min) / 1.5, values().fold(0.0, f64::max) * 1.5]
    };
    let ranges = [range(0), range(1)];
    let high = EDGE * ny as f64 / nx as f64;
    let mut sheet = Sheet::default();
    sheet.words([LEFT, 20.0], "title", title);
    let column = |n: usize| LEFT + (EDGE + GAP) * n as f64;
    for (n, head) in ["picture"].iter().chain(&SLICES).enumerate() {
        sheet.words([column(n), 42.0], "", head);
    }
    let mut line = |n: usize, name: [&str; 2], image: &[f64], slices: &[Vec<f32>; 4]| {
        let top = 50.0 + (high + GAP) * n as f64;
        for (k, name) in name.iter().enumerate() {
            sheet.words([8.0, top + high / 2.0 + 17.0 * k as f64 - 4.0], "", name);
        }
        let uri = picture::radiance([nx, ny], &[image.to_vec()], white)?;
        sheet.picture([column(0), top], [EDGE, high], &uri);
        for (k, slice) in slices.iter().enumerate() {
            let uri = picture::slices([nx, ny, 1], slice, ranges[k / 2])?;
            sheet.picture([column(k + 1), top], [EDGE, high], &uri);
        }
        Ok::<(), Failure>(())
    };
    line(0, ["true", ""], captured, &true_slices)?;
    let shown: Vec<(&str, &&Pictured)> = SHOWN
        .iter()
        .filter_map(|(factor, name)| Some((*name, rows.iter().find(|r| r.row.factor == *factor)?)))
        .collect();
    for (n, (name, pictured)) in shown.iter().enumerate() {
        let lambda = format!("λ {:.1e}", pictured.row.outcome.lambda);
        line(n + 1, [name, &lambda], &pictured.relit, &pictured.slices)?;
    }
    let words = format!(
        "log scales: κ {:.2} to {:.2} mm, μ {:.1e} to {:.1e} /mm; light is large",
        ranges[0][0], ranges[0][1], ranges[1][0], ranges[1][1]
    );
    sheet.words([LEFT, sheet.height() + 18.0], "", &words);
    scanline(scene, captured, &shown).iter().for_each(|plot| sheet.plot(plot));
    over_lambda(rows).iter().for_each(|plot| sheet.plot(plot));
    Ok(sheet.finish())
}

const SIZE: [f64; 2] = [760.0, 330.0];
const MARGINS: [f64; 4] = [76.0, 200.0, 40.0, 52.0];

/// Through the lit region's middle.
fn scanline<'a>(
    scene: &Scene,
    captured: &[f64],
    shown: &[(&'a str, &&Pictured)],
) -> Option<Plot<'a>> {
    let [nx, ny, _] = scene.grid.cells();
    let row = (2 * (PATTERN / REGIONS) + 1) * ny / (2 * REGIONS);
    let along = |image: &[f64]| -> Vec<(f64, f64)> {
        let pixels = image[row * nx..(row + 1) * nx].iter().enumerate();
        pixels.map(|(x, l)| (scene.grid.centre_mm(x, row, 0)[0], *l)).collect()
    };
    let mut lines =
        vec![Line { name: "photographed", class: "plain", points: along(captured), dots: false }];
    lines.extend(shown.iter().zip(INKS).map(|((name, pictured), class)| Line {
        name,
        class,
        points: along(&pictured.relit),
        dots: false,
    }));
    let values = lines.iter().flat_map(|l| l.points.iter().map(|p| p.1)).collect::<Vec<_>>();
    Some(Plot {
        size: SIZE,
        margins: MARGINS,
        title: "Along the row through the middle of the lit region",
        x: Axis::linear("x, mm", [0.0, scene.grid.size_mm()[0]]),
        y: Axis::from_zero("radiance, 1/sr", values.into_iter())?,
        lines,
        legend: Legend::Beside,
    })
}

fn over_lambda(rows: &[&Pictured]) -> Option<Plot<'static>> {
    let line = |name, class, figure: fn(&Row) -> f64| Line {
        name,
        class,
        points: rows.iter().map(|r| (r.row.factor, figure(&r.row))).collect(),
        dots: true,
    };
    let lines = vec![
        line("E", INKS[0], |r| r.errors.e),
        line("fit", INKS[1], |r| r.outcome.fit),
        line("log κ, RMS", INKS[2], |r| r.errors.log_kappa),
        line("log μ, RMS", INKS[3], |r| r.errors.log_mu),
    ];
    let values: Vec<f64> = lines.iter().flat_map(|l| l.points.iter().map(|p| p.1)).collect();
    Some(Plot {
        size: SIZE,
        margins: MARGINS,
        title: "Errors over λ",
        x: Axis::decades(
            "λ over the one that the noise chooses",
            rows.iter().map(|r| r.row.factor),
        )?,
        y: Axis::steps("", values.into_iter())?,
        lines,
        legend: Legend::Beside,
    })
}
