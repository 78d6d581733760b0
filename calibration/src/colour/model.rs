//! From a camera's colours to CIE XYZ: a matrix on the channels, or on more terms made of them.

use std::fmt;

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

/// What the matrix acts on, from few terms to many.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColourModel {
    /// R, G, B: three terms. Twice the light gives twice the colour.
    Matrix,
    /// R, G, B and a constant, which takes stray light off; holds for this exposure only.
    Affine,
    /// R, G, B, √RG, √GB, √RB: six terms that scale with the light (Finlayson, Mackiewicz &
    /// Hurlbert 2015, degree 2).
    RootPolynomial2,
    /// Those and the cube roots of RGG, GBB, RBB, GRR, BGG, BRR, RGB: thirteen (degree 3).
    RootPolynomial3,
}

impl ColourModel {
    /// All of them, the simplest first.
    pub const ALL: [Self; 4] =
        [Self::Matrix, Self::Affine, Self::RootPolynomial2, Self::RootPolynomial3];

    /// Number of terms: columns of the matrix.
    pub fn terms(self) -> usize {
        match self {
            Self::Matrix => 3,
            Self::Affine => 4,
            Self::RootPolynomial2 => 6,
            Self::RootPolynomial3 => 13,
        }
    }

    /// The terms of a colour whose white is near 1.
    fn expand(self, rgb: [f64; 3]) -> Vec<f64> {
        let mut terms = rgb.to_vec();
        // Roots are of light; below zero there is only noise.
        let [r, g, b] = rgb.map(|v| v.max(0.0));
        match self {
            Self::Matrix => {}
            Self::Affine => terms.push(1.0),
            Self::RootPolynomial2 | Self::RootPolynomial3 => {
                terms.extend([r * g, g * b, r * b].map(f64::sqrt));
            }
        }
        if self == Self::RootPolynomial3 {
            let products =
                [r * g * g, g * b * b, r * b * b, g * r * r, b * g * g, b * r * r, r * g * b];
            terms.extend(products.map(f64::cbrt));
        }
        terms
    }
}

impl fmt::Display for ColourModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Matrix => "3x3 matrix",
            Self::Affine => "3x4 matrix (with a constant)",
            Self::RootPolynomial2 => "root-polynomial of degree 2",
            Self::RootPolynomial3 => "root-polynomial of degree 3",
        })
    }
}

/// A fitted way from camera colours to XYZ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColourCorrection {
    /// What the matrix acts on.
    pub model: ColourModel,
    /// Camera radiance that counts as 1 before the terms are made.
    pub unit: f64,
    /// X, Y and Z from the terms, in the order of [`ColourModel`].
    pub matrix: [Vec<f64>; 3],
}

impl ColourCorrection {
    /// XYZ of a camera colour in linear radiance.
    pub fn apply(&self, rgb: [f64; 3]) -> [f64; 3] {
        let terms = self.model.expand(rgb.map(|v| v / self.unit));
        std::array::from_fn(|i| self.matrix[i].iter().zip(&terms).map(|(m, t)| m * t).sum())
    }

    /// Least squares over patches, each equation divided by √Y of its reference: halfway between
    /// absolute errors, which let the dark patches drift, and relative ones, which let their
    /// noise rule. None where the patches do not determine the matrix.
    pub(crate) fn fit(
        model: ColourModel,
        unit: f64,
        rgb: &[[f64; 3]],
        xyz: &[[f64; 3]],
    ) -> Option<Self> {
        if rgb.len() < model.terms() {
            return None;
        }
        let weight = |i: usize| 1.0 / xyz[i][1].max(1e-6).sqrt();
        let expanded: Vec<Vec<f64>> =
            rgb.iter().map(|v| model.expand(v.map(|v| v / unit))).collect();
        let a = DMatrix::from_fn(rgb.len(), model.terms(), |i, j| weight(i) * expanded[i][j]);
        let b = DMatrix::from_fn(rgb.len(), 3, |i, j| weight(i) * xyz[i][j]);
        let svd = a.svd(true, true);
        // Fewer independent terms than columns: greys only, or a channel that is dark.
        let (most, least) = (svd.singular_values.max(), svd.singular_values.min());
        if least.is_nan() || least <= 1e-9 * most {
            return None;
        }
        let solution = svd.solve(&b, 0.0).ok()?;
        let matrix = std::array::from_fn(|j| solution.column(j).iter().copied().collect());
        Some(Self { model, unit, matrix })
    }
}
