//! From coefficients and light to fluence and images.

use crate::{
    Batch, Illuminations, LinearSolver, Medium, Operator, SolveError, SolveReport, SurfaceModel,
    beam::Beam, conduction::Conduction, operator::unknown_per_fluence,
};
use material::{Face, Optics, Scheme};
use rayon::prelude::*;

/// The forward problem of one medium: set up once, solved for any illumination.
pub struct Forward<'a, S> {
    medium: Medium,
    surface: SurfaceModel,
    scheme: Scheme,
    conduction: Conduction,
    solver: &'a mut S,
}

impl<'a, S: LinearSolver> Forward<'a, S> {
    /// Prepares `solver` for a medium.
    ///
    /// # Errors
    /// The backend cannot hold the operator.
    pub fn new(medium: Medium, optics: &Optics, solver: &'a mut S) -> Result<Self, SolveError> {
        solver.prepare(Operator::new(&medium, optics))?;
        Ok(Self::prepared(medium, optics, SurfaceModel::new(optics), solver))
    }

    /// The forward problem of a medium that `solver` is prepared for already; `surface` is the model of `optics`.
    pub(crate) fn prepared(
        medium: Medium,
        optics: &Optics,
        surface: SurfaceModel,
        solver: &'a mut S,
    ) -> Self {
        let conduction = Conduction::of(optics);
        Self { medium, surface, scheme: optics.scheme, conduction, solver }
    }

    /// The medium.
    pub fn medium(&self) -> &Medium {
        &self.medium
    }

    /// The medium, when nothing more is asked of it.
    pub(crate) fn into_medium(self) -> Medium {
        self.medium
    }

    /// The right-hand side for a set of patterns: light through the boundary, and the
    /// first-scatter source of a collimated beam.
    pub fn right_hand_side(&self, light: &Illuminations) -> Batch {
        let grid = self.medium.grid();
        let plane = grid.face_len();
        let mut b = Batch::zeros(grid.len(), light.count());
        let lanes = b.lanes();
        let SurfaceModel { beam, drive, .. } = self.surface;
        if beam != 0.0 {
            let source = self.beam(light.face()).first_scatter(&self.medium);
            for (block, maps) in light.maps().chunks(lanes).enumerate() {
                let planes = b.block_mut(block).par_chunks_mut(plane * lanes);
                planes.zip(source.par_chunks(plane)).for_each(|(out, source)| {
                    for (c, (out, s)) in out.chunks_exact_mut(lanes).zip(source).enumerate() {
                        for (o, map) in out.iter_mut().zip(maps) {
                            *o = beam * s * map[c];
                        }
                    }
                });
            }
        }
        if drive != 0.0 {
            let (g, first) = (self.entrance(light.face()), self.first_cell(light.face()));
            for (block, maps) in light.maps().chunks(lanes).enumerate() {
                let face = b.block_mut(block)[first * lanes..].chunks_exact_mut(lanes);
                for (c, (out, g)) in face.zip(&g).enumerate() {
                    for (o, map) in out.iter_mut().zip(maps) {
                        *o += g * drive * map[c];
                    }
                }
            }
        }
        b
    }

    /// Fluence of every pattern (with [`Scheme::Stam`] κ times it), starting from `fluence` (zeros, or a
    /// near solution).
    ///
    /// # Errors
    /// As [`LinearSolver::solve`].
    pub fn solve(
        &mut self,
        light: &Illuminations,
        fluence: &mut Batch,
        tolerance: f64,
    ) -> Result<SolveReport, SolveError> {
        let b = self.right_hand_side(light);
        self.solver.solve(&b, fluence, tolerance)
    }

    /// The front face under every pattern, one map each: [`Forward::solve`] from nothing, then
    /// [`Forward::exit_radiance`].
    ///
    /// # Errors
    /// As [`LinearSolver::solve`].
    pub fn images(
        &mut self,
        light: &Illuminations,
        tolerance: f64,
    ) -> Result<Vec<Vec<f64>>, SolveError> {
        let mut fluence = Batch::zeros(self.medium.grid().len(), light.count());
        self.solve(light, &mut fluence, tolerance)?;
        Ok(self.exit_radiance(light, &fluence, Face::Front))
    }

    /// Solves A x = b for any right-hand side (the adjoint problem has the same matrix).
    ///
    /// # Errors
    /// As [`LinearSolver::solve`].
    pub fn solve_raw(
        &mut self,
        b: &Batch,
        x: &mut Batch,
        tolerance: f64,
    ) -> Result<SolveReport, SolveError> {
        self.solver.solve(b, x, tolerance)
    }

    /// Radiance that leaves a face along its normal, one map a pattern (nx × ny, x fastest),
    /// in units of 1/sr times the irradiance unit.
    pub fn exit_radiance(
        &self,
        light: &Illuminations,
        fluence: &Batch,
        face: Face,
    ) -> Vec<Vec<f64>> {
        let (leaves, enters) = (self.face_conductance(face), self.entrance(face));
        let first = self.first_cell(face);
        let area = self.face_area();
        let lit = face == light.face();
        let exit = (0..light.count()).map(|m| {
            let map = &light.maps()[m];
            let pixel = |c: usize| {
                let e = if lit { map[c] } else { 0.0 };
                let outside = self.surface.drive * e;
                let flux = (leaves[c] * fluence.get(m, first + c) - enters[c] * outside) / area;
                self.surface.exit_per_flux * flux + self.surface.exit_per_irradiance * e
            };
            (0..leaves.len()).map(pixel).collect()
        });
        exit.collect()
    }

    /// The numbers of the boundary convention.
    pub fn surface(&self) -> &SurfaceModel {
        &self.surface
    }

    pub(crate) fn solver_operator(&self) -> Option<&Operator> {
        self.solver.operator()
    }

    pub(crate) fn face_conductance(&self, face: Face) -> &[f64] {
        self.solver.operator().map_or(&[], |operator| operator.face_conductance(face))
    }

    /// What every cell of a face gains through it for one unit of light outside: g · A_f, mm².
    fn entrance(&self, face: Face) -> Vec<f64> {
        let cells = self.first_cell(face)..;
        let (kappa, mu) = (&self.medium.kappa_mm()[cells.clone()], &self.medium.mu_per_mm()[cells]);
        let cells = self.face_conductance(face).iter().zip(kappa.iter().zip(mu));
        let enters = |(leaves, (kappa, mu)): (&f64, (&f64, &f64))| {
            leaves * unknown_per_fluence(self.scheme, self.conduction.at(*kappa, *mu).0)
        };
        cells.map(enters).collect()
    }

    /// The collimated beam through a face.
    pub(crate) fn beam(&self, face: Face) -> Beam {
        let boundary_constant = self.surface.boundary_constant;
        Beam { face, boundary_constant, conduction: self.conduction }
    }

    pub(crate) fn conduction(&self) -> Conduction {
        self.conduction
    }

    pub(crate) fn scheme(&self) -> Scheme {
        self.scheme
    }

    pub(crate) fn first_cell(&self, face: Face) -> usize {
        match face {
            Face::Front => 0,
            Face::Back => self.medium.grid().len() - self.medium.grid().face_len(),
        }
    }

    pub(crate) fn face_area(&self) -> f64 {
        let [hx, hy, _] = self.medium.grid().spacing_mm();
        hx * hy
    }
}
