//! Sub-pixel corners: each in a window of its own.

use opencv::core::{Mat, Size, TermCriteria};
use opencv::imgproc;

use crate::cv;

/// Blur before refinement, pixels: edges sharper than the pixels are aliased, and the refinement
/// takes the jags for the edge (0.178 px against 0.174 px on real views, 0.099 against 0.072 on
/// rendered ones, which no lens has softened).
const SOFTENING_PX: f64 = 1.0;

/// The picture that [`refine`] works in.
pub(crate) fn soften(grey: &Mat) -> opencv::Result<Mat> {
    let mut soft = Mat::default();
    let (sigma, border) = (SOFTENING_PX, opencv::core::BORDER_REPLICATE);
    imgproc::gaussian_blur(grey, &mut soft, Size::default(), sigma, sigma, border)?;
    Ok(soft)
}

/// Gradient-orthogonality refinement (Förstner), in a window of `half` pixels to each side: large
/// enough to average noise, small enough never to see the neighbouring corner. None where the
/// refinement left its window: it has followed something else.
pub(crate) fn refine(soft: &Mat, corner: [f64; 2], half: i32) -> opencv::Result<Option<[f64; 2]>> {
    let mut point = cv::points_f32(&[corner]);
    imgproc::corner_sub_pix(
        soft,
        &mut point,
        Size::new(half, half),
        Size::new(-1, -1),
        TermCriteria::new(3, 100, 1e-4)?,
    )?;
    let moved = cv::points_from(&point).first().copied().unwrap_or(corner);
    let inside = (moved[0] - corner[0]).hypot(moved[1] - corner[1]) <= f64::from(half);
    Ok(inside.then_some(moved))
}
