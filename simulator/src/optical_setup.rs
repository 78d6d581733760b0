//! Where camera and projector stand around the sample.

use crate::{Imperfections, Lens, SampleSpec};
use glam::{DVec2, DVec3};
use material::Face;
use rig::{PixelRect, ReferencePatch};

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

/// Left, top, right and bottom of the reference tile beside the block, in the larger of its sides
/// from its left edge and its middle row.
const TILE: [f64; 4] = [-0.22, -0.1, -0.12, 0.1];
/// Stripes that are printed on the tile, and their share of its reflectance of 0.9.
const STRIPES: (f64, f64) = (5.0, 0.4);

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

impl OpticalSetup {
    /// Left, top, right and bottom of the reference tile, in the plane of the front face, mm.
    fn tile_mm(&self) -> [f64; 4] {
        let [width, height, _] = self.block_mm;
        let unit = width.max(height);
        let [left, top, right, bottom] = TILE.map(|share| share * unit);
        [left, height / 2.0 + top, right, height / 2.0 + bottom]
    }

    /// Share of the light that a point of the front face's plane sends back, or lets through, where
    /// the reference tile is; `None` beside it.
    pub(crate) fn tile_albedo(&self, x: f64, y: f64) -> Option<f64> {
        let [left, top, right, bottom] = self.tile_mm();
        if !(left..right).contains(&x) || !(top..bottom).contains(&y) {
            return None;
        }
        let (stripes, dark) = STRIPES;
        let place = (x - left) / (right - left) * stripes;
        Some(if place.fract() < 0.5 { 0.9 } else { 0.9 * dark })
    }

    /// The reference tile in the projector's picture, with a margin, and in the
    /// camera's, without its edges.
    pub fn reference_patch(&self) -> ReferencePatch {
        let rect = |lens: &Lens, margin: f64| {
            let [left, top, right, bottom] = self.tile_mm();
            let m = margin * (right - left);
            let corners = [
                (left - m, top - m),
                (right + m, top - m),
                (left - m, bottom + m),
                (right + m, bottom + m),
            ];
            let seen = corners.map(|(x, y)| lens.project(DVec3::new(x, y, 0.0)));
            let seen = seen.map(Option::unwrap_or_default);
            let low = seen.into_iter().fold(seen[0], DVec2::min).max(DVec2::ZERO);
            let high = seen.into_iter().fold(seen[0], DVec2::max).max(DVec2::ZERO);
            let [width, height] = lens.size;
            PixelRect {
                x0: (low.x as u32).min(width),
                y0: (low.y as u32).min(height),
                x1: (high.x.ceil() as u32).min(width),
                y1: (high.y.ceil() as u32).min(height),
            }
        };
        ReferencePatch {
            projector_px: rect(&self.projector, 0.15),
            camera_px: rect(&self.camera, -0.15),
        }
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

    /// Camera and projector see the tile, and the light for it does not fall on the block.
    #[test]
    fn the_reference_tile_is_beside_the_block() {
        for kind in [SampleKind::Wax, SampleKind::Marble, SampleKind::Stone] {
            for lit in [Face::Back, Face::Front] {
                let setup = OpticalSetup::new(
                    &SampleSpec { kind, seed: 1 },
                    lit,
                    &Imperfections::default(),
                );
                let patch = setup.reference_patch();
                let [_, h, d] = setup.block_mm;
                for (lens, rect, z) in [
                    (setup.camera, patch.camera_px, 0.0),
                    (setup.projector, patch.projector_px, 0.0),
                    (setup.projector, patch.projector_px, d),
                ] {
                    assert!(rect.fits(lens.size[0], lens.size[1]), "{kind:?} {lit:?} {rect:?}");
                    assert!(rect.x1 - rect.x0 >= 12 && rect.y1 - rect.y0 >= 12, "{rect:?}");
                    // Along the edge that is next to it.
                    for i in 0..=40 {
                        let p = lens.project(DVec3::new(0.0, h * f64::from(i) / 40.0, z)).unwrap();
                        let [x0, y0, x1, y1] = [rect.x0, rect.y0, rect.x1, rect.y1].map(f64::from);
                        let inside = (x0..x1).contains(&p.x) && (y0..y1).contains(&p.y);
                        assert!(!inside, "{kind:?} {lit:?}: {p} in {rect:?}");
                    }
                }
                let seen = |x: u32, y: u32| {
                    let ray = setup.camera.ray(DVec2::new(f64::from(x), f64::from(y)));
                    let point = setup.camera.position + ray * (-setup.camera.position.z / ray.z);
                    setup.tile_albedo(point.x, point.y)
                };
                let c = patch.camera_px;
                for (x, y) in
                    [(c.x0, c.y0), (c.x1 - 1, c.y0), (c.x0, c.y1 - 1), (c.x1 - 1, c.y1 - 1)]
                {
                    assert!(seen(x, y).is_some(), "{kind:?} {lit:?}: {x} {y}");
                }
            }
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
