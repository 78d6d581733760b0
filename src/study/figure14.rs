//! W08 figure 14: κ and μ by depth, against the truth.

use super::scene::Scene;
use super::truth::log_error;
use crate::Failure;
use crate::plot::{Axis, INKS, Legend, Line, Plot, Sheet};
use crate::report::picture;
use diffusion::{Inverse, Medium};
use serde::Serialize;
use std::fmt::Write as _;

/// Regions along each side of the lit face.
pub(crate) const REGIONS: usize = 4;
/// Layers that are shown in pictures.
const SHOWN: usize = 5;

/// One layer, parallel to the front face.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    /// Of its middle below the front face, mm.
    pub depth_mm: f64,
    pub kappa: Layer,
    pub mu: Layer,
}

/// One coefficient in one layer; κ in mm, μ in 1/mm.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Layer {
    /// Geometric mean of the truth.
    pub truth: f64,
    /// Geometric mean of what was acquired.
    pub acquired: f64,
    /// Root mean square of log(acquired/true).
    pub log_rms: f64,
    /// Correlation of the logarithms: 1 where the pattern is the true one, whatever its level and
    /// contrast; 0 where nothing varies.
    pub correlation: f64,
}

impl Layer {
    fn of(acquired: &[f64], truth: &[f64]) -> Self {
        let mean = |v: &[f64]| v.iter().map(|v| v.ln()).sum::<f64>() / v.len() as f64;
        let (a, t) = (mean(acquired), mean(truth));
        let (mut cross, mut aa, mut tt) = (0.0, 0.0, 0.0);
        for (acquired, truth) in acquired.iter().zip(truth) {
            let (da, dt) = (acquired.ln() - a, truth.ln() - t);
            (cross, aa, tt) = (cross + da * dt, aa + da * da, tt + dt * dt);
        }
        let size = (aa * tt).sqrt();
        let correlation = if size > 0.0 { cross / size } else { 0.0 };
        let log_rms = log_error(acquired, truth);
        Self { truth: t.exp(), acquired: a.exp(), log_rms, correlation }
    }
}

/// All layers from the front face on.
pub(crate) fn rows(scene: &Scene, found: &Inverse, truth: &Medium) -> Vec<Row> {
    let face = scene.grid.face_len();
    let layers = |values: &[f64], truth: &[f64]| -> Vec<Layer> {
        values.chunks(face).zip(truth.chunks(face)).map(|(a, t)| Layer::of(a, t)).collect()
    };
    let kappa = layers(&found.kappa_mm, truth.kappa_mm());
    let mu = layers(&found.mu_per_mm, truth.mu_per_mm());
    let depth = |z: usize| scene.grid.centre_mm(0, 0, z)[2];
    kappa
        .into_iter()
        .zip(mu)
        .enumerate()
        .map(|(z, (kappa, mu))| Row { depth_mm: depth(z), kappa, mu })
        .collect()
}

/// For other programs.
pub(crate) fn csv(rows: &[Row]) -> String {
    let mut out = String::from(
        "depth_mm,kappa_true_mm,kappa_mm,log_kappa_rms,kappa_correlation,mu_true_per_mm,mu_per_mm,log_mu_rms,mu_correlation\n",
    );
    for row in rows {
        let _ = write!(out, "{:.4}", row.depth_mm);
        for Layer { truth, acquired, log_rms, correlation } in [row.kappa, row.mu] {
            let _ = write!(out, ",{truth:.4e},{acquired:.4e},{log_rms:.4},{correlation:.4}");
        }
        out.push('\n');
    }
    out
}

/// For people.
pub(crate) fn describe(rows: &[Row]) -> String {
    let mut out = String::from(
        "   depth    κ true  acquired  log RMS  correlation     μ true  acquired  log RMS  correlation\n",
    );
    for row in rows {
        let _ = write!(out, "{:5.2} mm", row.depth_mm);
        for Layer { truth, acquired, log_rms, correlation } in [row.kappa, row.mu] {
            let _ = write!(out, "  {truth:8.4}  {acquired:8.4}  {log_rms:7.3}  {correlation:11.2}");
        }
        out.push('\n');
    }
    out
}

const SIZE: [f64; 2] = [760.0, 290.0];
const MARGINS: [f64; 4] = [76.0, 200.0, 40.0, 52.0];
const EDGE: f64 = 108.0;
const GAP: f64 = 10.0;
const LEFT: f64 = 76.0;

