//! The forward problem against mathematics: a manufactured solution, a closed form, energy,
//! reciprocity.

use diffusion::{Batch, CpuSolver, Forward, Illuminations, Medium, Operator};
use material::{BoundaryConvention, Face, Grid, Illumination, LateralBoundary, Optics, Scheme};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

const SEED: u64 = 20080731;

fn wang2008(lateral: LateralBoundary) -> Optics {
    Optics { boundary: BoundaryConvention::Wang2008, lateral, ..Optics::from_eta(1.3) }
}

/// A rough block, contrast 20 in κ.
fn rough(grid: Grid) -> Medium {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut field = |lo: f64, hi: f64| -> Vec<f64> {
        (0..grid.len()).map(|_| lo * (hi / lo).powf(rng.random::<f64>())).collect()
    };
    let (kappa, mu) = (field(0.05, 1.0), field(0.001, 0.05));
    Medium::new(grid, kappa, mu).unwrap()
}

/// κ, μ and φ of the manufactured problem, and what the continuous equation makes of them.
mod manufactured {
    pub fn kappa([x, y, z]: [f64; 3]) -> f64 {
        0.3 * (0.3 * x.sin() + 0.2 * (0.8 * y).cos() + 0.1 * z).exp()
    }
    pub fn mu([x, y, z]: [f64; 3]) -> f64 {
        0.05 * (1.0 + 0.5 * (0.7 * x + y - z).sin())
    }
    pub fn phi([x, y, z]: [f64; 3]) -> f64 {
        2.0 + (0.9 * x + 0.2).sin() * (0.7 * y + 0.3).cos() * (-0.5 * z).exp()
    }
    pub fn phi_gradient([x, y, z]: [f64; 3]) -> [f64; 3] {
        let ((sx, cx), (sy, cy)) = ((0.9 * x + 0.2).sin_cos(), (0.7 * y + 0.3).sin_cos());
        let e = (-0.5 * z).exp();
        [0.9 * cx * cy * e, -0.7 * sx * sy * e, -0.5 * sx * cy * e]
    }
    /// s = −∇·(κ∇φ) + μφ, with ∇κ = κ ∇ log κ.
    pub fn source(p @ [x, y, _]: [f64; 3]) -> f64 {
        let laplacian = (-0.81 - 0.49 + 0.25) * (phi(p) - 2.0);
        let log_kappa = [0.3 * x.cos(), -0.16 * (0.8 * y).sin(), 0.1];
        let g = phi_gradient(p);
        let along: f64 = log_kappa.iter().zip(g).map(|(a, b)| a * b).sum();
        -kappa(p) * (laplacian + along) + mu(p) * phi(p)
    }
}

/// Root mean square error of the discrete solution on a block of 4 × 5 × 3 mm.
fn manufactured_error(cells: [usize; 3]) -> f64 {
    use manufactured::{kappa, mu, phi, phi_gradient, source};
    let size = [4.0, 5.0, 3.0];
    let h: [f64; 3] = std::array::from_fn(|a| size[a] / cells[a] as f64);
    let grid = Grid::new(cells, h).unwrap();
    let [nx, ny, _] = cells;
    let position = |i: usize| [i % nx, i / nx % ny, i / (nx * ny)];
    let centre = |i: usize| {
        let [x, y, z] = position(i);
        grid.centre_mm(x, y, z)
    };
    let sample = |f: fn([f64; 3]) -> f64| (0..grid.len()).map(|i| f(centre(i))).collect::<Vec<_>>();
    let optics = wang2008(LateralBoundary::Open);
    let c = optics.boundary_constant;
    let mut b = Batch::zeros(grid.len(), 1);
    for i in 0..grid.len() {
        let (p, at) = (centre(i), position(i));
        let mut value = grid.cell_volume_mm3() * source(p);
        for a in 0..3 {
            for (outward, on_face) in [(-1.0, at[a] == 0), (1.0, at[a] + 1 == cells[a])] {
                if on_face {
                    let mut face = p;
                    face[a] += outward * h[a] / 2.0;
                    let q = phi(face) + 2.0 * c * kappa(face) * outward * phi_gradient(face)[a];
                    let area = grid.cell_volume_mm3() / h[a];
                    value += area / (2.0 * c + h[a] / (2.0 * kappa(p))) * q;
                }
            }
        }
        b.set(0, i, value);
    }
    let medium = Medium::new(grid, sample(kappa), sample(mu)).unwrap();
    let mut solver = CpuSolver::<f64>::new();
    let mut forward = Forward::new(medium, &optics, &mut solver).unwrap();
    let mut x = Batch::zeros(grid.len(), 1);
    forward.solve_raw(&b, &mut x, 1e-11).unwrap();
    let squares = (0..grid.len()).map(|i| (x.get(0, i) - phi(centre(i))).powi(2));
    (squares.sum::<f64>() / grid.len() as f64).sqrt()
}

