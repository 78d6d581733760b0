//! How good the diffusion model is for a material, by what `study transport` measured.

use crate::study::transport::GOAL;
use material::{BoundaryConvention, Face, LateralBoundary, Material};

/// Thickness in mean free paths and absorption 1 − albedo at which the study looked.
const THICKNESS: [f64; 4] = [6.0, 12.0, 20.0, 40.0];
const ABSORPTION: [f64; 4] = [0.001, 0.01, 0.02, 0.05];
/// Largest error in scale, without a surface and over the refractive indices 1.25 and 1.5: a row an absorption, a
/// column a thickness (docs/transport.md).
const SCALE: [[[f64; 4]; 4]; 2] = [
    [
        [0.046, 0.010, 0.003, 0.000],
        [0.054, 0.022, 0.009, 0.007],
        [0.065, 0.035, 0.017, 0.011],
        [0.091, 0.077, 0.041, 0.015],
    ],
    [
        [0.006, 0.001, 0.003, 0.001],
        [0.010, 0.007, 0.014, 0.011],
        [0.016, 0.008, 0.012, 0.017],
        [0.028, 0.021, 0.012, 0.032],
    ],
];
/// Largest relative root mean square, the same way.
const RMS: [[[f64; 4]; 4]; 2] = [
    [
        [0.092, 0.029, 0.006, 0.000],
        [0.100, 0.041, 0.013, 0.005],
        [0.109, 0.054, 0.022, 0.011],
        [0.134, 0.095, 0.047, 0.017],
    ],
    [
        [0.044, 0.009, 0.004, 0.000],
        [0.052, 0.016, 0.015, 0.010],
        [0.062, 0.022, 0.013, 0.017],
        [0.085, 0.049, 0.020, 0.033],
    ],
];
/// Width, in mean free paths, below which free sides add percents to the error in scale.
const WIDTH: f64 = 24.0;
/// Refractive index from which a block counts as one with a surface: half way to the least that was tried.
const SURFACE: f64 = 1.125;
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
    /// Whether a refracting surface keeps light inside.
    surface: bool,
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
            surface: material.optics().eta >= SURFACE,
        }
    }

    /// Errors in scale and root mean square to be reckoned with.
    pub fn errors(&self) -> (f64, f64) {
        let (row, down) = place(&ABSORPTION, self.absorption);
        let (column, right) = place(&THICKNESS, self.thickness);
        let read = |tables: &[[[f64; 4]; 4]; 2]| {
            let table = &tables[usize::from(self.surface)];
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
            out.push("14 to 40 % in brightness next to light on the front face".into());
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
        let (width, cell, lit_face) = (40.0, 0.5, Face::Back);
        Regime { absorption, thickness, width, cell, lit_face, surface: true }
    }

    /// On the study's own points its own figures, and between them something between.
    #[test]
    fn the_table_is_read_where_it_was_measured() {
        for (row, absorption) in ABSORPTION.into_iter().enumerate() {
            for (column, thickness) in THICKNESS.into_iter().enumerate() {
                let (scale, rms) = regime(absorption, thickness).errors();
                assert!((scale - SCALE[1][row][column]).abs() < 1e-12, "{row} {column}: {scale}");
                assert!((rms - RMS[1][row][column]).abs() < 1e-12, "{row} {column}: {rms}");
            }
        }
        let (scale, _) = regime(0.03, 30.0).errors();
        assert!(scale > SCALE[1][2][2] && scale < SCALE[1][3][3], "{scale}");
        assert_eq!(regime(1e-9, 1e4).errors(), (SCALE[1][0][3], RMS[1][0][3]));
    }

    /// Without a surface, light near the faces is less diffuse.
    #[test]
    fn a_surface_counts() {
        let with = regime(0.01, 12.0);
        let without = Regime { surface: false, ..regime(0.01, 12.0) };
        assert_eq!(without.errors(), (SCALE[0][1][1], RMS[0][1][1]));
        assert!(with.errors().0 < 0.5 * without.errors().0);
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
