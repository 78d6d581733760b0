//! What a smooth surface between the block and the air does to light.

use material::{fresnel_reflectance, normal_reflectance};

/// A block of refractive index η in air.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    eta: f32,
    /// Reflectance along the normal, from either side.
    pub normal_reflectance: f32,
}

impl Surface {
    pub fn new(eta: f64) -> Self {
        Self { eta: eta as f32, normal_reflectance: normal_reflectance(eta) as f32 }
    }

    pub fn eta(self) -> f32 {
        self.eta
    }

    /// Whether light passes as if there were no surface.
    pub fn matched(self) -> bool {
        self.eta == 1.0
    }

    /// Cosine of the refracted ray in the air for one inside, both against the normal; 0 for
    /// total reflection (Snell).
    fn leaving(self, cos_inside: f32) -> f32 {
        let sin2 = self.eta * self.eta * (1.0 - cos_inside * cos_inside);
        (1.0 - sin2).max(0.0).sqrt()
    }

    /// Cosine of the refracted ray inside for one in the air.
    pub fn entering(self, cos_outside: f32) -> f32 {
        let sin2 = (1.0 - cos_outside * cos_outside) / (self.eta * self.eta);
        (1.0 - sin2).max(0.0).sqrt()
    }

    /// Share of unpolarised light that is reflected at this pair of angles (Fresnel).
    fn fresnel(self, cos_inside: f32, cos_outside: f32) -> f32 {
        let [eta, inside, outside] = [self.eta, cos_inside, cos_outside].map(f64::from);
        fresnel_reflectance(eta, inside, outside) as f32
    }

    /// Share of the light inside that is reflected back into the block.
    pub fn inner_reflectance(self, cos_inside: f32) -> f32 {
        if self.matched() { 0.0 } else { self.fresnel(cos_inside, self.leaving(cos_inside)) }
    }

    /// Share of the light outside that is reflected back into the air.
    pub fn outer_reflectance(self, cos_outside: f32) -> f32 {
        if self.matched() { 0.0 } else { self.fresnel(self.entering(cos_outside), cos_outside) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// F_dr = 2 ∫ R(μ) μ dμ, by the midpoint rule, is 0.4731 at η = 1.33 and 0.5963 at η = 1.5:
    /// the exact integral, of which [`material::diffuse_reflectance`] is a fit within 0.01.
    #[test]
    fn mean_reflectance_is_the_known_integral() {
        for eta in [1.1, 1.3, 1.33, 1.5] {
            let surface = Surface::new(eta);
            let n = 200_000;
            let cosines = (0..n).map(|i| (f64::from(i) + 0.5) / f64::from(n));
            let sum: f64 = cosines
                .map(|c| 2.0 * c * f64::from(surface.inner_reflectance(c as f32)))
                .sum::<f64>()
                / f64::from(n);
            let fit = material::diffuse_reflectance(eta);
            assert!((sum - fit).abs() < 0.012, "{eta}: {sum} {fit}");
            // Light that enters from everywhere alike leaves as it came: 1 − F(in) = η² (1 − F(out)).
            let outside: f64 = (0..n)
                .map(|i| (f64::from(i) + 0.5) / f64::from(n))
                .map(|c| 2.0 * c * f64::from(surface.outer_reflectance(c as f32)))
                .sum::<f64>()
                / f64::from(n);
            let balance = (1.0 - outside) / (eta * eta * (1.0 - sum));
            assert!((balance - 1.0).abs() < 1e-3, "{eta}: {balance}");
        }
    }

    #[test]
    fn along_the_normal_both_sides_reflect_the_same() {
        let surface = Surface::new(1.4);
        let known = normal_reflectance(1.4) as f32;
        assert!((surface.inner_reflectance(1.0) - known).abs() < 1e-6);
        assert!((surface.outer_reflectance(1.0) - known).abs() < 1e-6);
        assert_eq!(surface.inner_reflectance(0.5), 1.0, "beyond the critical angle");
    }
}
