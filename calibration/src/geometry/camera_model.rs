//! The pinhole with lens distortion that cameras and projectors share.
//!
//! Pixel coordinates have pixel centres at integers (the first pixel's centre is (0, 0)).
//! Frames are right-handed, millimetres, x right, y down, z away from the viewer.

use serde::{Deserialize, Serialize};

/// Numbers that describe the inside of a camera: fx, fy, cx, cy, skew, then the distortion.
pub const INTRINSICS: usize = 13;

/// Names of the intrinsics, in the order of [`CameraModel::parameters`].
pub const INTRINSIC_NAMES: [&str; INTRINSICS] =
    ["fx", "fy", "cx", "cy", "skew", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];

/// A camera, or a projector seen as an inverse camera.
///
/// A point (x, y, 1) on the ray goes to pixel (fx·x' + skew·y' + cx, fy·y' + cy), where with
/// r² = x² + y² and the radial factor ρ = (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶)
/// x' = x ρ + 2 p1 x y + p2 (r² + 2x²) and y' = y ρ + p1 (r² + 2y²) + 2 p2 x y (Brown 1966;
/// the quotient is OpenCV's rational model).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraModel {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels; may lie outside the picture (lens-shifted projectors).
    pub cx: f64,
    /// Principal point y, pixels.
    pub cy: f64,
    /// Pixels along x for each unit of y': 0 where rows and columns are at right angles.
    pub skew: f64,
    /// k1, k2, p1, p2, k3, k4, k5, k6.
    pub distortion: [f64; 8],
}

/// Where a point is seen and how that changes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Projection {
    pub pixel: [f64; 2],
    /// ∂pixel/∂point in the device's frame, per mm.
    pub by_point: [[f64; 3]; 2],
    /// ∂pixel/∂intrinsics, in the order of [`CameraModel::parameters`].
    pub by_intrinsics: [[f64; INTRINSICS]; 2],
}

/// The distorted ray and its slopes.
struct Bend {
    at: [f64; 2],
    /// ∂(x', y')/∂(x, y), row by row.
    by_ray: [[f64; 2]; 2],
}

impl CameraModel {
    /// All intrinsics: fx, fy, cx, cy, skew, k1, k2, p1, p2, k3, k4, k5, k6.
    pub fn parameters(&self) -> [f64; INTRINSICS] {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.distortion;
        [self.fx, self.fy, self.cx, self.cy, self.skew, k1, k2, p1, p2, k3, k4, k5, k6]
    }

    /// The camera of `size` = [width, height] pixels with intrinsics in the order of
    /// [`Self::parameters`].
    pub fn from_parameters(size: [usize; 2], parameters: &[f64; INTRINSICS]) -> Self {
        let [fx, fy, cx, cy, skew, distortion @ ..] = *parameters;
        Self { width: size[0], height: size[1], fx, fy, cx, cy, skew, distortion }
    }

    /// A pinhole without distortion.
    pub fn pinhole(size: [usize; 2], focal: [f64; 2], centre: [f64; 2]) -> Self {
        let [width, height] = size;
        let ([fx, fy], [cx, cy]) = (focal, centre);
        Self { width, height, fx, fy, cx, cy, skew: 0.0, distortion: [0.0; 8] }
    }

    /// The pixel that a point in the camera frame (mm) is seen at.
    ///
    /// A point behind the camera (z ≤ 0) has none: NaN.
    pub fn project(&self, point_mm: [f64; 3]) -> [f64; 2] {
        let [x, y, z] = point_mm;
        if z <= 0.0 {
            return [f64::NAN; 2];
        }
        let [x, y] = self.distort([x / z, y / z]);
        [self.fx * x + self.skew * y + self.cx, self.fy * y + self.cy]
    }

