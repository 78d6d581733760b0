//! How exactly the linear systems are solved while coefficients are looked for: what is solved much more
//! exactly than what it is compared with is wasted (Dembo, Eisenstat & Steihaug, Inexact Newton
//! methods, 1982).

/// A forward solve may be off by this share of what the images still differ by, and an adjoint one by this share
/// of itself. The gradient is then off by less than 1 % (the test below), while a step of L-BFGS
/// promises tens of percents of what there is to gain. From 1e-6 to here neither what is found nor
/// the number of steps changes beyond chance, and of five iterations three are left.
const SHARE: f64 = 1e-3;

/// Relative residuals of forward and adjoint solves.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Accuracy {
    exact: f64,
}

impl Accuracy {
    /// `exact` is what nothing is solved more exactly than.
    pub fn new(exact: f64) -> Self {
        Self { exact }
    }

    /// Where figures are told, or small differences taken.
    pub fn exact(&self) -> f64 {
        self.exact
    }

    /// Of a forward solve near a point with D = Σ w (γL − L_meas)² / Σ w L_meas²: √D is what the images
    /// differ by, relative to themselves.
    pub fn forward(&self, data: f64) -> f64 {
        (SHARE * data.sqrt()).clamp(self.exact, SHARE.max(self.exact))
    }

    /// Of an adjoint solve: its right-hand side is that difference already.
    pub fn adjoint(&self) -> f64 {
        SHARE.max(self.exact)
    }
}

#[cfg(test)]
mod tests {
    use super::super::data_term::WithSolver;
    use super::super::objective::{Device, Objective, Problem};
    use super::*;
    use crate::{CpuSolver, Forward, Illuminations, Measurement, Medium};
    use material::{Face, Grid, Optics};

    /// Far from the answer and near it, the gradient is off by less than 1 %: ten times the share that
    /// each of the two solves is allowed, for what a residual of a solve means for its error (at three
    /// times the share it was 1.2 %).
    #[test]
    fn the_gradient_is_as_accurate_as_a_step_needs() {
        let grid = Grid::new([20, 20, 8], [0.5; 3]).unwrap();
        let optics = Optics::from_eta(1.3);
        let logs = |contrast: f64| -> Vec<f64> {
            let wave = |i: usize| (0.37 * (i % 20) as f64 + 0.21 * (i / 20 % 20) as f64).sin();
            let log = |i: usize| [0.3f64, 0.01][i / grid.len()].ln() + contrast * wave(i);
            (0..2 * grid.len()).map(log).collect()
        };
        let truth: Vec<f64> = logs(0.5).iter().map(|u| u.exp()).collect();
        let (kappa, mu) = truth.split_at(grid.len());
        let medium = Medium::new(grid, kappa.to_vec(), mu.to_vec()).unwrap();
        let light = Illuminations::regions(&grid, Face::Back, 4).unwrap();
        let mut solver = CpuSolver::<f32>::new();
        let images =
            Forward::new(medium, &optics, &mut solver).unwrap().images(&light, 1e-8).unwrap();
        let variance: Vec<Vec<f64>> =
            images.iter().map(|map| map.iter().map(|l| (0.02 * l).powi(2)).collect()).collect();
        let measurement = Measurement::new(&grid, light, images, &variance).unwrap();
        let problem = Problem { grid, optics, measurement, free_gain: false, edge: None };
        for contrast in [0.0, 0.4, 0.49] {
            let u = logs(contrast);
            let mut gradients = Vec::new();
            for accuracy in [Accuracy::new(1e-8), Accuracy::new(1e-6)] {
                let mut device = WithSolver(&mut solver);
                let mut objective = device.objective(&problem).unwrap();
                let misfit = objective.forward(&u, accuracy.exact()).unwrap();
                let data = misfit.weighted / problem.measurement.weighted_energy();
                objective.forget();
                let of = |exact: f64, rough: f64| if gradients.is_empty() { exact } else { rough };
                objective.forward(&u, of(1e-8, accuracy.forward(data))).unwrap();
                gradients.push(objective.gradient(of(1e-8, accuracy.adjoint())).unwrap());
            }
            let norm = |v: &[f64]| v.iter().map(|g| g * g).sum::<f64>().sqrt();
            let off: Vec<f64> =
                gradients[0].iter().zip(&gradients[1]).map(|(a, b)| a - b).collect();
            let share = norm(&off) / norm(&gradients[0]);
            println!("contrast {contrast}: gradient off by {:.2e} of itself", share);
            assert!(share < 0.01, "contrast {contrast}: off by {share:.2e}");
        }
    }
}
