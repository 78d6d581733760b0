//! Rigid motions between frames.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Takes points of one frame to another: p' = R p + t, millimetres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// R, row by row; orthonormal with determinant 1.
    pub rotation: [[f64; 3]; 3],
    /// t in millimetres.
    pub translation_mm: [f64; 3],
}

impl Pose {
    /// No motion.
    pub fn identity() -> Self {
        Self::from_rotation_vector([0.0; 3], [0.0; 3])
    }

    /// Rotation by |r| radians about r, then translation by t millimetres.
    pub fn from_rotation_vector(r: [f64; 3], t: [f64; 3]) -> Self {
        Self::from_parts(&Rotation3::new(Vector3::from(r)).into_inner(), &Vector3::from(t))
    }

    /// The rotation as axis times angle, radians.
    pub fn rotation_vector(&self) -> [f64; 3] {
        UnitQuaternion::from_matrix(&self.matrix()).scaled_axis().into()
    }

    /// A point of the first frame in the second.
    pub fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| {
            let [a, b, c] = self.rotation[i];
            a * p[0] + b * p[1] + c * p[2] + self.translation_mm[i]
        })
    }

    /// A direction of the first frame in the second.
    pub fn rotate(&self, d: [f64; 3]) -> [f64; 3] {
        self.rotation.map(|[a, b, c]| a * d[0] + b * d[1] + c * d[2])
    }

    /// The way back.
    pub fn inverse(&self) -> Self {
        let back = self.matrix().transpose();
        Self::from_parts(&back, &-(back * Vector3::from(self.translation_mm)))
    }

    /// First `self`, then `next`.
    pub fn then(&self, next: &Self) -> Self {
        let rotation = next.matrix() * self.matrix();
        let moved = next.apply(self.translation_mm);
        Self::from_parts(&rotation, &Vector3::from(moved))
    }

    /// This pose turned by a small rotation vector about the second frame's axes (radians), then
    /// shifted (mm): exp(turn) R, t + shift.
    pub(crate) fn nudged(&self, step: &[f64; 6]) -> Self {
        let [x, y, z, shift @ ..] = *step;
        let turn = Rotation3::new(Vector3::new(x, y, z)).into_inner();
        let translation = Vector3::from(self.translation_mm) + Vector3::from(shift);
        Self::from_parts(&(turn * self.matrix()), &translation)
    }

    pub(crate) fn from_parts(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        let rotation = std::array::from_fn(|i| std::array::from_fn(|j| rotation[(i, j)]));
        Self { rotation, translation_mm: (*translation).into() }
    }

    fn matrix(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| self.rotation[i][j])
    }
}
