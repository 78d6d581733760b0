//! A pinhole with radial and tangential distortion: the simulator's own camera and projector
//! model, kept apart from `calibration`'s so that a slip in one is not mirrored in the other.

use glam::{DMat3, DVec2, DVec3};

/// A pinhole device somewhere in the sample frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Pixels a row and rows.
    pub size: [u32; 2],
    /// Focal lengths in pixels.
    pub focal: DVec2,
    /// Principal point in pixels, the centre of the first pixel being (0, 0).
    pub centre: DVec2,
    /// Radial distortion k1, k2.
    pub radial: [f64; 2],
    /// Tangential distortion p1, p2.
    pub tangential: [f64; 2],
    /// Where the pinhole is in the sample frame, mm.
    pub position: DVec3,
    /// Sample frame to device frame (x right, y down, z forward).
    pub rotation: DMat3,
}

impl Lens {
    /// A distortion-free device of `size` pixels at `position` that looks at `target` with its
    /// rows along the projection of `right`, such that one millimetre at the target is
    /// `pixels_per_mm` wide.
    pub fn looking_at(
        size: [u32; 2],
        position: DVec3,
        target: DVec3,
        right: DVec3,
        pixels_per_mm: f64,
    ) -> Self {
        let forward = (target - position).normalize();
        let down = forward.cross(right).normalize();
        let right = down.cross(forward);
        let focal = DVec2::splat(pixels_per_mm * (target - position).length());
        let centre = DVec2::new(f64::from(size[0]) - 1.0, f64::from(size[1]) - 1.0) / 2.0;
        let rotation = DMat3::from_cols(right, down, forward).transpose();
        Self { size, focal, centre, radial: [0.0; 2], tangential: [0.0; 2], position, rotation }
    }

    /// The pixel where a point of the sample frame is seen; None behind the device.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let p = self.rotation * (point - self.position);
        (p.z > 0.0).then(|| self.distort(DVec2::new(p.x, p.y) / p.z) * self.focal + self.centre)
    }

    /// The unit direction, in the sample frame, that a pixel looks along.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        let seen = (pixel - self.centre) / self.focal;
        // Fixed-point iteration: contracts by about the distortion's slope, here below 0.1, so
        // twelve rounds reach double precision.
        let mut ideal = seen;
        for _ in 0..12 {
            ideal += seen - self.distort(ideal);
        }
        self.rotation.transpose() * ideal.extend(1.0).normalize()
    }

    fn distort(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let radial = 1.0 + r2 * (self.radial[0] + r2 * self.radial[1]);
        let [p1, p2] = self.tangential;
        let cross = 2.0 * p.x * p.y;
        p * radial
            + DVec2::new(
                p1 * cross + p2 * (r2 + 2.0 * p.x * p.x),
                p1 * (r2 + 2.0 * p.y * p.y) + p2 * cross,
            )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixel → ray → point → pixel closes to the fixed point's rounding.
    #[test]
    fn rays_and_projections_agree() {
        let mut lens = Lens::looking_at(
            [640, 480],
            DVec3::new(3.0, -5.0, -120.0),
            DVec3::new(9.0, 9.0, 0.0),
            DVec3::X,
            20.0,
        );
        lens.radial = [-0.25, 0.1];
        lens.tangential = [1e-3, -5e-4];
        for pixel in [DVec2::new(0.0, 0.0), DVec2::new(639.0, 100.0), DVec2::new(300.0, 470.0)] {
            let point = lens.position + 97.0 * lens.ray(pixel);
            let again = lens.project(point).unwrap();
            assert!((again - pixel).length() < 1e-9, "{pixel} {again}");
        }
        let middle = lens.project(DVec3::new(9.0, 9.0, 0.0)).unwrap();
        assert!((middle - lens.centre).length() < 1e-9);
    }
}
