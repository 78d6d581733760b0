//! The coefficients of one colour channel on a grid.

use material::Grid;

/// κ and μ of every cell of a grid, for one colour channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Medium {
    grid: Grid,
    kappa_mm: Vec<f64>,
    mu_per_mm: Vec<f64>,
}

/// What is wrong with coefficients that were given.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MediumError {
    /// An array does not have one value a cell.
    #[error("{array} has {found} values, the grid has {expected} cells")]
    WrongLength {
        /// `kappa` or `mu`.
        array: &'static str,
        /// Cells of the grid.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// κ must be positive and finite, μ finite and not negative.
    #[error("{array} must be {requirement}, found {value} in cell (x {x}, y {y}, z {z})")]
    BadValue {
        /// `kappa` or `mu`.
        array: &'static str,
        /// What values are allowed.
        requirement: &'static str,
        /// The value found.
        value: f64,
        /// Cell along x.
        x: usize,
        /// Cell along y.
        y: usize,
        /// Cell along z.
        z: usize,
    },
}

impl Medium {
    /// A medium from κ in mm and μ in 1/mm, one value a cell, x fastest.
    ///
    /// # Errors
    /// Wrong lengths; a κ that is not positive and finite; a μ that is negative or not finite.
    pub fn new(grid: Grid, kappa_mm: Vec<f64>, mu_per_mm: Vec<f64>) -> Result<Self, MediumError> {
        let check = |array, values: &[f64], requirement, good: fn(f64) -> bool| {
            if values.len() != grid.len() {
                let (expected, found) = (grid.len(), values.len());
                return Err(MediumError::WrongLength { array, expected, found });
            }
            match values.iter().position(|&v| !good(v)) {
                None => Ok(()),
                Some(i) => {
                    let [nx, ny, _] = grid.cells();
                    let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
                    Err(MediumError::BadValue { array, requirement, value: values[i], x, y, z })
                }
            }
        };
        check("kappa", &kappa_mm, "positive and finite", |v| v.is_finite() && v > 0.0)?;
        check("mu", &mu_per_mm, "finite and not negative", |v| v.is_finite() && v >= 0.0)?;
        Ok(Self { grid, kappa_mm, mu_per_mm })
    }

    /// The same two numbers in every cell.
    ///
    /// # Errors
    /// As [`Medium::new`].
    pub fn homogeneous(grid: Grid, kappa_mm: f64, mu_per_mm: f64) -> Result<Self, MediumError> {
        Self::new(grid, vec![kappa_mm; grid.len()], vec![mu_per_mm; grid.len()])
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// κ of every cell, mm.
    pub fn kappa_mm(&self) -> &[f64] {
        &self.kappa_mm
    }

    /// μ of every cell, 1/mm.
    pub fn mu_per_mm(&self) -> &[f64] {
        &self.mu_per_mm
    }
}
