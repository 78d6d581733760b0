//! How far the images determine a material.

/// The finest detail of one channel that its images determine, for every voxel, in mm: finer detail
/// comes from the smoothness that was asked for. A lower bound; infinite where no patch that the
/// block has room for is determined.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resolution {
    /// Of κ.
    pub kappa_mm: Vec<f32>,
    /// Of μ.
    pub mu_mm: Vec<f32>,
}