/// Slices of both, true and acquired, and figures over depth.
///
/// # Errors
/// A picture cannot be encoded.
pub(crate) fn draw(
    scene: &Scene,
    found: &Inverse,
    truth: &Medium,
    rows: &[Row],
    title: &str,
) -> Result<String, Failure> {
    let [nx, ny, nz] = scene.grid.cells();
    let face = nx * ny;
    let high = EDGE * ny as f64 / nx as f64;
    let shown = SHOWN.min(nz);
    let layer = |n: usize| n * (nz - 1) / (shown - 1).max(1);
    let mut sheet = Sheet::default();
    sheet.words([LEFT, 20.0], "title", title);
    for n in 0..shown {
        let depth = format!("{:.2} mm deep", rows[layer(n)].depth_mm);
        sheet.words([LEFT + (EDGE + GAP) * n as f64, 42.0], "", &depth);
    }
    let volumes = [
        (["κ, true", "κ, acquired"], truth.kappa_mm(), &found.kappa_mm[..]),
        (["μ, true", "μ, acquired"], truth.mu_per_mm(), &found.mu_per_mm[..]),
    ];
    let mut top = 50.0;
    for (names, true_values, acquired) in volumes {
        // What the truth spans, and half as much again.
        let range = [
            true_values.iter().copied().fold(f64::INFINITY, f64::min) / 1.5,
            true_values.iter().copied().fold(0.0, f64::max) * 1.5,
        ];
        for (name, values) in names.iter().zip([true_values, acquired]) {
            let (coefficient, which) = name.split_once(", ").unwrap_or((name, ""));
            sheet.words([8.0, top + high / 2.0], "", coefficient);
            sheet.words([8.0, top + high / 2.0 + 16.0], "", which);
            for n in 0..shown {
                let slice = &values[layer(n) * face..(layer(n) + 1) * face];
                let slice: Vec<f32> = slice.iter().map(|v| *v as f32).collect();
                let uri = picture::slices([nx, ny, 1], &slice, range)?;
                let at = [LEFT + (EDGE + GAP) * n as f64, top];
                sheet.picture(at, [EDGE, high], &uri);
            }
            top += high + GAP;
        }
    }
    plots(scene, rows).iter().for_each(|plot| sheet.plot(plot));
    Ok(sheet.finish())
}

fn plots(scene: &Scene, rows: &[Row]) -> Vec<Plot<'static>> {
    let line = |name, class, figure: fn(&Row) -> f64| Line {
        name,
        class,
        points: rows.iter().map(|r| (r.depth_mm, figure(r))).collect(),
        dots: true,
    };
    let thickness = scene.grid.size_mm()[2];
    let plot = |title, y: Option<Axis>, lines: Vec<Line<'static>>| {
        Some(Plot {
            size: SIZE,
            margins: MARGINS,
            title,
            x: Axis::linear("depth below the front face, mm", [0.0, thickness]),
            y: y?,
            lines,
            legend: Legend::Beside,
        })
    };
    let both =
        |figure: fn(&Row) -> [f64; 2]| -> Vec<f64> { rows.iter().flat_map(figure).collect() };
    let around = |figure, label: &str| Axis::around(label, both(figure).iter().copied());
    let steps = |figure, label: &str| Axis::steps(label, both(figure).iter().copied());
    let kappa = vec![
        line("true", "plain", |r| r.kappa.truth),
        line("acquired", INKS[0], |r| r.kappa.acquired),
    ];
    let mu =
        vec![line("true", "plain", |r| r.mu.truth), line("acquired", INKS[0], |r| r.mu.acquired)];
    let errors = vec![
        line("log κ, RMS", INKS[0], |r| r.kappa.log_rms),
        line("log μ, RMS", INKS[1], |r| r.mu.log_rms),
    ];
    let patterns =
        vec![line("κ", INKS[0], |r| r.kappa.correlation), line("μ", INKS[1], |r| r.mu.correlation)];
    let lowest = rows.iter().flat_map(|r| [r.kappa.correlation, r.mu.correlation]);
    let lowest = (5.0 * lowest.fold(0.0, f64::min)).floor() / 5.0;
    [
        plot(
            "κ: mean of each layer",
            around(|r| [r.kappa.truth, r.kappa.acquired], "κ, mm"),
            kappa,
        ),
        plot("μ: mean of each layer", around(|r| [r.mu.truth, r.mu.acquired], "μ, 1/mm"), mu),
        plot("Error in each layer", steps(|r| [r.kappa.log_rms, r.mu.log_rms], ""), errors),
        plot(
            "Correlation with the true pattern in each layer",
            Some(Axis::linear("", [lowest, 1.0])),
            patterns,
        ),
    ]
    .into_iter()
    .flatten()
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_layer_is_told_by_its_mean_its_error_and_its_pattern() {
        let truth = [1.0, 2.0, 4.0];
        let layer = Layer::of(&[3.0, 6.0, 12.0], &truth);
        assert!((layer.truth - 2.0).abs() < 1e-12 && (layer.acquired - 6.0).abs() < 1e-12);
        assert!((layer.log_rms - 3f64.ln()).abs() < 1e-12);
        assert!((layer.correlation - 1.0).abs() < 1e-12);
        assert!((Layer::of(&[4.0, 2.0, 1.0], &truth).correlation + 1.0).abs() < 1e-12);
        assert_eq!(Layer::of(&[2.0; 3], &truth).correlation, 0.0);
    }
}
