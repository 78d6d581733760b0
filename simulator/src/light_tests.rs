//! The projector's light as `calibration` measures it, against what the simulator makes it.

use crate::photo_of;
use crate::{ColourWheel, Imperfections, Lamp, ProjectorResponse, ResponseCurve};
use crate::{SampleKind, SampleSpec, SimulatedRig};
use calibration::{
    BurstFrame, NoiseModel, Photo, Response, find_colour_wheel, measure_projector_light, merge,
};
use material::Face;
use rig::{Pattern, Rig, Target};

fn rig(imperfections: Imperfections) -> Rig {
    let sample = SampleSpec { kind: SampleKind::Wax, seed: 5 };
    // Raw pictures, so that nothing stands between the codes and the light.
    let raw = Imperfections { camera_response: ResponseCurve::Linear, ..imperfections };
    SimulatedRig::with(&sample, Face::Front, &raw, crate::Transport::Diffusion).unwrap().rig()
}

/// Frame `number` of a plan.
fn photo(rig: &mut Rig, number: usize, repeat: u32, exposure_s: f64) -> Photo {
    rig.camera.announce(number, repeat);
    photo_of(rig.camera.expose(exposure_s).unwrap(), format!("frame {number}"))
}

fn show(rig: &mut Rig, level: f64) {
    let info = rig.projector.info();
    let image = Pattern::Grey { level }.render(info.width, info.height, None).unwrap();
    rig.projector.show(&image).unwrap();
}

/// Black level, noise and clipping of the raw sensor.
fn noise() -> NoiseModel {
    let sensor = crate::Sensor { curve: ResponseCurve::Linear, ..crate::Sensor::default() };
    NoiseModel {
        black_level: sensor.black_code(),
        read_noise: sensor.read_noise_code(),
        gain: sensor.gain(),
        full_scale: sensor.full_scale(),
        saturation: 0.995 * sensor.full_scale(),
    }
}

#[test]
fn response_and_black_are_what_the_projector_has() {
    let gamma = [2.2, 1.9, 2.4];
    let mut rig = rig(Imperfections {
        projector_response: ProjectorResponse::Gamma(gamma),
        contrast: 400.0,
        ..Imperfections::default()
    });
    rig.bench.place(&Target::FaceSheet { face: Face::Front }).unwrap();
    let mut ramp = Vec::new();
    for i in 0..9 {
        // Levels that 8 bits have.
        let level = (255.0 * f64::from(i) / 8.0_f64).round() / 255.0;
        show(&mut rig, level);
        let times = [1.0 / 30.0, 0.4];
        let frames =
            times.map(|t| Ok::<_, calibration::CalibrationError>((photo(&mut rig, 0, 0, t), t)));
        ramp.push((level, merge(frames, &Response::identity(3), &noise()).unwrap()));
    }
    let found = measure_projector_light(&ramp).unwrap();
    for (channel, gamma) in found.channels.iter().zip(gamma) {
        for (light, (level, _)) in channel.light.iter().zip(&ramp) {
            // 10 000s of pixels of a percent; the merge is unbiased to 0.2 % of the light.
            let truth = level.powf(gamma);
            assert!((light - truth).abs() < 2e-4 + 2e-3 * truth, "{level}: {light} {truth}");
        }
        // The pedestal, and the room's 2e-4 of white (for the sheet's middle).
        let truth = 1.0 / 400.0 + 2e-4;
        assert!((channel.black / truth - 1.0).abs() < 0.03, "{} {truth}", channel.black);
    }
}

#[test]
fn the_colour_wheel_turns_as_fast_as_it_does() {
    let turn_s = 1.0 / 120.0;
    let mut rig =
        rig(Imperfections { wheel: Some(ColourWheel { turn_s }), ..Imperfections::default() });
    rig.bench.place(&Target::FaceSheet { face: Face::Front }).unwrap();
    show(&mut rig, 1.0);
    let mut frames = Vec::new();
    for exposure_s in rig::burst() {
        for repeat in 0..3 {
            let photo = photo(&mut rig, 0, repeat, exposure_s);
            let bright = photo.data.chunks_exact(3).skip(240 * 640 + 200).take(240);
            let sum = bright.fold([0.0; 3], |s, px| {
                std::array::from_fn(|c| {
                    s[c] + (f64::from(px[c]) - noise().black_level) / exposure_s
                })
            });
            frames.push(BurstFrame { exposure_s, radiance: sum.to_vec() });
        }
    }
    let wheel = find_colour_wheel(&frames).unwrap().unwrap();
    eprintln!("turn {:.5} ± {:.5} s", wheel.turn_s, wheel.turn_sigma_s);
    assert!((wheel.turn_s - turn_s).abs() < 4.0 * wheel.turn_sigma_s, "{wheel:?}");
    assert!(wheel.turn_sigma_s < 0.02 * turn_s, "{wheel:?}");
}

#[test]
fn the_lamp_follows_the_plan_and_repeats_have_noise_of_their_own() {
    let lamp = Lamp { trend_per_hour: -0.9, ripple: 0.02, period_s: 40.0 };
    let mut rig = rig(Imperfections { lamp: Some(lamp), ..Imperfections::default() });
    rig.bench.place(&Target::FaceSheet { face: Face::Front }).unwrap();
    show(&mut rig, 1.0);
    let mean = |photo: &Photo| {
        let middle = photo.data.chunks_exact(3).skip(240 * 640 + 200).take(240);
        middle.map(|px| f64::from(px[1]) - noise().black_level).sum::<f64>()
    };
    let first = photo(&mut rig, 0, 0, 1.0 / 30.0);
    for number in [20, 60, 400] {
        let t = 0.5 * number as f64;
        let truth = 1.0 - 0.9 * t / 3600.0 + 0.02 * (std::f64::consts::TAU * t / 40.0).sin();
        let found = mean(&photo(&mut rig, number, 0, 1.0 / 30.0)) / mean(&first);
        // 240 pixels of 10 000 electrons: 0.09 % a frame.
        assert!((found - truth).abs() < 4e-3, "{number}: {found} {truth}");
    }
    // Taken up again, a capture gets the frames that it would have got.
    assert_eq!(photo(&mut rig, 0, 0, 1.0 / 30.0), first);
    assert_ne!(photo(&mut rig, 0, 1, 1.0 / 30.0).data, first.data);
    // No light at all, and light everywhere.
    rig.bench.place(&Target::Dark).unwrap();
    let dark = photo(&mut rig, 0, 0, 1.0);
    let brightest = f64::from(*dark.data.iter().max().unwrap());
    // Dark current of 3 electrons and six sigma of read noise.
    assert!(brightest < noise().black_level + 60.0 * noise().gain, "{brightest}");
    rig.bench.place(&Target::Flat).unwrap();
    let flat = photo(&mut rig, 0, 0, 0.05);
    let (least, most) =
        flat.data.iter().skip(1).step_by(3).fold((u16::MAX, 0), |(l, h), &v| (l.min(v), h.max(v)));
    // The corners lose 2 %, noise is 1 %.
    assert!(f64::from(least) > 0.85 * f64::from(most) && most < 60_000, "{least} {most}");
}
