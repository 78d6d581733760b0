//! Many fields on one grid, stored so that one pass over the coefficients serves them all.

/// `count` scalar fields on a grid of `cells` cells, one for each illumination.
///
/// Fields are packed in blocks of [`Batch::lanes`] (4 or 16); inside a block the
/// lanes of a cell stand side by side, so that a stencil reads its coefficients once for
/// the whole block and one cache line holds one cell of 16 single-precision fields.
/// Lanes beyond `count` are zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    cells: usize,
    count: usize,
    lanes: usize,
    data: Vec<f64>,
}

impl Batch {
    /// `count` fields of zeros.
    pub fn zeros(cells: usize, count: usize) -> Self {
        let lanes = if count <= 4 { 4 } else { 16 };
        let blocks = count.div_ceil(lanes);
        Self { cells, count, lanes, data: vec![0.0; blocks * cells * lanes] }
    }

    /// Sets everything to 0.
    pub fn clear(&mut self) {
        self.data.fill(0.0);
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

    /// One block: `cells × lanes` values, lane fastest.
    pub fn block(&self, block: usize) -> &[f64] {
        &self.data[block * self.cells * self.lanes..(block + 1) * self.cells * self.lanes]
    }

    /// One block, to be written to.
    pub fn block_mut(&mut self, block: usize) -> &mut [f64] {
        &mut self.data[block * self.cells * self.lanes..(block + 1) * self.cells * self.lanes]
    }

    fn position(&self, field: usize, cell: usize) -> usize {
        debug_assert!(field < self.count && cell < self.cells);
        ((field / self.lanes) * self.cells + cell) * self.lanes + field % self.lanes
    }

    /// Value of one field in one cell.
    pub fn get(&self, field: usize, cell: usize) -> f64 {
        self.data[self.position(field, cell)]
    }

    /// Sets the value of one field in one cell.
    pub fn set(&mut self, field: usize, cell: usize, value: f64) {
        let at = self.position(field, cell);
        self.data[at] = value;
    }

    /// A copy of one field in plain cell order.
    pub fn field(&self, field: usize) -> Vec<f64> {
        (0..self.cells).map(|cell| self.get(field, cell)).collect()
    }

    /// Σ over all fields of a·b, cell by cell.
    ///
    /// # Panics
    /// If the two batches differ in shape.
    pub fn lane_products(&self, other: &Batch, mut visit: impl FnMut(usize, f64)) {
        assert_eq!((self.cells, self.count), (other.cells, other.count));
        for block in 0..self.blocks() {
            let a = self.block(block).chunks_exact(self.lanes);
            let b = other.block(block).chunks_exact(self.lanes);
            for (cell, (a, b)) in a.zip(b).enumerate() {
                visit(cell, a.iter().zip(b).map(|(a, b)| a * b).sum());
            }
        }
    }
}
