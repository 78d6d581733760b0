//! What the projector puts on the lit face.

use crate::resample::FaceOverlap;
use material::{Face, Grid};

/// A set of patterns on one face of the block.
///
/// Each pattern is a map of irradiance on the cells of the lit face, nx × ny, x fastest; 1 is the
/// irradiance of projector white on a white plane at the sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Illuminations {
    face: Face,
    maps: Vec<Vec<f64>>,
}

/// What is wrong with a set of patterns.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum IlluminationError {
    /// There is nothing to solve for.
    #[error("there are no illumination patterns")]
    Empty,
    /// A map does not fit the face.
    #[error("pattern {pattern} has {found} values, the lit face has {expected} cells")]
    WrongLength {
        /// Number of the pattern.
        pattern: usize,
        /// Cells of the face.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// A map holds a value that is not finite.
    #[error("pattern {pattern} is not finite in cell (x {x}, y {y})")]
    NotFinite {
        /// Number of the pattern.
        pattern: usize,
        /// Cell along x.
        x: usize,
        /// Cell along y.
        y: usize,
    },
}

impl Illuminations {
    /// Patterns on one face of a grid.
    ///
    /// # Errors
    /// No pattern, a map of another size than the face, or a value that is not finite.
    pub fn new(grid: &Grid, face: Face, maps: Vec<Vec<f64>>) -> Result<Self, IlluminationError> {
        if maps.is_empty() {
            return Err(IlluminationError::Empty);
        }
        for (pattern, map) in maps.iter().enumerate() {
            if map.len() != grid.face_len() {
                let (expected, found) = (grid.face_len(), map.len());
                return Err(IlluminationError::WrongLength { pattern, expected, found });
            }
            if let Some(i) = map.iter().position(|v| !v.is_finite()) {
                let nx = grid.cells()[0];
                return Err(IlluminationError::NotFinite { pattern, x: i % nx, y: i / nx });
            }
        }
        Ok(Self { face, maps })
    }

    /// The same patterns on another grid of the block.
    pub(crate) fn averaged(&self, overlap: &FaceOverlap) -> Self {
        Self { face: self.face, maps: self.maps.iter().map(|map| overlap.average(map)).collect() }
    }

    /// `across` × `across` regions of a face, lit with 1 one after the other, rows of x first.
    ///
    /// # Errors
    /// `across` is 0.
    pub fn regions(grid: &Grid, face: Face, across: usize) -> Result<Self, IlluminationError> {
        let [nx, ny, _] = grid.cells();
        let region = |i: usize| (i / nx) * across / ny * across + (i % nx) * across / nx;
        let map =
            |r: usize| (0..grid.face_len()).map(|i| f64::from(u8::from(region(i) == r))).collect();
        Self::new(grid, face, (0..across * across).map(map).collect())
    }

    /// The lit face.
    pub fn face(&self) -> Face {
        self.face
    }

    /// Irradiance maps, one a pattern.
    pub fn maps(&self) -> &[Vec<f64>] {
        &self.maps
    }

    /// Number of patterns, at least one.
    pub fn count(&self) -> usize {
        self.maps.len()
    }
}
