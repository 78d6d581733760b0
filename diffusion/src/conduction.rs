//! The coefficient in front of the gradient: κ, or what makes light fade as radiative transport has it.
//!
//! Deep in a block that scatters isotropically, fluence fades as exp(−z/(ν₀ l)), l = 3κ being the mean free path and
//! ν₀ the largest root of 1 = c ν artanh(1/ν) with the albedo c = 1 − a, a = 3κμ (Case & Zweifel, Linear
//! Transport Theory, 1967, section 4.4). κ itself, from P1, makes that exp(−z √(μ/κ)): over 40 mean free paths at
//! albedo 0.95 a third of the light is missing. The coefficient that has it right is μ ν₀² l², which is
//!
//! ```text
//! D = κ (1 + 4/5 a + 108/175 a² + …),
//! ```
//!
//! the first terms of which are 1/(3(σs' + μ/5)) (Aronson & Corngold, Photon diffusion coefficient in an absorbing
//! medium, 1999). The cubic term is such that D is exact, 3κ, where nothing scatters: D is within 2e-4 up to a = 0.1
//! and within 3 % everywhere.

use crate::Medium;
use material::{BoundaryConvention, Optics};
use rayon::prelude::*;

/// The terms after 1 of D/κ in powers of a.
const TERMS: [f64; 3] = [0.8, 108.0 / 175.0, 2.0 - 0.8 - 108.0 / 175.0];

/// What stands in front of the gradient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Conduction {
    /// κ: the papers' own.
    Kappa,
    /// D, exact far from all light.
    Asymptotic,
}

impl Conduction {
    /// Under `transport` D, under the papers' conventions κ.
    pub fn of(optics: &Optics) -> Self {
        match optics.boundary {
            BoundaryConvention::Transport => Self::Asymptotic,
            BoundaryConvention::Wang2008 | BoundaryConvention::Wang2010 => Self::Kappa,
        }
    }

    /// The coefficient, mm, and its derivatives by κ and by μ. Beyond a = 1, which nothing has, it
    /// stays at 3κ.
    pub fn at(self, kappa: f64, mu: f64) -> (f64, f64, f64) {
        let a = 3.0 * kappa * mu;
        match self {
            Self::Kappa => (kappa, 1.0, 0.0),
            Self::Asymptotic if a >= 1.0 => (3.0 * kappa, 3.0, 0.0),
            Self::Asymptotic => {
                let [p, q, r] = TERMS;
                let ratio = 1.0 + a * (p + a * (q + a * r));
                let slope = p + a * (2.0 * q + a * 3.0 * r);
                (kappa * ratio, ratio + a * slope, 3.0 * kappa * kappa * slope)
            }
        }
    }

    /// The coefficient of every cell, mm.
    pub fn of_cells(self, medium: &Medium) -> Vec<f64> {
        let cells = medium.kappa_mm().par_iter().zip(medium.mu_per_mm());
        cells.map(|(kappa, mu)| self.at(*kappa, *mu).0).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ν₀ by bisection of its own equation; the bounds are the ones named above.
    #[test]
    fn light_fades_as_in_transport() {
        for (a, bound) in [(1e-3, 1e-6), (0.01, 1e-5), (0.05, 6e-5), (0.1, 2e-4), (0.6, 0.03)] {
            let (mut low, mut high) = (1.0 + 1e-12, 100.0f64);
            for _ in 0..100 {
                let nu = 0.5 * (low + high);
                // Falls with ν.
                if (1.0 - a) * nu * nu.recip().atanh() > 1.0 { low = nu } else { high = nu }
            }
            let (kappa, mu) = (0.3, a / 0.9);
            let exact = mu * (low * 3.0 * kappa).powi(2);
            let (d, ..) = Conduction::Asymptotic.at(kappa, mu);
            assert!((d / exact - 1.0).abs() < bound, "{a}: {d} {exact}");
        }
    }

    /// Derivatives by central differences, exact to second order in 1e-5.
    #[test]
    fn slopes() {
        for (kappa, mu) in [(0.3, 0.01), (0.3, 0.8), (0.3, 2.0)] {
            let of = |kappa, mu| Conduction::Asymptotic.at(kappa, mu).0;
            let (_, by_kappa, by_mu) = Conduction::Asymptotic.at(kappa, mu);
            let s = 1e-5;
            assert!((by_kappa - (of(kappa + s, mu) - of(kappa - s, mu)) / (2.0 * s)).abs() < 1e-8);
            assert!((by_mu - (of(kappa, mu + s) - of(kappa, mu - s)) / (2.0 * s)).abs() < 1e-8);
        }
    }
}
