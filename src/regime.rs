//! How good the diffusion model is for a material, by what `study transport` measured.

use crate::study::transport::GOAL;
use material::{BoundaryConvention, Face, LateralBoundary, Material};

/// Thickness in mean free paths and absorption 1 − albedo at which the study looked.
const THICKNESS: [f64; 4] = [6.0, 12.0, 20.0, 40.0];
const ABSORPTION: [f64; 4] = [0.001, 0.01, 0.02, 0.05];
/// Largest error in scale over the refractive indices: a row an absorption, a column a thickness
/// (docs/transport.md).
const SCALE: [[f64; 4]; 4] = [
    [0.043, 0.016, 0.010, 0.012],
    [0.050, 0.029, 0.026, 0.038],
    [0.060, 0.048, 0.058, 0.091],
    [0.099, 0.135, 0.185, 0.352],
];
/// Largest relative root mean square, the same way.
const RMS: [[f64; 4]; 4] = [
    [0.086, 0.029, 0.010, 0.010],
    [0.092, 0.041, 0.025, 0.036],
    [0.101, 0.059, 0.055, 0.084],
    [0.132, 0.130, 0.157, 0.261],
];
/// Width, in mean free paths, below which free sides add percents to the error in scale.
const WIDTH: f64 = 24.0;
/// Edge of a cell, in mean free paths, up to which cells were tried and did not count.
const CELL: f64 = 2.0;

/// A block in mean free paths 1/(μ + σs'), by the means of one channel.
pub(crate) struct Regime {
    /// 1 − albedo.
    pub absorption: f64,
    pub thickness: f64,
    /// Between free sides; infinite where no light leaves through them.
    width: f64,
    /// Longest edge of a cell.
    cell: f64,
    lit_face: Face,
}

impl Regime {
    pub fn of(material: &Material, channel: &material::Channel) -> Self {
        let grid = material.grid();
        let [width, height, thickness] = grid.size_mm();
        let cell = grid.spacing_mm().into_iter().fold(0.0, f64::max);
        let mean = |values: &[f32], of: fn(f64) -> f64| {
            values.iter().map(|v| of(f64::from(*v))).sum::<f64>() / grid.len() as f64
        };
        let extinction = mean(&channel.kappa_mm, |kappa| 1.0 / (3.0 * kappa));
        let free = material.optics().lateral == LateralBoundary::Open;
        Self {
            absorption: mean(&channel.mu_per_mm, |mu| mu) / extinction,
            thickness: thickness * extinction,
            width: if free { width.min(height) * extinction } else { f64::INFINITY },
            cell: cell * extinction,
            lit_face: material.lit_face(),
        }
    }

    /// Errors in scale and root mean square to be reckoned with.
    pub fn errors(&self) -> (f64, f64) {
        let (row, down) = place(&ABSORPTION, self.absorption);
        let (column, right) = place(&THICKNESS, self.thickness);
        let read = |table: &[[f64; 4]; 4]| {
            let along =
                |row: usize| table[row][column] * (1.0 - right) + table[row][column + 1] * right;
            along(row) * (1.0 - down) + along(row + 1) * down
        };
        (read(&SCALE), read(&RMS))
    }

    /// What may be off about a channel of that name, under whatever convention; None where nothing is.
    pub fn warning(&self, channel: &str) -> Option<String> {
        let (scale, rms) = self.errors();
        let mut out = Vec::new();
        if scale > GOAL.0 || rms > GOAL.1 {
            out.push(format!(
                "about {:.0} % in brightness and {:.0} % root mean square at {:.0} mean free paths and albedo {:.3}",
                100.0 * scale,
                100.0 * rms,
                self.thickness,
                1.0 - self.absorption
            ));
        }
        if self.width < WIDTH {
            out.push(format!(
                "more where free sides are only {:.0} mean free paths apart",
                self.width
            ));
        }
        if self.cell > CELL {
            out.push(format!("more for cells of {:.1} mean free paths", self.cell));
        }
        if self.lit_face == Face::Front {
            out.push("10 to 40 % in brightness next to light on the front face".into());
        }
        (!out.is_empty())
            .then(|| format!("{channel}: the diffusion model may be off by {}", out.join("; ")))
    }
}

/// The interval of `steps` that holds a value and the place in it by logarithms; beyond the ends,
/// the end.
fn place(steps: &[f64; 4], value: f64) -> (usize, f64) {
    let value = value.clamp(steps[0], steps[3]);
    let interval = usize::from(value >= steps[1]) + usize::from(value >= steps[2]);
    let (low, high) = (steps[interval].ln(), steps[interval + 1].ln());
    (interval, (value.ln() - low) / (high - low))
}

/// Whether brightness and shape are as radiative transport has them, a line a channel where they may
/// not be. Nothing for the papers' own boundary conventions, which do not claim to be.
pub(crate) fn warnings(material: &Material) -> Vec<String> {
    if material.optics().boundary != BoundaryConvention::Transport {
        return Vec::new();
    }
    material
        .channels()
        .iter()
        .filter_map(|channel| Regime::of(material, channel).warning(&channel.name))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use material::{Channel, Grid, Optics, Provenance};

    fn slab(thickness: f64, cell: f64, albedo: f64, lit: Face) -> Material {
        let cells = (thickness / cell) as usize;
        let grid = Grid::new([60, 60, cells], [0.5, 0.5, cell]).unwrap();
        let channel = Channel {
            name: "G".into(),
            kappa_mm: vec![1.0 / 3.0; grid.len()],
            mu_per_mm: vec![(1.0 - albedo) as f32; grid.len()],
            gain: 1.0,
        };
        let optics = Optics::from_eta(1.3);
        Material::new(grid, vec![channel], optics, lit, Provenance::default()).unwrap()
    }

    /// A block of that albedo and thickness, back lit, with nothing else to be wary of.
    fn regime(absorption: f64, thickness: f64) -> Regime {
        Regime { absorption, thickness, width: 40.0, cell: 0.5, lit_face: Face::Back }
    }

    /// On the study's own points its own figures, and between them something between.
    #[test]
    fn the_table_is_read_where_it_was_measured() {
        for (row, absorption) in ABSORPTION.into_iter().enumerate() {
            for (column, thickness) in THICKNESS.into_iter().enumerate() {
                let (scale, rms) = regime(absorption, thickness).errors();
                assert!((scale - SCALE[row][column]).abs() < 1e-12, "{row} {column}: {scale}");
                assert!((rms - RMS[row][column]).abs() < 1e-12, "{row} {column}: {rms}");
            }
        }
        let (scale, _) = regime(0.03, 30.0).errors();
        assert!(scale > SCALE[2][2] && scale < SCALE[3][3], "{scale}");
        assert_eq!(regime(1e-9, 1e4).errors(), (SCALE[0][3], RMS[0][3]));
    }

    #[test]
    fn only_what_is_off_is_warned_of() {
        assert_eq!(warnings(&slab(8.0, 0.5, 0.95, Face::Back)).len(), 1);
        let told = warnings(&slab(20.0, 0.5, 0.9995, Face::Back));
        assert!(told.is_empty(), "{told:?}");
        let lit = warnings(&slab(20.0, 0.5, 0.9995, Face::Front));
        assert!(lit.len() == 1 && lit[0].contains("front face"), "{lit:?}");
        let coarse = slab(15.0, 2.5, 0.9995, Face::Back);
        assert!(warnings(&coarse)[0].contains("cells of 2.5"), "{:?}", warnings(&coarse));
    }
}
