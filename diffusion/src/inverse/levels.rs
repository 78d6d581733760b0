//! The same problem on coarser grids, where an inverse solve begins.

use super::objective::Problem;
use material::Grid;

/// A volume is looked for on grids with at least this many cells along x, y and z: two for each of
/// 4 × 4 regions, and enough of them deep to tell front from middle from back.
const LEAST_CELLS: [usize; 3] = [8, 8, 3];

/// A coarser grid is wrong by more: a scheme of second order by four times as much.
const ERROR_GROWTH: f64 = 4.0;

/// The grids on which a problem is solved, the finest first. `model_error` is what the finest gets wrong, see
/// [`InverseSettings`](super::InverseSettings); `problem` does not have it in its weights yet.
pub(super) fn levels(problem: &Problem, model_error: f64) -> Vec<Problem> {
    let mut levels = vec![problem.clone()];
    while let Some(coarser) = halved(&levels[levels.len() - 1]) {
        levels.push(coarser);
    }
    let mut error = model_error;
    for level in &mut levels {
        level.measurement = level.measurement.with_model_error(error);
        error *= ERROR_GROWTH;
    }
    levels
}

/// The problem on half as many cells along every axis that has enough of them.
fn halved(problem: &Problem) -> Option<Problem> {
    let cells = problem.grid.cells();
    let fewer: [usize; 3] = std::array::from_fn(|a| {
        let half = cells[a].div_ceil(2);
        if half >= LEAST_CELLS[a] { half } else { cells[a] }
    });
    // The face has to become coarser along both of its axes, or next to nothing is won.
    if fewer[0] == cells[0] || fewer[1] == cells[1] {
        return None;
    }
    let size = problem.grid.size_mm();
    let grid = Grid::new(fewer, std::array::from_fn(|a| size[a] / fewer[a] as f64)).ok()?;
    let measurement = problem.measurement.averaged(&problem.grid, &grid);
    Some(Problem { grid, measurement, ..problem.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Illuminations, Measurement};
    use material::{Face, Optics};

    fn problem(cells: [usize; 3]) -> Problem {
        let grid = Grid::new(cells, [0.5, 0.4, 0.3]).unwrap();
        let light = Illuminations::regions(&grid, Face::Back, 4).unwrap();
        let mut variance = vec![vec![0.04; grid.face_len()]; 16];
        // Three quarters of the first coarse pixel, and one of the four in the next.
        for i in [0, 1, cells[0], 2] {
            variance[0][i] = f64::INFINITY;
        }
        let image = |m: usize| (0..grid.face_len()).map(|i| (1 + m + i) as f64).collect();
        let radiance = (0..16).map(image).collect();
        let measurement = Measurement::new(&grid, light, radiance, &variance).unwrap();
        Problem { grid, optics: Optics::from_eta(1.3), measurement, free_gain: false, edge: None }
    }

    /// Cells of the paper's blocks by hand: halves, rounded up, as long as they are enough.
    #[test]
    fn grids_become_coarser_as_long_as_regions_are_resolved() {
        let cells = |cells| -> Vec<[usize; 3]> {
            levels(&problem(cells), 0.0).iter().map(|p| p.grid.cells()).collect()
        };
        assert_eq!(cells([31, 40, 10]), [[31, 40, 10], [16, 20, 5], [8, 10, 3]]);
        assert_eq!(cells([72, 72, 7]), [[72, 72, 7], [36, 36, 4], [18, 18, 4], [9, 9, 4]]);
        assert_eq!(cells([14, 40, 10]), [[14, 40, 10]]);
    }

    /// A block keeps its size; four pixels of variance v make one of v/4, two with one masked v/3; and one
    /// that is mostly masked is masked.
    #[test]
    fn images_are_averaged() {
        let levels = levels(&problem([32, 32, 8]), 0.0);
        let [fine, coarse, ..] = &levels[..] else { panic!("{}", levels.len()) };
        for axis in 0..3 {
            let [a, b] = [fine, coarse].map(|p| p.grid.size_mm()[axis]);
            assert!((a - b).abs() < 1e-12);
        }
        let (radiance, weight) = (coarse.measurement.radiance(), coarse.measurement.weight());
        assert_eq!(weight[0][0], 0.0);
        // Pixels 3, 34 and 35, which hold one more than that.
        assert!((radiance[0][1] - (4.0 + 35.0 + 36.0) / 3.0).abs() < 1e-9);
        assert!((weight[0][1] - 3.0 / 0.04).abs() < 1e-9);
        assert!((radiance[1][0] - (2.0 + 3.0 + 34.0 + 35.0) / 4.0).abs() < 1e-9);
        assert!((weight[1][0] - 4.0 / 0.04).abs() < 1e-9);
    }
}
