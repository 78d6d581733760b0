//! Many fields on one grid, stored so that one pass over the coefficients serves them all.

use crate::field::Field;

/// `count` scalar fields on a grid of `cells` cells, one for each illumination.
///
/// Fields are packed in blocks of [`Batch::lanes`] (4 or 16); inside a block the
/// lanes of a cell stand side by side, so that a stencil reads its coefficients once for
/// the whole block and one cache line holds one cell of 16 single-precision fields.
/// Lanes beyond `count` are zero.
#[derive(Clone, Debug)]
pub struct Batch {
    cells: usize,
    count: usize,
    lanes: usize,
    data: Field<f64, 1>,
    /// Nothing has been written: all values are 0, and need not be read to know it.
    blank: bool,
}

impl PartialEq for Batch {
    fn eq(&self, other: &Self) -> bool {
        (self.cells, self.count) == (other.cells, other.count) && *self.data == *other.data
    }
}

impl Batch {
    /// `count` fields of zeros.
    pub fn zeros(cells: usize, count: usize) -> Self {
        let lanes = if count <= 4 { 4 } else { 16 };
        let blocks = count.div_ceil(lanes);
        Self { cells, count, lanes, data: Field::zeros(blocks * cells * lanes), blank: true }
    }

    /// Sets everything to 0.
    pub fn clear(&mut self) {
        if !self.blank {
            self.data.fill([0.0]);
            self.blank = true;
        }
    }

    /// Cells of each field.
    pub fn cells(&self) -> usize {
        self.cells
    }

    /// Number of fields.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Fields stored side by side in one block.
    pub fn lanes(&self) -> usize {
        self.lanes
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.count.div_ceil(self.lanes)
    }

    /// Whether nothing has been written since [`Batch::zeros`] or [`Batch::clear`].
    pub(crate) fn is_blank(&self) -> bool {
        self.blank
    }

    /// One block: `cells × lanes` values, lane fastest.
    pub fn block(&self, block: usize) -> &[f64] {
        &self.data.as_flattened()
            [block * self.cells * self.lanes..(block + 1) * self.cells * self.lanes]
    }

    /// One block, to be written to.
    pub fn block_mut(&mut self, block: usize) -> &mut [f64] {
        self.blank = false;
        &mut self.data.as_flattened_mut()
            [block * self.cells * self.lanes..(block + 1) * self.cells * self.lanes]
    }

    fn position(&self, field: usize, cell: usize) -> usize {
        debug_assert!(field < self.count && cell < self.cells);
        ((field / self.lanes) * self.cells + cell) * self.lanes + field % self.lanes
    }

    /// Value of one field in one cell.
    pub fn get(&self, field: usize, cell: usize) -> f64 {
        self.data[self.position(field, cell)][0]
    }

    /// Sets the value of one field in one cell.
    pub fn set(&mut self, field: usize, cell: usize, value: f64) {
        let at = self.position(field, cell);
        self.blank = false;
        self.data[at][0] = value;
    }

    /// A copy of one field in plain cell order.
    pub fn field(&self, field: usize) -> Vec<f64> {
        (0..self.cells).map(|cell| self.get(field, cell)).collect()
    }
}
