//! The standard acquisition and the plan as a file.

use material::Face;
use rig::{
    Acquisition, CameraInfo, Chessboard, Pattern, PhaseShift, Plan, PlanError, PlanWarning,
    ProjectorMethod, Purpose, SMatrix, SampleScheme, Target, Timing, bracket,
};

fn standard(lit_face: Face) -> Acquisition {
    Acquisition {
        projector_method: ProjectorMethod::default(),
        projector_px: [1024, 768],
        ramp_levels: 52,
        lit_face,
        regions: [4, 4],
        scheme: SampleScheme::Regions,
        bracket_s: bracket(1.0 / 30.0, 8.0, 9),
        reference_bracket_s: vec![0.1, 1.0],
        response_bracket_s: vec![0.1, 0.25, 1.0],
        board_exposure_s: 0.1,
        poses: 6,
        projector_board: Chessboard { columns: 9, rows: 6, square_px: 64, x0: 100, y0: 80 },
        repeats: 1,
    }
}

#[test]
fn the_standard_bracket_runs_from_a_thirtieth_to_eight_seconds_in_equal_stops() {
    let times = bracket(1.0 / 30.0, 8.0, 9);
    assert_eq!((times.len(), times[0], times[8]), (9, 1.0 / 30.0, 8.0));
    let step = 240_f64.log2() / 8.0;
    for pair in times.windows(2) {
        // Rounding of one power and one quotient.
        assert!(((pair[1] / pair[0]).log2() - step).abs() < 1e-12);
    }
    assert_eq!(bracket(0.5, 8.0, 1), [0.5]);
}

#[test]
fn the_standard_plans_are_sound_and_survive_files() {
    for face in [Face::Front, Face::Back] {
        let acquisition = standard(face);
        let coded = |projector_method| Acquisition { projector_method, ..acquisition.clone() };
        let phase = PhaseShift { period_px: 32, steps: 4 };
        let multiplexed = Acquisition { scheme: SampleScheme::Multiplexed, ..acquisition.clone() };
        for plan in [
            acquisition.calibration_plan(),
            acquisition.capture_plan(),
            multiplexed.capture_plan(),
            acquisition.light_plan(),
            acquisition.noise_plan(),
            coded(ProjectorMethod::GrayCode).calibration_plan(),
            coded(ProjectorMethod::PhaseShift(phase)).calibration_plan(),
        ] {
            plan.check().unwrap();
            assert!(plan.warnings(None).is_empty());
            let toml = toml::to_string(&plan).unwrap();
            assert_eq!(toml::from_str::<Plan>(&toml).unwrap(), plan);
            let json = serde_json::to_string(&plan).unwrap();
            assert_eq!(serde_json::from_str::<Plan>(&json).unwrap(), plan);
        }
    }
}

/// What all pictures together light, on a grid of its own, is what the matrix says.
#[test]
fn a_multiplexed_plan_lights_the_regions_that_the_matrix_tells() {
    let acquisition = Acquisition { scheme: SampleScheme::Multiplexed, ..standard(Face::Back) };
    let plan = acquisition.capture_plan();
    let shots: Vec<_> = plan.shots.iter().filter(|s| s.purpose == Purpose::Fit).collect();
    let matrix = SMatrix::for_regions(16);
    assert_eq!(shots.len(), matrix.order());
    assert_eq!(plan.shots[0].name, rig::BLACK_SHOT);
    for (row, shot) in shots.iter().enumerate() {
        let cells = shot.pattern.coverage(4, 4).unwrap();
        for (region, lit) in cells.iter().enumerate() {
            let expected = if matrix.lights(row, region) { 1.0 } else { 0.0 };
            assert_eq!(*lit, expected, "{} region {region}", shot.name);
        }
    }
}

