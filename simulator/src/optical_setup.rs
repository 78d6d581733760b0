//! Where camera and projector stand around the sample.

use crate::{Imperfections, Lens, SampleSpec};
use glam::{DVec2, DVec3};
use material::Face;

/// The geometry of a simulated rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpticalSetup {
    /// The camera, in front of the front face.
    pub camera: Lens,
    /// The projector, on the side of the lit face.
    pub projector: Lens,
    /// The lit face.
    pub lit_face: Face,
    /// Size of the block, mm.
    pub block_mm: [f64; 3],
}

/// Share of the camera's height that the block fills.
const FILL: f64 = 0.8;

impl OpticalSetup {
    /// A rig around a sample: a 640 × 480 camera slightly off the axis, a lens-shifted 1024 × 768
    /// projector behind the block (lit from the back) or beside the camera (from the front).
    /// Distances scale with the block.
    pub fn new(sample: &SampleSpec, lit_face: Face, rig: &Imperfections) -> Self {
        let block_mm = sample.solved_grid().size_mm();
        let [width, height, depth] = block_mm;
        let unit = width.max(height);
        let middle = DVec3::new(width / 2.0, height / 2.0, 0.0);
        let per_mm = FILL * 480.0 / unit;
        let mut camera = Lens::looking_at(
            [640, 480],
            middle + unit * DVec3::new(0.25, -0.35, -7.0),
            middle + unit * DVec3::new(0.01, -0.008, 0.0),
            DVec3::new(1.0, 0.02, 0.0),
            per_mm,
        );
        camera.radial = [-0.18, 0.05];
        camera.tangential = [6e-4, -4e-4];

        let (position, target, right) = match lit_face {
            Face::Back => {
                let target = middle + DVec3::Z * depth;
                (target + unit * DVec3::new(-0.3, 0.4, 9.0), target, -DVec3::X)
            }
            Face::Front => (middle + unit * DVec3::new(-3.0, 0.5, -8.5), middle, DVec3::X),
        };
        let mut projector =
            Lens::looking_at([1024, 768], position, target, right, 0.55 * 768.0 / unit);
        // Lens shift: the axis meets the image well off its centre, and the device is turned so
        // that the picture still covers the block.
        let [k1, k2, p1, p2] = rig.projector_distortion;
        (projector.radial, projector.tangential) = ([k1, k2], [p1, p2]);
        projector = shifted(projector, DVec2::from(rig.lens_shift_px), target);
        Self { camera, projector, lit_face, block_mm }
    }
}

/// Moves the principal point by `shift` pixels while `target` stays in the middle of the picture.
fn shifted(lens: Lens, shift: DVec2, target: DVec3) -> Lens {
    let mut out = lens;
    out.centre += shift;
    // Turn the device so that the target is again seen at the old principal point.
    let angle = -shift / lens.focal;
    let turn = glam::DMat3::from_rotation_y(angle.x) * glam::DMat3::from_rotation_x(-angle.y);
    out.rotation = turn * lens.rotation;
    debug_assert!(out.project(target).is_some());
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SampleKind;

    /// Camera and projector see the whole lit face and the whole front face.
    #[test]
    fn the_block_is_in_view() {
        let plain = Imperfections::default();
        // The principal point below the picture, as a projector on a table has it.
        let below = Imperfections { lens_shift_px: [-30.0, 480.0], ..plain.clone() };
        for rig in [plain, below] {
            check_view(rig);
        }
    }

    fn check_view(rig: Imperfections) {
        for kind in [SampleKind::Wax, SampleKind::Marble, SampleKind::Stone] {
            for lit in [Face::Back, Face::Front] {
                let setup = OpticalSetup::new(&SampleSpec { kind, seed: 1 }, lit, &rig);
                let [w, h, d] = setup.block_mm;
                let z = if lit == Face::Back { d } else { 0.0 };
                for (x, y) in [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)] {
                    for (lens, z) in [(setup.camera, 0.0), (setup.projector, z), (setup.camera, d)]
                    {
                        let p = lens.project(DVec3::new(x, y, z)).unwrap();
                        let [sx, sy] = lens.size.map(f64::from);
                        let inside = p.x > 5.0 && p.y > 5.0 && p.x < sx - 6.0 && p.y < sy - 6.0;
                        assert!(inside, "{kind:?} {lit:?} {p}");
                    }
                }
            }
        }
    }
}