/// Halving the cells divides the error by 4, up to the next order, which at the coarsest cells is
/// below 1 % of the error and shrinks from the first pair of grids to the second.
#[test]
fn converges_to_a_manufactured_solution_with_second_order() {
    let error: Vec<f64> =
        [1, 2, 4].iter().map(|k| manufactured_error([8 * k, 9 * k, 7 * k])).collect();
    let order: Vec<f64> = error.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
    assert!((order[0] - 2.0).abs() < 0.02, "{order:?}");
    assert!((order[1] - 2.0).abs() < 0.01, "{order:?}");
}

/// The slab of the closed form: a cosine on the lit back face, no flux through the sides.
struct CosineSlab {
    size: [f64; 3],
    kappa: f64,
    mu: f64,
    optics: Optics,
}

impl CosineSlab {
    fn new() -> Self {
        let optics = wang2008(LateralBoundary::NoFlux);
        Self { size: [4.0, 3.0, 2.0], kappa: 0.4, mu: 0.08, optics }
    }

    /// cos(πx/Lx) cos(πy/Ly).
    fn pattern(&self, x: f64, y: f64) -> f64 {
        (PI * x / self.size[0]).cos() * (PI * y / self.size[1]).cos()
    }

    /// Z and Z' at depth z, where φ = pattern · Z: Z'' = γ²Z with γ² = μ/κ + (π/Lx)² + (π/Ly)²,
    /// Z − 2CκZ' = 0 in front (z = 0), Z + 2CκZ' = 1 at the back. Z ∝ s sinh γz + cosh γz with
    /// s = 1/(2Cκγ) satisfies the front.
    fn along_z(&self, z: f64) -> (f64, f64) {
        let [lx, ly, lz] = self.size;
        let gamma = (self.mu / self.kappa + (PI / lx).powi(2) + (PI / ly).powi(2)).sqrt();
        let robin = 2.0 * self.optics.boundary_constant * self.kappa;
        let s = 1.0 / (robin * gamma);
        let at = |z: f64| {
            let (sinh, cosh) = ((gamma * z).sinh(), (gamma * z).cosh());
            (s * sinh + cosh, gamma * (s * cosh + sinh))
        };
        let back = at(lz);
        let scale = 1.0 / (back.0 + robin * back.1);
        let (value, slope) = at(z);
        (scale * value, scale * slope)
    }

    /// Largest error of the fluence relative to its peak, and the relative error of the front's
    /// exit radiance. (A cosine stays a cosine on the grid too, so the image has one amplitude.)
    fn errors(&self, cells: [usize; 3]) -> [f64; 2] {
        let h = std::array::from_fn(|a| self.size[a] / cells[a] as f64);
        let grid = Grid::new(cells, h).unwrap();
        let [nx, ny, nz] = cells;
        let map: Vec<f64> = (0..nx * ny)
            .map(|i| grid.centre_mm(i % nx, i / nx, 0))
            .map(|[x, y, _]| self.pattern(x, y))
            .collect();
        let light = Illuminations::new(&grid, Face::Back, vec![map.clone()]).unwrap();
        let medium = Medium::homogeneous(grid, self.kappa, self.mu).unwrap();
        let mut solver = CpuSolver::<f64>::new();
        let mut forward = Forward::new(medium, &self.optics, &mut solver).unwrap();
        let mut phi = Batch::zeros(grid.len(), 1);
        forward.solve(&light, &mut phi, 1e-10).unwrap();
        let image = &forward.exit_radiance(&light, &phi, Face::Front)[0];

        let (mut worst, mut peak) = (0.0f64, 0.0f64);
        for z in 0..nz {
            let depth = grid.centre_mm(0, 0, z)[2];
            for c in 0..nx * ny {
                let exact = map[c] * self.along_z(depth).0;
                worst = worst.max((phi.get(0, z * nx * ny + c) - exact).abs());
                peak = peak.max(exact.abs());
            }
        }
        // W08 (3): L = −(C/π) κ ∂φ/∂n with n = −z in front.
        let front = self.optics.boundary_constant / PI * self.kappa * self.along_z(0.0).1;
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let amplitude = dot(image, &map) / dot(&map, &map);
        assert!(image.iter().zip(&map).all(|(l, m)| (l - m * amplitude).abs() < 1e-7 * front));
        [worst / peak, amplitude / front - 1.0]
    }
}

