//! The finite-volume operator of ∇·(κ∇φ) − μφ with Robin faces, in double precision. Under `transport` κ stands
//! for D here (`conduction.rs`).

use crate::conduction::Conduction;
use crate::cpu::real::scale_add;
use crate::cpu::sweep::{Row, RowKernel, neighbour_sum, rows};
use crate::{Batch, Medium, Real};
use material::{Face, LateralBoundary, Optics, Scheme};
use rayon::prelude::*;

/// Cells of a set-up that are worth handing to another thread.
pub(crate) const PER_THREAD: usize = 1 << 12;

/// Conservative, cell-centred finite volumes (design: harmonic face conductances).
///
/// Between cells a and b: T = A_f / (h/(2κa) + h/(2κb)). At a boundary face the surface value
/// is eliminated: g = A_f / (2C + h/(2κ)). The matrix is symmetric positive definite, so the
/// adjoint problem has the same matrix. Units: conductances mm², so that A φ is φ · mm².
///
/// With [`Scheme::Stam`] the unknown is ψ = κφ, in which that equation, Δψ − (μ/κ)ψ = 0, is
/// symmetric too: T = A_f/h, absorption μ/κ, and a boundary face leads g/κ to ψ. Conductances are in mm.
#[derive(Clone, Debug)]
pub struct Operator {
    cells: [usize; 3],
    spacing_mm: [f64; 3],
    /// `link[a][i]`: conductance between cell i and the next one along axis a; 0 at the end.
    pub(crate) link: [Vec<f64>; 3],
    /// `edge[a][side]`: boundary conductance on the low and the high face of axis a, in the
    /// cell order of that face.
    pub(crate) edge: [[Vec<f64>; 2]; 3],
    /// μ · cell volume.
    pub(crate) absorption: Vec<f64>,
    /// Diagonal of the matrix.
    pub(crate) diagonal: Vec<f64>,
}

impl Operator {
    /// The operator of a medium under a boundary convention.
    pub fn new(medium: &Medium, optics: &Optics) -> Self {
        let grid = medium.grid();
        let cells = grid.cells();
        let h = grid.spacing_mm();
        let volume = grid.cell_volume_mm3();
        let kappa = &Conduction::of(optics).of_cells(medium)[..];
        let strides = [1, cells[0], cells[0] * cells[1]];
        let link = std::array::from_fn(|a| {
            let area = volume / h[a];
            let mut out = vec![0.0; grid.len()];
            out.par_chunks_mut(strides[2]).enumerate().for_each(|(z, plane)| {
                for (i, t) in plane.iter_mut().enumerate() {
                    let position = [i % cells[0], i / cells[0], z][a];
                    if position + 1 < cells[a] {
                        let here = z * strides[2] + i;
                        let (ka, kb) = (kappa[here], kappa[here + strides[a]]);
                        *t = match optics.scheme {
                            Scheme::FiniteVolume => 2.0 * area * ka * kb / (h[a] * (ka + kb)),
                            Scheme::Stam => area / h[a],
                        };
                    }
                }
            });
            out
        });
        let edge = std::array::from_fn(|a| {
            std::array::from_fn(|side| {
                let closed = a < 2 && optics.lateral == LateralBoundary::NoFlux;
                face_cells(cells, a, side)
                    .map(|cell| {
                        if closed {
                            0.0
                        } else {
                            let g = volume
                                / h[a]
                                / (2.0 * optics.boundary_constant + h[a] / (2.0 * kappa[cell]));
                            g / unknown_per_fluence(optics.scheme, kappa[cell])
                        }
                    })
                    .collect()
            })
        });
        let sink =
            |(mu, kappa): (&f64, &f64)| mu * volume / unknown_per_fluence(optics.scheme, *kappa);
        let absorption: Vec<f64> = medium.mu_per_mm().iter().zip(kappa).map(sink).collect();
        Self::assemble(cells, h, link, edge, absorption)
    }

    pub(crate) fn assemble(
        cells: [usize; 3],
        spacing_mm: [f64; 3],
        link: [Vec<f64>; 3],
        edge: [[Vec<f64>; 2]; 3],
        absorption: Vec<f64>,
    ) -> Self {
        let strides = [1, cells[0], cells[0] * cells[1]];
        // The last link of an axis is 0, so that the cell one stride before the first one of an
        // axis, which is the last of another row, adds nothing.
        let sum = |(i, absorption): (usize, &f64)| {
            let below = |a: usize| i.checked_sub(strides[a]).map_or(0.0, |i| link[a][i]);
            (0..3).fold(*absorption, |sum, a| sum + link[a][i] + below(a))
        };
        let mut diagonal: Vec<f64> =
            absorption.par_iter().enumerate().with_min_len(PER_THREAD).map(sum).collect();
        for a in 0..3 {
            for side in 0..2 {
                for (cell, g) in face_cells(cells, a, side).zip(&edge[a][side]) {
                    diagonal[cell] += g;
                }
            }
        }
        Self { cells, spacing_mm, link, edge, absorption, diagonal }
    }