    /// As [`Self::project`], with the derivatives; None behind the camera.
    pub(crate) fn project_with_slopes(&self, point_mm: [f64; 3]) -> Option<Projection> {
        let [px, py, z] = point_mm;
        if z.is_nan() || z <= 0.0 {
            return None;
        }
        let [x, y] = [px / z, py / z];
        let Bend { at: [xd, yd], by_ray } = self.bend([x, y]);
        let (r2, xy) = (x * x + y * y, 2.0 * x * y);
        let (numerator, denominator) = self.radial_terms(r2);
        let ratio = numerator / denominator;
        // ∂(x', y') by k1 k2 p1 p2 k3 k4 k5 k6.
        let powers = [r2, r2 * r2, r2 * r2 * r2];
        let up = powers.map(|p| p / denominator);
        let down = powers.map(|p| -p * ratio / denominator);
        let (q, s) = (r2 + 2.0 * x * x, r2 + 2.0 * y * y);
        let bx = [x * up[0], x * up[1], xy, q, x * up[2], x * down[0], x * down[1], x * down[2]];
        let by = [y * up[0], y * up[1], s, xy, y * up[2], y * down[0], y * down[1], y * down[2]];
        let mut by_intrinsics = [[0.0; INTRINSICS]; 2];
        by_intrinsics[0][..5].copy_from_slice(&[xd, 0.0, 1.0, 0.0, yd]);
        by_intrinsics[1][..5].copy_from_slice(&[0.0, yd, 0.0, 1.0, 0.0]);
        for k in 0..8 {
            by_intrinsics[0][5 + k] = self.fx * bx[k] + self.skew * by[k];
            by_intrinsics[1][5 + k] = self.fy * by[k];
        }
        let row = |a: f64, b: f64| [a / z, b / z, -(a * x + b * y) / z];
        let [[xx, xy], [yx, yy]] = by_ray;
        let by_point = [
            row(self.fx * xx + self.skew * yx, self.fx * xy + self.skew * yy),
            row(self.fy * yx, self.fy * yy),
        ];
        let pixel = [self.fx * xd + self.skew * yd + self.cx, self.fy * yd + self.cy];
        Some(Projection { pixel, by_point, by_intrinsics })
    }

    /// The undistorted ray (x, y) of (x, y, 1) that a pixel looks along.
    ///
    /// None where the distortion cannot be inverted (far outside the calibrated field).
    pub fn undistort(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let y = (pixel[1] - self.cy) / self.fy;
        let target = [(pixel[0] - self.cx - self.skew * y) / self.fx, y];
        if self.distortion == [0.0; 8] {
            return Some(target);
        }
        let mut ray = target;
        let enough = 1e-13 * (1.0 + target[0].hypot(target[1]));
        // Newton's iteration doubles its digits each time: 20 rounds mean it never arrives.
        for _ in 0..20 {
            let Bend { at: [x, y], by_ray: [[a, b], [c, d]] } = self.bend(ray);
            let miss = [x - target[0], y - target[1]];
            if miss[0].hypot(miss[1]) < enough {
                return Some(ray);
            }
            let determinant = a * d - b * c;
            // A fold of the distortion: the radius no longer grows with the angle.
            if determinant.is_nan() || determinant <= 1e-6 {
                return None;
            }
            ray[0] -= (d * miss[0] - b * miss[1]) / determinant;
            ray[1] -= (a * miss[1] - c * miss[0]) / determinant;
        }
        let [x, y] = self.distort(ray);
        ((x - target[0]).hypot(y - target[1]) < 1e-9).then_some(ray)
    }

    /// The first pixel, on the rim of the picture, that has no ray or more than one; None where
    /// the distortion can be inverted over the whole picture.
    ///
    /// Looks along the straight way from the principal point out to each of 64 places of the rim:
    /// the distortion must not fold anywhere on it.
    pub fn fold(&self) -> Option<[f64; 2]> {
        let (w, h) = (self.width as f64 - 0.5, self.height as f64 - 0.5);
        let steps = 16;
        let rim = (0..=steps).flat_map(|i| {
            let s = f64::from(i) / f64::from(steps);
            let (x, y) = (-0.5 + s * (w + 0.5), -0.5 + s * (h + 0.5));
            [[x, -0.5], [x, h], [-0.5, y], [w, y]]
        });
        let unfolded = |pixel: &[f64; 2]| {
            self.undistort(*pixel).is_some_and(|ray| {
                (1..=16).all(|i| {
                    let part = f64::from(i) / 16.0;
                    let [[a, b], [c, d]] = self.bend([ray[0] * part, ray[1] * part]).by_ray;
                    a * d - b * c > 0.0
                })
            })
        };
        rim.into_iter().find(|pixel| !unfolded(pixel)).map(|[x, y]| [x.max(0.0), y.max(0.0)])
    }

    /// Numerator and denominator of the radial factor.
    fn radial_terms(&self, r2: f64) -> (f64, f64) {
        let [k1, k2, _, _, k3, k4, k5, k6] = self.distortion;
        (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    }

    fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [_, _, p1, p2, ..] = self.distortion;
        let (r2, xy) = (x * x + y * y, 2.0 * x * y);
        let (numerator, denominator) = self.radial_terms(r2);
        let radial = numerator / denominator;
        [
            x * radial + p1 * xy + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + p2 * xy,
        ]
    }

    fn bend(&self, [x, y]: [f64; 2]) -> Bend {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.distortion;
        let r2 = x * x + y * y;
        let (numerator, denominator) = self.radial_terms(r2);
        let radial = numerator / denominator;
        let rise = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3);
        let fall = k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6);
        // 2 dρ/d(r²).
        let slope = 2.0 * (rise - radial * fall) / denominator;
        let mixed = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let by_ray = [
            [radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, mixed],
            [mixed, radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x],
        ];
        Bend { at: self.distort([x, y]), by_ray }
    }
}