/// The fluence is right to 1e-4 on 80 × 60 × 48 cells as it is. The radiance is that of the weakest
/// light, after 2.6 decay lengths, over which the scheme's error of second order (γ²h²/24 of the
/// decay rate) adds up to 9e-4 there: twice coarser it must be four times as large (2 % for the
/// next order), and with that order taken out (Richardson) 1e-5 is left.
#[test]
fn homogeneous_slab_agrees_with_the_closed_form() {
    let slab = CosineSlab::new();
    let [fluence, radiance] = slab.errors([80, 60, 48]);
    let [coarse_fluence, coarse_radiance] = slab.errors([40, 30, 24]);
    assert!(fluence < 1e-4, "{fluence}");
    assert!(coarse_fluence > 3.5 * fluence, "{coarse_fluence} {fluence}");
    assert!((coarse_radiance / radiance / 4.0 - 1.0).abs() < 0.02, "{coarse_radiance} {radiance}");
    let extrapolated = (4.0 * radiance - coarse_radiance) / 3.0;
    assert!(extrapolated.abs() < 1e-5, "{extrapolated}");
}

/// Power through one face, per pattern: Jₙ recovered from the radiance, times the area.
fn outward(
    forward: &Forward<'_, CpuSolver<f64>>,
    light: &Illuminations,
    phi: &Batch,
    face: Face,
) -> Vec<f64> {
    let surface = forward.surface();
    let [hx, hy, _] = forward.medium().grid().spacing_mm();
    let maps = forward.exit_radiance(light, phi, face);
    let power = maps.iter().enumerate().map(|(m, map)| {
        let flux = map.iter().enumerate().map(|(c, l)| {
            let lit = if face == light.face() { light.maps()[m][c] } else { 0.0 };
            (l - surface.exit_per_irradiance * lit) / surface.exit_per_flux
        });
        hx * hy * flux.sum::<f64>()
    });
    power.collect()
}

