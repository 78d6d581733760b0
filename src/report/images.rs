//! Captured against relit pictures.

use crate::Failure;
use crate::commands::verify::Verification;
use crate::measurement::{Measured, MeasuredPattern};
use crate::report::chart::round_step;
use crate::report::colour::diverging;
use crate::report::html::escape;
use crate::report::picture;
use crate::report::scanline::{row, scanline};
use material::{Grid, Material};
use rig::Purpose;

/// The radiance that is shown white: all but the brightest 0.5 % of the values lie below it.
fn white(maps: &[Vec<f64>]) -> f64 {
    let mut all: Vec<f64> = maps.iter().flatten().copied().filter(|v| v.is_finite()).collect();
    let at = (all.len() as f64 * 0.995) as usize;
    let Some(last) = all.len().checked_sub(1) else { return 1.0 };
    let (_, value, _) = all.select_nth_unstable_by(at.min(last), f64::total_cmp);
    if *value > 0.0 { *value } else { 1.0 }
}

fn picture_tag(uri: &str, grid: &Grid, alt: &str) -> String {
    let [w, h, _] = grid.size_mm();
    format!("<img src=\"{uri}\" alt=\"{}\" style=\"aspect-ratio:{w}/{h}\">", escape(alt))
}

fn caption(pattern: &MeasuredPattern, white: f64, told: &str) -> String {
    let tag = match pattern.purpose {
        Purpose::HeldOut => " <span class=\"tag\">held out</span>",
        Purpose::Surface => " <span class=\"tag\">for the surface</span>",
        _ => "",
    };
    format!(
        "<figcaption><b>{}</b>{tag} {told}<br>white = {white:.2e} /sr</figcaption>",
        escape(&pattern.name)
    )
}

/// The captured pictures alone, where there is no material yet.
pub(crate) fn captured(measured: &Measured, grid: &Grid) -> Result<String, Failure> {
    let mut out = String::from(
        "<p>Radiance of the front face, linear light in sRGB, each picture exposed so that all but the brightest \
         0.5 % of it is below white.</p><div class=\"patterns\">",
    );
    for pattern in &measured.patterns {
        let white = white(&pattern.radiance);
        let uri = picture::radiance(measured.cells, &pattern.radiance, white)?;
        out += &format!(
            "<figure><div class=\"three\">{}</div>{}</figure>",
            picture_tag(&uri, grid, "captured"),
            caption(pattern, white, "")
        );
    }
    Ok(out + "</div>")
}

/// Every pattern: captured, relit, and their difference.
pub(crate) fn compared(
    measured: &Measured,
    material: &Material,
    checked: Option<&Verification>,
) -> Result<String, Failure> {
    let maps: Vec<Vec<f64>> = measured.patterns.iter().map(|p| p.irradiance.clone()).collect();
    let relit = renderer::relight(material, &maps)?;
    let relit =
        |m: usize| -> Vec<Vec<f64>> { relit.iter().filter_map(|c| c.get(m).cloned()).collect() };
    let differences: Vec<(f64, Vec<Option<f64>>)> = measured
        .patterns
        .iter()
        .enumerate()
        .map(|(m, pattern)| {
            let white = white(&pattern.radiance);
            (white, difference(pattern, &relit(m), white))
        })
        .collect();
    // One scale for all: twice the RMS, so that most of it is inside and outliers stand out.
    let (sum, count) = differences
        .iter()
        .flat_map(|(_, d)| d.iter().flatten())
        .fold((0.0, 0usize), |(sum, n), d| (sum + d * d, n + 1));
    let limit = round_step(2.0 * (sum / count.max(1) as f64).sqrt());

    let stops: Vec<String> = (0..=16)
        .map(|i| {
            let [r, g, b] = diverging(f64::from(i) / 8.0 - 1.0);
            format!("rgb({r},{g},{b})")
        })
        .collect();
    let percent = 100.0 * limit;
    let mut out = format!(
        "<p>The front face under every pattern: as captured, relit from the material, and relit minus captured. \
         Linear light in sRGB; captured and relit share one exposure, at which all but the brightest 0.5 % of the \
         captured picture is below white. The difference is the mean of the channels in percent of that white, on one \
         scale for all; grey cells are left out, being masked or, from the front, lit directly. Below each, radiance along the row between the marks, in percent of that white: the \
         wide pale lines are captured, the thin ones relit.</p>\
         <div class=\"bar\" style=\"background:linear-gradient(90deg,{})\"></div>\
         <div class=\"ticks\"><span style=\"left:0\">−{percent} % relit darker</span><span style=\"left:50%\">0</span>\
         <span style=\"left:100%\">relit brighter +{percent} %</span></div><div class=\"patterns\">",
        stops.join(",")
    );
    for (m, (pattern, (white, values))) in measured.patterns.iter().zip(&differences).enumerate() {
        let grid = material.grid();
        let images = relit(m);
        let captured = picture::radiance(measured.cells, &pattern.radiance, *white)?;
        let again = picture::radiance(measured.cells, &images, *white)?;
        let signed = picture::signed(measured.cells, values, limit)?;
        let error = checked
            .and_then(|v| v.patterns.iter().find(|p| p.name == pattern.name))
            .map_or(String::new(), |p| format!("{:.2} % relative RMS", 100.0 * p.rel_rms));
        let [nx, ny] = measured.cells;
        let row = row(pattern, [nx, ny]);
        let place = 100.0 * (row as f64 + 0.5) / ny as f64;
        out += "<figure><div class=\"three\">";
        for (uri, what) in [(captured, "captured"), (again, "relit"), (signed, "difference")] {
            let alt = format!("{}: {what}", pattern.name);
            out += &format!(
                "<div><div class=\"marked\" style=\"--row:{place:.1}%\">{}</div><span>{what}</span></div>",
                picture_tag(&uri, grid, &alt)
            );
        }
        out += &format!(
            "</div>{}{}</figure>",
            scanline(pattern, &images, nx, row, grid.size_mm()[0], *white),
            caption(pattern, *white, &error)
        );
    }
    Ok(out + "</div>")
}

/// Relit minus captured as a share of white, mean of the channels that were measured.
fn difference(pattern: &MeasuredPattern, relit: &[Vec<f64>], white: f64) -> Vec<Option<f64>> {
    let cells = pattern.irradiance.len();
    (0..cells)
        .map(|i| {
            let (mut sum, mut count) = (0.0, 0usize);
            for ((l, v), r) in pattern.radiance.iter().zip(&pattern.variance).zip(relit) {
                if v[i].is_finite() {
                    sum += (r[i] - l[i]) / white;
                    count += 1;
                }
            }
            (count > 0).then(|| sum / count as f64)
        })
        .collect()
}
