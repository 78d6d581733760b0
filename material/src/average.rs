//! One homogeneous medium for the whole block, for formats that have no voxels.

use crate::ScatteringMedium;

/// Means over the voxels of σa and σs' of one channel, per scene unit: what light meets on
/// average. Veins and layers are lost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Average {
    /// Absorption.
    pub sigma_a: f64,
    /// Reduced scattering.
    pub sigma_s: f64,
}

impl Average {
    /// Of each channel.
    pub fn of(medium: &ScatteringMedium<'_>) -> Vec<Self> {
        let material = medium.material();
        let voxels = material.grid().len();
        let mean = |c: usize| {
            let sum = (0..voxels).map(|i| medium.sigma(c, i));
            let (a, s) = sum.fold((0.0, 0.0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
            Self { sigma_a: a / voxels as f64, sigma_s: s / voxels as f64 }
        };
        (0..material.channels().len()).map(mean).collect()
    }

    /// Of three channels, or one thrice.
    pub(crate) fn colours(medium: &ScatteringMedium<'_>) -> [Self; 3] {
        let of = Self::of(medium);
        // A medium has at least one channel.
        std::array::from_fn(|c| of[c.min(of.len() - 1)])
    }

    /// σt.
    pub fn sigma_t(&self) -> f64 {
        self.sigma_a + self.sigma_s
    }

    /// Of single scattering.
    pub fn albedo(&self) -> f64 {
        self.sigma_s / self.sigma_t()
    }

    /// Albedo of multiple scattering: the share of light that a half-space sends back, which is
    /// how artists' materials are told what scatters. The inverse of 1 − (4.09712 + 4.20863 A −
    /// √(9.59217 + 41.6808 A + 17.7126 A²))² (Kulla and Conty 2017, as KHR_materials_volume_scatter
    /// and OpenPBR have it), which rises with A.
    pub fn multiple_albedo(&self) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if single_albedo(middle) < self.albedo() { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }
}

/// The albedo of single scattering to one of multiple scattering.
fn single_albedo(multiple: f64) -> f64 {
    let root = (9.59217 + 41.6808 * multiple + 17.7126 * multiple * multiple).sqrt();
    let s = 4.09712 + 4.20863 * multiple - root;
    1.0 - s * s
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fit's ends are at 0.00005 and 0.0005 from 0 and 1, by its rounded numbers.
    #[test]
    fn multiple_scattering_is_the_fit_turned_round() {
        for albedo in [0.1, 0.5, 0.9, 0.99, 0.999] {
            let average = Average { sigma_a: 1.0 - albedo, sigma_s: albedo };
            let multiple = average.multiple_albedo();
            assert!((single_albedo(multiple) - albedo).abs() < 1e-9, "{albedo}: {multiple}");
            assert!(multiple < albedo);
        }
        let white = Average { sigma_a: 0.0, sigma_s: 1.0 };
        assert!(white.multiple_albedo() > 0.99);
    }
}