/// absorbed + leaving = entering. What enters is, for diffuse light, the inward flux itself
/// (negative "leaving" on the lit face); for a beam, the part that it loses to scattering: each
/// column's own Beer–Lambert integral, written out here once more. Summing A φ = b over all
/// cells leaves Σr, at most √n · tolerance · ‖b‖; the cells' b being alike, ‖b‖ ≤ Σb: √n · 1e-10, and 1e-9
/// for the integral of what leaves at once.
#[test]
fn energy_balances() {
    let grid = Grid::new([11, 9, 7], [0.8, 1.1, 0.5]).unwrap();
    let medium = rough(grid);
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let [hx, hy, hz] = grid.spacing_mm();
    let plane = grid.face_len();
    for boundary in
        [BoundaryConvention::Wang2008, BoundaryConvention::Wang2010, BoundaryConvention::Transport]
    {
        for illumination in [Illumination::Diffuse, Illumination::Collimated] {
            for face in [Face::Front, Face::Back] {
                let lateral = LateralBoundary::NoFlux;
                let optics = Optics { boundary, illumination, lateral, ..Optics::from_eta(1.3) };
                let maps: Vec<Vec<f64>> =
                    (0..3).map(|_| (0..plane).map(|_| rng.random::<f64>()).collect()).collect();
                let light = Illuminations::new(&grid, face, maps).unwrap();
                let mut solver = CpuSolver::<f64>::new();
                let mut forward = Forward::new(medium.clone(), &optics, &mut solver).unwrap();
                let mut phi = Batch::zeros(grid.len(), light.count());
                forward.solve(&light, &mut phi, 1e-10).unwrap();
                let front = outward(&forward, &light, &phi, Face::Front);
                let back = outward(&forward, &light, &phi, Face::Back);
                for (m, map) in light.maps().iter().enumerate() {
                    let absorbed: f64 = (0..grid.len())
                        .map(|i| grid.cell_volume_mm3() * medium.mu_per_mm()[i] * phi.get(m, i))
                        .sum();
                    let mut scattered = 0.0;
                    for c in 0..plane {
                        let mut beam = forward.surface().beam * hx * hy * map[c];
                        for k in 0..7 {
                            let i = if face == Face::Front { k } else { 6 - k } * plane + c;
                            let (kappa, mu) = (medium.kappa_mm()[i], medium.mu_per_mm()[i]);
                            let next = beam * (-hz / (3.0 * kappa)).exp();
                            let acts = match k {
                                0 => 1.0 - leaves_at_once(kappa, mu, hz, optics.boundary_constant),
                                _ => 1.0,
                            };
                            scattered += acts * (1.0 - 3.0 * kappa * mu) * (beam - next);
                            beam = next;
                        }
                    }
                    let (lit, far) =
                        if face == Face::Front { (front[m], back[m]) } else { (back[m], front[m]) };
                    let entering = if scattered > 0.0 { scattered } else { -lit };
                    let leaving = if scattered > 0.0 { lit + far } else { far };
                    let balance = (absorbed + leaving - entering).abs() / entering;
                    let name = format!("{boundary:?} {illumination:?} {face:?} {m}");
                    assert!(entering > 0.0 && absorbed > 0.05 * entering && far > 0.0, "{name}");
                    let bound = (grid.len() as f64).sqrt() * 1e-10 + 1e-9;
                    assert!(balance < bound, "{name}: {balance:.1e}");
                }
            }
        }
    }
}

/// The share of what the outermost cell scatters that acts on the far side of the face: where it scatters on
/// average by an integral, and how much less that counts than the cell's middle by similar triangles.
fn leaves_at_once(kappa: f64, mu: f64, h: f64, boundary_constant: f64) -> f64 {
    const STEPS: usize = 20_000;
    let (mut all, mut nearer) = (0.0, 0.0);
    for i in 0..STEPS {
        let t = (i as f64 + 0.5) / STEPS as f64;
        let scattered = (-h / (3.0 * kappa) * t).exp();
        all += scattered;
        nearer += scattered * (0.5 - t);
    }
    // What conducts there, by the terms of its series (rough blocks are within 3κμ ≤ 0.15).
    let a = 3.0 * kappa * mu;
    let d = kappa * (1.0 + 0.8 * a + 108.0 / 175.0 * a * a + (1.2 - 108.0 / 175.0) * a * a * a);
    let zero = 2.0 * boundary_constant * d;
    (nearer / all) * h / (0.5 * h + zero)
}

/// A block that absorbs nothing turns all of the beam's loss into diffuse light, but for what leaves at
/// once: T A E (1 − exp(−τ)) column by column, to the integral's 1e-9.
#[test]
fn a_beam_loses_what_the_source_gains() {
    let grid = Grid::new([4, 3, 6], [0.8, 1.1, 0.5]).unwrap();
    let medium = Medium::new(grid, rough(grid).kappa_mm().to_vec(), vec![0.0; grid.len()]).unwrap();
    let light = Illuminations::new(&grid, Face::Back, vec![vec![1.0; 12]]).unwrap();
    let mut solver = CpuSolver::<f64>::new();
    let forward = Forward::new(medium.clone(), &Optics::from_eta(1.0), &mut solver).unwrap();
    let b = forward.right_hand_side(&light);
    let constant = forward.surface().boundary_constant;
    for c in 0..12 {
        let kappa = medium.kappa_mm()[5 * 12 + c];
        let first = forward.surface().beam * 0.8 * 1.1 * (1.0 - (-0.5 / (3.0 * kappa)).exp());
        let left = first * leaves_at_once(kappa, 0.0, 0.5, constant);
        let gained = left + (0..6).map(|z| b.get(0, z * 12 + c)).sum::<f64>();
        let depth: f64 = (0..6).map(|z| 0.5 / (3.0 * medium.kappa_mm()[z * 12 + c])).sum();
        let lost = forward.surface().beam * 0.8 * 1.1 * (1.0 - (-depth).exp());
        assert!((gained / lost - 1.0).abs() < 1e-9, "{c}: {gained} {lost}");
    }
}