#[test]
fn a_code_takes_the_chessboards_place_in_every_pose() {
    let chessboards = standard(Face::Back);
    let codes = Acquisition { projector_method: ProjectorMethod::GrayCode, ..chessboards.clone() };
    let plan = codes.calibration_plan();
    for pose in 0..6 {
        let on_sheet = plan.shots.iter().filter(|s| s.target == Target::Sheet { pose });
        let names: Vec<_> = on_sheet.map(|s| s.name.clone()).collect();
        assert_eq!(names, (0..42).map(|i| rig::code_shot(pose, i)).collect::<Vec<_>>());
    }
    // The sheet stays on the board for all of them: no more placements than for a chessboard.
    let info = CameraInfo { name: "c".into(), width: 8, height: 8, channels: 3, bit_depth: 16 };
    let placements = |plan: Plan| plan.summary(&info, &Timing::default()).placements;
    assert_eq!(placements(plan), placements(chessboards.calibration_plan()));
    let ramp = codes.ramp();
    assert_eq!((ramp.len(), ramp[0], ramp[51]), (52, 0.0, 1.0));
}

#[test]
fn what_is_lit_in_the_fit_is_kept_apart_from_what_checks_it() {
    let plan = standard(Face::Back).capture_plan();
    let of = |purpose| plan.shots.iter().filter(move |s| s.purpose == purpose);
    assert_eq!(of(Purpose::Fit).count(), 16);
    assert!(of(Purpose::HeldOut).count() >= 3);
    for held in of(Purpose::HeldOut) {
        assert!(of(Purpose::Fit).all(|fit| fit.pattern != held.pattern), "{}", held.name);
    }
    // The regions together light the whole face once.
    let mut total = vec![0.0; 30 * 20];
    for shot in of(Purpose::Fit) {
        let cells = shot.pattern.coverage(30, 20).unwrap();
        total.iter_mut().zip(cells).for_each(|(t, c)| *t += c);
    }
    assert!(total.iter().all(|t| (t - 1.0).abs() < 1e-5));
}

/// From the front the whole face says nothing of multiple scattering and is for the surface; from
/// behind there is no such picture, and the plans are alike in all else.
#[test]
fn only_a_front_lit_plan_has_a_picture_for_the_surface() {
    let [front, back] = [Face::Front, Face::Back].map(|face| standard(face).capture_plan());
    let named = |plan: &Plan| {
        let of = plan.shots.iter().filter(|s| s.purpose == Purpose::Surface);
        of.map(|s| (s.name.clone(), s.pattern.clone())).collect::<Vec<_>>()
    };
    assert_eq!(named(&front), [(rig::FULL_FACE_SHOT.to_owned(), Pattern::full_face())]);
    assert_eq!(named(&back), []);
    // Frames of sessions from before the purpose was told apart are those that are asked for now.
    for (front, back) in front.shots.iter().zip(&back.shots) {
        assert_eq!((&front.name, &front.pattern), (&back.name, &back.pattern));
        assert_eq!(front.exposures_s, back.exposures_s);
    }
    assert_eq!(front.shots.len(), back.shots.len());
}

#[test]
fn the_summary_counts_frames_time_and_space() {
    let camera =
        CameraInfo { name: "c".into(), width: 1000, height: 500, channels: 3, bit_depth: 14 };
    let plan = standard(Face::Back).capture_plan();
    let summary = plan.summary(&camera, &Timing::default());
    assert_eq!((summary.shots, summary.frames, summary.placements), (22, 198, 1));
    assert_eq!(summary.bytes, 198 * 3_000_000);
    let bracket_s: f64 = bracket(1.0 / 30.0, 8.0, 9).iter().sum();
    assert!((summary.exposure_s - 22.0 * bracket_s).abs() < 1e-9);
    assert!(summary.estimated_s > summary.exposure_s + 60.0);
    // Board, sheet, board, sheet, ..., two planes, the chart and the white sheet; one frame each
    // of boards and planes, three for the response, two of chart and sheet with light and without.
    let calibration = standard(Face::Back).calibration_plan().summary(&camera, &Timing::default());
    assert_eq!((calibration.frames, calibration.placements), (12 + 2 + 3 + 4 * 2, 12 + 2 + 1 + 1));
}