    /// What of every cell's diagonal leads to no other cell: absorption and boundary.
    pub(crate) fn leak(&self) -> Vec<f64> {
        let mut leak = self.absorption.clone();
        for axis in 0..3 {
            for side in 0..2 {
                for (cell, g) in face_cells(self.cells, axis, side).zip(&self.edge[axis][side]) {
                    leak[cell] += g;
                }
            }
        }
        leak
    }

    /// The operator with conductances and absorption rounded to single precision, which changes
    /// each by 6e-8 of itself at most.
    pub(crate) fn rounded(&self) -> Self {
        let round = |v: &Vec<f64>| v.iter().map(|v| f64::from(*v as f32)).collect::<Vec<f64>>();
        let link = std::array::from_fn(|a| round(&self.link[a]));
        let edge = std::array::from_fn(|a| std::array::from_fn(|side| round(&self.edge[a][side])));
        Self::assemble(self.cells, self.spacing_mm, link, edge, round(&self.absorption))
    }

    /// Cells along x, y and z.
    pub fn cells(&self) -> [usize; 3] {
        self.cells
    }

    /// Edges of a cell along x, y and z, mm.
    pub fn spacing_mm(&self) -> [f64; 3] {
        self.spacing_mm
    }

    /// Number of unknowns.
    #[allow(clippy::len_without_is_empty, reason = "an operator is never empty")]
    pub fn len(&self) -> usize {
        self.diagonal.len()
    }

    /// What a cell of the front or back face loses through it for one unit of the unknown: g · A_f, mm²,
    /// or over κ where the unknown is κφ.
    pub fn face_conductance(&self, face: Face) -> &[f64] {
        &self.edge[2][match face {
            Face::Front => 0,
            Face::Back => 1,
        }]
    }

    /// `b − A x`, field by field.
    pub fn residual(&self, b: &Batch, x: &Batch) -> Batch {
        let mut r = Batch::zeros(b.cells(), b.count());
        for block in 0..b.blocks() {
            let (b, x, r) = (b.block(block), x.block(block), r.block_mut(block));
            if r.len() == 16 * self.len() {
                self.residual_into::<f64, 16>(
                    b.as_chunks().0,
                    x.as_chunks().0,
                    r.as_chunks_mut().0,
                );
            } else {
                self.residual_into::<f64, 4>(b.as_chunks().0, x.as_chunks().0, r.as_chunks_mut().0);
            }
        }
        r
    }

    /// Largest ‖b − A x‖ / ‖b‖ over the fields that are not 0.
    pub(crate) fn relative_residual(&self, b: &Batch, x: &Batch) -> f64 {
        let r = self.residual(b, x);
        let norm2 = |v: &Batch, m: usize| (0..v.cells()).map(|c| v.get(m, c).powi(2)).sum::<f64>();
        (0..b.count())
            .map(|m| (norm2(&r, m), norm2(b, m)))
            .filter(|(_, b)| *b > 0.0)
            .map(|(r, b)| (r / b).sqrt())
            .fold(0.0, |worst: f64, r| if r.is_nan() { r } else { worst.max(r) })
    }

    /// r = b − A x in double, stored in `T`; returns the norms.
    pub(crate) fn residual_into<T: Real, const L: usize>(
        &self,
        b: &[[f64; L]],
        x: &[[f64; L]],
        r: &mut [[T; L]],
    ) -> [f64; L] {
        rows(self.cells, r, &Residual { operator: self, b, x }).map(f64::sqrt)
    }
}

/// out = b − A x, computed in double; the dot is out · out.
struct Residual<'a, const L: usize> {
    operator: &'a Operator,
    b: &'a [[f64; L]],
    x: &'a [[f64; L]],
}

impl<T: Real, const L: usize> RowKernel<T, L> for Residual<'_, L> {
    type Sum = f64;

    #[inline(always)]
    fn row(&self, y: usize, z: usize, out: &mut [[T; L]], dot: &mut [f64; L]) {
        let Self { operator, b, x } = *self;
        let row = Row::new(operator.cells, y, z);
        let (links, diagonal) = (row.links(&operator.link), row.of(&operator.diagonal));
        let (b, v) = (row.of(b), row.around(x));
        for x in 0..diagonal.len() {
            let own = scale_add(-diagonal[x], &v[0][x], &b[x]);
            let r = neighbour_sum(&links, x, own, |r, x| v[r][x]);
            for l in 0..L {
                dot[l] += r[l] * r[l];
                out[x][l] = T::from_f64(r[l]);
            }
        }
    }
}

/// What is solved for, φ or κφ, over φ.
pub(crate) fn unknown_per_fluence(scheme: Scheme, kappa: f64) -> f64 {
    match scheme {
        Scheme::FiniteVolume => 1.0,
        Scheme::Stam => kappa,
    }
}

/// The cells along one side (0 low, 1 high) of an axis, in storage order.
pub(crate) fn face_cells(
    cells: [usize; 3],
    axis: usize,
    side: usize,
) -> impl Iterator<Item = usize> {
    let strides = [1, cells[0], cells[0] * cells[1]];
    let (inner, outer) = match axis {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    };
    let start = if side == 0 { 0 } else { (cells[axis] - 1) * strides[axis] };
    (0..cells[outer]).flat_map(move |o| {
        (0..cells[inner]).map(move |i| start + o * strides[outer] + i * strides[inner])
    })
}
