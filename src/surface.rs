//! What the surface of a front-lit block reflects by itself, from the picture with light on all of
//! the face: what is left of it once multiple scattering is taken away (Wang et al. 2008, section
//! 6.1).

use crate::Failure;
use crate::measurement::{Measured, MeasuredPattern};
use crate::output::counted;
use material::{Material, Surface, lit_response};
use rig::Purpose;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// A cell with less light than this share of its picture's brightest says nothing: what multiple
/// scattering sends there from its neighbours is many times as much as its own.
const LEAST_LIGHT: f64 = 0.1;

/// Noise leaves some cells of a surface that reflects next to nothing below zero, and an error of
/// the model a few elsewhere; more than a twentieth of all is told.
const MANY_NEGATIVE: f64 = 0.05;

/// How the surface of one channel was found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SurfaceFound {
    pub channel: String,
    /// Mean reflectance of the cells that were measured.
    pub mean: f64,
    /// Cells of the front face.
    pub cells: usize,
    /// Cells that came out negative, and were set to 0.
    pub negative: usize,
    /// Cells without a usable pixel or without light; they have the mean of the others.
    pub unknown: usize,
}

impl SurfaceFound {
    /// The channel in a line.
    pub fn text(&self) -> String {
        let mut out = format!("{}: mean surface reflectance {:.3}", self.channel, self.mean);
        if self.negative > 0 {
            let (negative, cells) = (self.negative, counted(self.cells, "cell"));
            out += &format!("; {negative} of {cells} came out negative and have 0");
        }
        if self.unknown > 0 {
            let unknown = counted(self.unknown, "cell");
            out += &format!("; {unknown} could not be measured, and have the mean of the others");
        }
        out
    }

    /// What is wrong with it, if something is.
    pub fn warning(&self) -> Option<String> {
        let share = self.negative as f64 / self.cells as f64;
        (share > MANY_NEGATIVE).then(|| {
            format!(
                "warning: {}: the surface reflectance is negative in {:.0} % of the cells, and 0 was taken: multiple \
                 scattering alone is brighter than the picture. Next to light the diffusion model is too bright where \
                 the material absorbs (docs/transport.md); else look at white sheet and exposures",
                self.channel,
                100.0 * share
            )
        })
    }
}

/// The material with its surface, and how that was found; the material as it is, where no picture has
/// light on all of a front-lit face, or no channel's cells could be measured in it.
///
/// ρ = π ((L − L_multiple)/E − known) of each cell, with what is known beside L_multiple
/// ([`material::lit_response`]); of several such pictures the least squares.
///
/// # Errors
/// The material cannot be relit.
pub(crate) fn add_surface(
    material: Material,
    measured: &Measured,
) -> Result<(Material, Vec<SurfaceFound>), Failure> {
    let uniform = measured.select(Purpose::Surface);
    if uniform.is_empty() {
        return Ok((material, Vec::new()));
    }
    let light: Vec<Vec<f64>> = uniform.iter().map(|p| p.irradiance.clone()).collect();
    let multiple = renderer::relight(&material, &light)?;
    let (mut surfaces, mut found) = (Vec::new(), Vec::new());
    for (c, (channel, multiple)) in material.channels().iter().zip(&multiple).enumerate() {
        let known = lit_response(&material, channel);
        let raw = reflectance(c, &uniform, multiple, &known);
        let Some((surface, how)) = settled(&channel.name, &raw) else {
            return Ok((material, Vec::new()));
        };
        surfaces.push(surface);
        found.push(how);
    }
    Ok((material.with_surface(surfaces).map_err(Failure::other)?, found))
}

/// ρ of every cell, negative values and all; None where nothing was measured.
fn reflectance(
    channel: usize,
    uniform: &[&MeasuredPattern],
    multiple: &[Vec<f64>],
    known: &[f64],
) -> Vec<Option<f64>> {
    let least =
        |p: &&MeasuredPattern| LEAST_LIGHT * p.irradiance.iter().copied().fold(0.0, f64::max);
    let least: Vec<f64> = uniform.iter().map(least).collect();
    let cell = |(i, known): (usize, &f64)| {
        let (mut sum, mut light) = (0.0, 0.0);
        for ((pattern, multiple), least) in uniform.iter().zip(multiple).zip(&least) {
            let e = pattern.irradiance[i];
            if e > *least && pattern.lit_variance[channel][i].is_finite() {
                let left = pattern.radiance[channel][i] - multiple[i] - known * e;
                sum += left * e;
                light += e * e;
            }
        }
        (light > 0.0).then(|| PI * sum / light)
    };
    known.iter().enumerate().map(cell).collect()
}

/// The surface of a channel, without negative values and gaps; None where no cell was measured.
fn settled(channel: &str, raw: &[Option<f64>]) -> Option<(Surface, SurfaceFound)> {
    let known: Vec<f64> = raw.iter().flatten().map(|rho| rho.max(0.0)).collect();
    if known.is_empty() {
        return None;
    }
    let mean = known.iter().sum::<f64>() / known.len() as f64;
    let value = |rho: &Option<f64>| rho.map_or(mean, |rho| rho.max(0.0)) as f32;
    let how = SurfaceFound {
        channel: channel.to_owned(),
        mean,
        cells: raw.len(),
        negative: raw.iter().flatten().filter(|rho| **rho < 0.0).count(),
        unknown: raw.len() - known.len(),
    };
    Some((Surface { reflectance: raw.iter().map(value).collect() }, how))
}

