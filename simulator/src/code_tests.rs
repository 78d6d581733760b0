//! A code shown by the simulated projector and read from the simulated camera's pictures, against
//! the simulator's own geometry.

use crate::photo_of;
use crate::targets::{FlatTarget, square_mm};
use crate::{BOARD_COLUMNS, BOARD_ROWS, Imperfections, SampleKind, SampleSpec, SimulatedRig};
use calibration::{CodeLayout, Photo, decode, light_corners};
use material::Face;
use rig::{CodeSequence, PhaseShift, Target};

/// Shows a code on the sheet over the board in a pose, and returns for each of the board's corners
/// how far off its projector pixel is, and the 1-sigma that is claimed.
fn misses(lit: Face, phase: Option<PhaseShift>, imperfections: &Imperfections) -> Vec<(f64, f64)> {
    let sample = SampleSpec { kind: SampleKind::Wax, seed: 3 };
    let simulated =
        SimulatedRig::with(&sample, lit, imperfections, crate::Transport::Diffusion).unwrap();
    let setup = simulated.truth().setup;
    let mut rig = simulated.rig();
    let target = Target::Sheet { pose: 1 };
    rig.bench.place(&target).unwrap();
    let [width, height] = setup.projector.size;
    let patterns = CodeSequence { projector: setup.projector.size, phase }.patterns();
    let photo = |(i, pattern): (usize, &rig::Pattern)| {
        rig.projector.show(&pattern.render(width, height, None).unwrap()).unwrap();
        rig.camera.announce(i, 0);
        photo_of(rig.camera.expose(1.0 / 30.0).unwrap(), format!("{pattern:?}"))
    };
    let pictures: Vec<Photo> = patterns.iter().enumerate().map(photo).collect();
    let projector = setup.projector.size.map(|n| n as usize);
    let mut layout = match phase {
        None => CodeLayout::gray_code(projector),
        Some(p) => {
            CodeLayout::phase_shift(projector, p.period_px as usize, p.steps as usize).unwrap()
        }
    };
    if lit == Face::Back {
        layout = layout.lit_from_behind();
    }
    let decoded = decode(&layout, &pictures).unwrap();
    let flat = FlatTarget::new(&target, &setup).unwrap();
    let square = square_mm(&setup);
    let place = |i: usize| {
        let [x, y] = [i % BOARD_COLUMNS, i / BOARD_COLUMNS].map(|n| n as f64 * square);
        flat.origin + flat.axes[0] * x + flat.axes[1] * y
    };
    let corners: Vec<_> = (0..BOARD_COLUMNS * BOARD_ROWS).map(place).collect();
    let seen: Vec<[f64; 2]> =
        corners.iter().map(|&c| setup.camera.project(c).unwrap().to_array()).collect();
    let miss = |(found, corner): (&Option<calibration::LitCorner>, &glam::DVec3)| {
        let found = found.unwrap();
        let truth = setup.projector.project(*corner).unwrap();
        ((found.pixel[0] - truth.x).hypot(found.pixel[1] - truth.y), found.sigma_px)
    };
    light_corners(&decoded, &seen).iter().zip(&corners).map(miss).collect()
}

fn rms(misses: &[(f64, f64)]) -> f64 {
    (misses.iter().map(|m| m.0 * m.0).sum::<f64>() / misses.len() as f64).sqrt()
}

#[test]
fn gray_code_through_a_sheet_lit_from_behind() {
    // The principal point below the picture, an input that is no light, a wheel that turns in
    // whole turns.
    let rig = Imperfections {
        lens_shift_px: [-30.0, 450.0],
        projector_response: crate::ProjectorResponse::Gamma([2.2, 2.1, 2.3]),
        wheel: Some(crate::ColourWheel { turn_s: 1.0 / 120.0 }),
        ..Imperfections::default()
    };
    let misses = misses(Face::Back, None, &rig);
    assert_eq!(misses.len(), 54);
    let rms = rms(&misses);
    eprintln!("gray code, lit from behind: {rms:.4} px");
    // Three rays see an edge to a tenth of a pixel; a window holds a thousand places on edges.
    assert!(rms < 0.01, "{rms}");
}

#[test]
fn phase_shift_on_a_sheet_lit_from_the_front() {
    let phase = PhaseShift { period_px: 32, steps: 4 };
    let misses = misses(Face::Front, Some(phase), &Imperfections::default());
    let rms = rms(&misses);
    eprintln!("phase shift, lit from the front: {rms:.4} px");
    // The camera's curve bends the sinusoid: four steps are blind to its second harmonic, and a
    // third of one percent is 0.05 px at most within a period, little in the mean.
    assert!(rms < 0.02, "{rms}");
}