#[test]
fn unsound_plans_are_refused_by_name() {
    let good = standard(Face::Front).capture_plan();
    let refused = |change: &dyn Fn(&mut Plan)| {
        let mut plan = good.clone();
        change(&mut plan);
        plan.check().unwrap_err()
    };
    assert_eq!(refused(&|p| p.shots.clear()), PlanError::Empty);
    for name in ["../x", "", "a/b", "Black", "-a", &"a".repeat(61)] {
        assert_eq!(refused(&|p| p.shots[0].name = name.into()), PlanError::Name(name.into()));
    }
    assert_eq!(
        refused(&|p| p.shots[0].name = "region-01".into()),
        PlanError::SameName("region-01".into())
    );
    assert!(matches!(refused(&|p| p.shots[3].exposures_s.clear()), PlanError::Exposures { .. }));
    assert!(matches!(
        refused(&|p| p.shots[3].exposures_s[0] = f64::NAN),
        PlanError::Exposures { .. }
    ));
    assert!(matches!(refused(&|p| p.shots[3].repeats = 0), PlanError::Repeats(_)));
    let message = refused(&|p| p.shots[3].pattern = Pattern::Grey { level: 2.0 }).to_string();
    assert!(message.contains("region-03") && message.contains('2'), "{message}");

    let mut short = good.clone();
    short.shots[1].exposures_s[0] = 1.0 / 60.0;
    assert!(
        matches!(&short.warnings(None)[..], [PlanWarning::ShortExposure { shot, .. }] if shot == "region-01")
    );
}

#[test]
fn exposures_that_end_within_a_turn_of_the_wheel_are_told() {
    let mut plan = standard(Face::Back).capture_plan();
    let turn_s = 1.0 / 120.0;
    let whole = |t: &f64| (t / turn_s).round() * turn_s;
    for shot in &mut plan.shots {
        shot.exposures_s = shot.exposures_s.iter().map(whole).collect();
    }
    assert!(plan.warnings(Some(turn_s)).is_empty());
    // Half a turn is an eighth of a thirtieth of a second, and nothing of eight seconds.
    plan.shots[2].exposures_s[8] += 0.5 * turn_s;
    assert!(plan.warnings(Some(turn_s)).is_empty());
    plan.shots[1].exposures_s[0] += 0.5 * turn_s;
    let told = plan.warnings(Some(turn_s));
    assert!(matches!(&told[..], [PlanWarning::PartialTurn { shot, .. }] if shot == "region-01"));
    assert!(told[0].to_string().contains("37.50 ms"), "{}", told[0]);
}

/// The words of the file are a contract.
#[test]
fn a_plan_reads_like_this() {
    let text = r#"
        [[shots]]
        name = "face-board-back"
        purpose = "held-out"
        exposures_s = [0.1, 1]
        repeats = 2
        target = { kind = "face-board", face = "back" }
        pattern = { kind = "face", rectangles = [{ x0 = 0, y0 = 0.25, x1 = 1, y1 = 0.5, level = 1 }] }

        [[shots]]
        name = "board"
        purpose = "geometry"
        exposures_s = [0.1]
        repeats = 1
        target = { kind = "sheet", pose = 3 }
        pattern = { kind = "chessboard", columns = 9, rows = 6, square_px = 40, x0 = 1, y0 = 2 }
    "#;
    let plan: Plan = toml::from_str(text).unwrap();
    plan.check().unwrap();
    assert_eq!(plan.shots[0].target, Target::FaceBoard { face: Face::Back });
    assert_eq!(plan.shots[1].target, Target::Sheet { pose: 3 });
    assert!(toml::from_str::<Plan>(&text.replace("repeats", "repeat")).is_err());
    assert!(toml::from_str::<Plan>(&text.replace("rows = 6", "rows = 6, colour = 1")).is_err());
}