#[cfg(test)]
mod tests {
    use super::*;
    use material::{BoundaryConvention, Channel, Face, Grid, Optics, Provenance};

    /// A front-lit block of 6 × 5 × 4 cells under a convention that counts single scattering apart.
    fn block(face: Face) -> Material {
        let grid = Grid::new([6, 5, 4], [0.5; 3]).unwrap();
        let channel = Channel {
            name: "Y".into(),
            kappa_mm: (0..120).map(|i| 0.3 + 0.001 * i as f32).collect(),
            mu_per_mm: vec![0.02; 120],
            gain: 1.25,
        };
        let optics = Optics::with_boundary(1.3, BoundaryConvention::Wang2008);
        Material::new(grid, vec![channel], optics, face, Provenance::default()).unwrap()
    }

    /// The picture of `truth` under `light`, everything in it measured.
    fn picture(truth: &Material, light: Vec<f64>, purpose: Purpose) -> MeasuredPattern {
        let radiance = renderer::relight(truth, std::slice::from_ref(&light)).unwrap();
        let radiance = radiance.into_iter().map(|mut c| c.remove(0)).collect();
        let place = (truth.lit_face(), [6, 5]);
        MeasuredPattern::new(("p".into(), purpose), place, light, radiance, vec![vec![1e-9; 30]])
    }

    fn measured(patterns: Vec<MeasuredPattern>) -> Measured {
        Measured { patterns, cells: [6, 5], channels: vec!["Y".into()] }
    }

    fn rho(i: usize) -> f32 {
        0.02 + 0.003 * i as f32
    }

    /// One picture or two, uneven light: the surface comes back, to the rounding of the solves (their
    /// residual is 1e-6 of a radiance near 0.1, and ρ is π times that) and of single precision.
    #[test]
    fn the_surface_is_what_multiple_scattering_leaves() {
        let surface = Surface { reflectance: (0..30).map(rho).collect() };
        let truth = block(Face::Front).with_surface(vec![surface]).unwrap();
        let light = |base: f64| (0..30).map(|i| base + 0.02 * f64::from(i)).collect::<Vec<f64>>();
        let one = picture(&truth, light(0.7), Purpose::Surface);
        let two = picture(&truth, light(1.1), Purpose::Surface);
        for patterns in [vec![one.clone()], vec![one, two]] {
            let (found, how) = add_surface(block(Face::Front), &measured(patterns)).unwrap();
            for (i, found) in found.surface().unwrap()[0].reflectance.iter().enumerate() {
                assert!((found - rho(i)).abs() < 1e-5, "{i}: {found}, {}", rho(i));
            }
            assert_eq!((how[0].negative, how[0].unknown, how[0].cells), (0, 0, 30));
            assert!(how[0].warning().is_none());
        }
    }

    /// Cells that were not measured, or not lit, have the mean of the others; what would be negative
    /// is 0, is counted, and is warned of where it is much.
    #[test]
    fn what_is_unknown_or_negative_is_counted() {
        let truth = block(Face::Front).with_surface(vec![Surface { reflectance: vec![0.05; 30] }]);
        let mut light = vec![1.0; 30];
        light[4] = 0.05;
        let mut seen = picture(&truth.unwrap(), light, Purpose::Surface);
        seen.lit_variance[0][7] = f64::INFINITY;
        (10..13).for_each(|i| seen.radiance[0][i] = 0.0);
        let (found, how) = add_surface(block(Face::Front), &measured(vec![seen])).unwrap();
        let map = &found.surface().unwrap()[0].reflectance;
        // 25 cells of 0.05 and three of 0.
        let mean = 25.0 * 0.05 / 28.0;
        for i in [4, 7] {
            assert!((f64::from(map[i]) - mean).abs() < 1e-5, "{i}: {}", map[i]);
        }
        assert_eq!(map[10..13], [0.0; 3]);
        assert_eq!((how[0].negative, how[0].unknown), (3, 2));
        assert!(how[0].warning().unwrap().contains("10 % of the cells"));
        assert!(
            how[0].text().ends_with(
                "; 3 of 30 cells came out negative and have 0; 2 cells could not be measured, and have the mean of the others"
            )
        );
    }

    /// Without such a picture, from the back, and where all of it is masked, as in measurements from
    /// before lit pixels were kept, the material stays as it is.
    #[test]
    fn without_a_picture_there_is_no_surface() {
        let front = block(Face::Front);
        let mut masked = picture(&front, vec![1.0; 30], Purpose::Surface);
        masked.lit_variance = vec![vec![f64::INFINITY; 30]];
        let regions = picture(&front, vec![1.0; 30], Purpose::Fit);
        let back = block(Face::Back);
        let behind = picture(&back, vec![1.0; 30], Purpose::HeldOut);
        for (block, pattern) in [(front.clone(), masked), (front, regions), (back, behind)] {
            let (found, how) = add_surface(block.clone(), &measured(vec![pattern])).unwrap();
            assert!(found == block && how.is_empty());
        }
    }
}