/// A beam through a slab that absorbs nothing, in cells of a tenth to six mean free paths. The fluence of a
/// source at depth z falls on straight lines to zero 2Cκ outside of both faces, so that
/// J = ∫ (z + 2Cκ)/(d + 4Cκ) exp(−z/ℓ)/ℓ dz leaves on the far side, whatever the cells: all of them
/// to the solves' 1e-10 times the slab's condition number of about 1e2.
#[test]
fn what_a_beam_sends_through_a_slab_does_not_depend_on_the_cells() {
    let (free_path, thickness) = (0.9_f64, 10.8);
    for eta in [1.0, 1.4] {
        for cells in [120, 12, 6, 2] {
            let grid = Grid::new([2, 2, cells], [1.0, 1.0, thickness / cells as f64]).unwrap();
            let medium = Medium::homogeneous(grid, free_path / 3.0, 0.0).unwrap();
            let optics = Optics { lateral: LateralBoundary::NoFlux, ..Optics::from_eta(eta) };
            let mut solver = CpuSolver::<f64>::new();
            let mut forward = Forward::new(medium, &optics, &mut solver).unwrap();
            for (lit, far) in [(Face::Back, Face::Front), (Face::Front, Face::Back)] {
                let light = Illuminations::new(&grid, lit, vec![vec![1.0; 4]]).unwrap();
                let mut phi = Batch::zeros(grid.len(), 1);
                forward.solve(&light, &mut phi, 1e-10).unwrap();
                let beyond = 2.0 * optics.boundary_constant * free_path / 3.0;
                let passes = (-thickness / free_path).exp();
                let depth = (free_path + beyond) * (1.0 - passes) - thickness * passes;
                let through = forward.surface().beam * depth / (thickness + 2.0 * beyond);
                let found = outward(&forward, &light, &phi, far)[0] / 4.0;
                let error = (found / through - 1.0).abs();
                assert!(error < 1e-8, "{eta} {cells} {lit:?}: {found} {through}");
            }
        }
    }
}

/// Light from a spot behind seen at a spot in front is light from the one in front seen behind:
/// the operator is symmetric. Both images carry the solves' error of about 1e-11 of their peak;
/// 1e-8 leaves room for its growth by the condition number.
#[test]
fn source_and_exit_can_be_swapped() {
    let grid = Grid::new([9, 8, 5], [0.8, 1.1, 0.6]).unwrap();
    let plane = grid.face_len();
    let mut solver = CpuSolver::<f64>::new();
    let mut forward =
        Forward::new(rough(grid), &wang2008(LateralBoundary::Open), &mut solver).unwrap();
    let spots = [0, 8, 31, 40, 71];
    let mut images = |lit: Face, seen: Face| {
        let map = |s: &usize| (0..plane).map(|c| f64::from(u8::from(c == *s))).collect();
        let light = Illuminations::new(&grid, lit, spots.iter().map(map).collect()).unwrap();
        let mut phi = Batch::zeros(grid.len(), light.count());
        forward.solve(&light, &mut phi, 1e-11).unwrap();
        forward.exit_radiance(&light, &phi, seen)
    };
    let through = images(Face::Back, Face::Front);
    let return_way = images(Face::Front, Face::Back);
    let peak = through.iter().flatten().fold(0.0f64, |a, l| a.max(*l));
    let mut unlike = 0.0f64;
    for (i, a) in spots.iter().enumerate() {
        for (j, b) in spots.iter().enumerate() {
            let off = (through[i][*b] - return_way[j][*a]).abs() / peak;
            assert!(off < 1e-8, "{a} to {b}: {off:.1e}");
            unlike = unlike.max((through[i][*b] - through[j][*a]).abs() / peak);
        }
    }
    // The block is rough enough that the test would notice spots that are mixed up.
    assert!(unlike > 1e-2, "{unlike}");
}

