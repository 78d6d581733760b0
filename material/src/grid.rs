//! The regular grid that every volume lives on.

use serde::{Deserialize, Serialize};

/// A regular grid of `nx × ny × nz` box-shaped cells in the sample frame.
///
/// The sample frame is right-handed and in millimetres: origin at the corner of
/// the front face, x right and y down as the camera sees it, z into the sample.
/// Arrays on the grid are stored with x fastest, then y, then z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawGrid", into = "RawGrid")]
pub struct Grid {
    cells: [usize; 3],
    spacing_mm: [f64; 3],
}

/// What is wrong with a grid that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// An axis has fewer than two cells.
    #[error("a grid needs at least 2 cells along each axis, found {0} × {1} × {2}")]
    TooFewCells(usize, usize, usize),
    /// The number of cells does not fit the machine.
    #[error("a grid of {0} × {1} × {2} cells has too many cells to address")]
    TooManyCells(usize, usize, usize),
    /// A cell size is zero, negative or not finite.
    #[error("cell sizes must be positive and finite, found {0} × {1} × {2} mm")]
    BadSpacing(f64, f64, f64),
}

impl Grid {
    /// A grid of `cells` = [nx, ny, nz] cells of `spacing_mm` = [hx, hy, hz] millimetres.
    ///
    /// # Errors
    /// Fewer than two cells along an axis, more cells than can be addressed, or a
    /// spacing that is not positive and finite.
    pub fn new(cells: [usize; 3], spacing_mm: [f64; 3]) -> Result<Self, GridError> {
        let [nx, ny, nz] = cells;
        if cells.iter().any(|&n| n < 2) {
            return Err(GridError::TooFewCells(nx, ny, nz));
        }
        let total = nx.checked_mul(ny).and_then(|n| n.checked_mul(nz));
        if total.is_none_or(|n| n > isize::MAX as usize / 1024) {
            return Err(GridError::TooManyCells(nx, ny, nz));
        }
        if spacing_mm.iter().any(|&h| !(h.is_finite() && h > 0.0)) {
            return Err(GridError::BadSpacing(spacing_mm[0], spacing_mm[1], spacing_mm[2]));
        }
        Ok(Self { cells, spacing_mm })
    }

    /// Cells along x, y and z.
    pub fn cells(&self) -> [usize; 3] {
        self.cells
    }

    /// Cell sizes hx, hy and hz in millimetres.
    pub fn spacing_mm(&self) -> [f64; 3] {
        self.spacing_mm
    }

    /// Number of cells in the volume.
    #[allow(clippy::len_without_is_empty, reason = "a grid is never empty")]
    pub fn len(&self) -> usize {
        self.cells.iter().product()
    }

    /// Number of cells on the front (or back) face, nx · ny.
    pub fn face_len(&self) -> usize {
        self.cells[0] * self.cells[1]
    }

    /// Edge lengths of the whole block in millimetres.
    pub fn size_mm(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.cells[a] as f64 * self.spacing_mm[a])
    }

    /// Volume of one cell in mm³.
    pub fn cell_volume_mm3(&self) -> f64 {
        self.spacing_mm.iter().product()
    }

    /// Position of cell (x, y, z) in an array on this grid.
    pub fn index(&self, x: usize, y: usize, z: usize) -> usize {
        (z * self.cells[1] + y) * self.cells[0] + x
    }

    /// Centre of cell (x, y, z) in the sample frame, millimetres.
    pub fn centre_mm(&self, x: usize, y: usize, z: usize) -> [f64; 3] {
        let [hx, hy, hz] = self.spacing_mm;
        [(x as f64 + 0.5) * hx, (y as f64 + 0.5) * hy, (z as f64 + 0.5) * hz]
    }
}

#[derive(Serialize, Deserialize)]
struct RawGrid {
    cells: [usize; 3],
    spacing_mm: [f64; 3],
}

impl TryFrom<RawGrid> for Grid {
    type Error = GridError;
    fn try_from(raw: RawGrid) -> Result<Self, GridError> {
        Grid::new(raw.cells, raw.spacing_mm)
    }
}

impl From<Grid> for RawGrid {
    fn from(grid: Grid) -> Self {
        RawGrid { cells: grid.cells, spacing_mm: grid.spacing_mm }
    }
}