/// W08 (8): with `Scheme::Stam`, (κφ of the six neighbours − 6 κφ)/h² − μφ = 0 in every cell inside, to what the
/// solve leaves; the default solves another equation there. Where κ is the same everywhere both are one,
/// light and images too.
#[test]
fn scheme_stam_is_the_papers_stencil() {
    let grid = Grid::new([7, 6, 5], [0.7; 3]).unwrap();
    let medium = rough(grid);
    let light = Illuminations::regions(&grid, Face::Back, 2).unwrap();
    let solve = |medium: &Medium, scheme: Scheme| {
        let optics = Optics { scheme, ..wang2008(LateralBoundary::Open) };
        let mut solver = CpuSolver::<f64>::new();
        let mut forward = Forward::new(medium.clone(), &optics, &mut solver).unwrap();
        let mut unknown = Batch::zeros(grid.len(), light.count());
        forward.solve(&light, &mut unknown, 1e-12).unwrap();
        let images = forward.exit_radiance(&light, &unknown, Face::Front);
        (unknown, images)
    };
    let kappa = medium.kappa_mm();
    let residual = |kappa_phi: &dyn Fn(usize) -> f64| -> f64 {
        let mut worst = 0.0f64;
        for (x, y, z) in
            (1..6).flat_map(|x| (1..5).flat_map(move |y| (1..4).map(move |z| (x, y, z))))
        {
            let i = (z * 6 + y) * 7 + x;
            let neighbours = [i - 1, i + 1, i - 7, i + 7, i - 42, i + 42];
            let sum: f64 = neighbours.into_iter().map(kappa_phi).sum();
            let absorbed = medium.mu_per_mm()[i] * kappa_phi(i) / kappa[i];
            let off = (sum - 6.0 * kappa_phi(i)) / 0.49 - absorbed;
            worst = worst.max(off.abs() / (6.0 * kappa_phi(i) / 0.49));
        }
        worst
    };
    let (stam, _) = solve(&medium, Scheme::Stam);
    let (other, _) = solve(&medium, Scheme::FiniteVolume);
    let of_stam = residual(&|i| stam.get(0, i));
    let of_other = residual(&|i| kappa[i] * other.get(0, i));
    // The residual of 1e-12 is the whole block's, of which a cell far from the light has little.
    assert!(of_stam < 1e-8, "{of_stam:.1e}");
    assert!(of_other > 0.05, "{of_other:.1e}");

    let even = Medium::new(grid, vec![0.3; grid.len()], medium.mu_per_mm().to_vec()).unwrap();
    let [(_, stam), (_, other)] =
        [Scheme::Stam, Scheme::FiniteVolume].map(|scheme| solve(&even, scheme));
    let peak = other.iter().flatten().fold(0.0f64, |a, l| a.max(*l));
    for (a, b) in stam.iter().flatten().zip(other.iter().flatten()) {
        assert!((a - b).abs() < 1e-9 * peak, "{a} {b}");
    }
}

/// The matrix itself is symmetric: u·(A v) = v·(A u) to the rounding of sums of 1000 terms.
#[test]
fn the_operator_is_symmetric() {
    let grid = Grid::new([10, 5, 20], [0.8, 1.1, 0.6]).unwrap();
    let operator = Operator::new(&rough(grid), &Optics::from_eta(1.3));
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut fields = Batch::zeros(grid.len(), 2);
    for field in 0..2 {
        (0..grid.len()).for_each(|i| fields.set(field, i, rng.random_range(-1.0..1.0)));
    }
    // residual(0, x) = −A x.
    let product = operator.residual(&Batch::zeros(grid.len(), 2), &fields);
    let dot = |a: usize, b: usize| -> f64 {
        (0..grid.len()).map(|i| fields.get(a, i) * product.get(b, i)).sum()
    };
    let scale = (dot(0, 0) * dot(1, 1)).sqrt();
    assert!((dot(0, 1) - dot(1, 0)).abs() < 1e-13 * scale);
    assert!(dot(0, 0) < 0.0 && dot(1, 1) < 0.0);
}
