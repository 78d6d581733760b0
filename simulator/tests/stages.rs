//! Each stage driver against its emulator, over a real pseudo-terminal.
#![cfg(unix)]

mod common;

use std::time::{Duration, Instant};

use common::PATIENCE;
use rig::DeviceErrorKind;
use rig::devices::zaber::ZaberAxis;
use rig::devices::{
    CheckResult, Coordinate, Degrees, Grbl, Millimetres, Range, Stage, StageAxis, Zaber, test_stage,
};
use simulator::devices::{
    GrblEmulator, SimulatedStage, StageFailure, Wire, WireFault, ZaberEmulator,
};

const LIMIT: Duration = Duration::from_secs(20);

fn axes() -> Vec<StageAxis> {
    let slide = Range::Linear(Millimetres(0.0), Millimetres(100.0));
    let turntable = Range::Rotary(Degrees(-180.0), Degrees(180.0));
    let park = Some(Coordinate::Linear(Millimetres(7.5)));
    vec![
        StageAxis { name: "x".into(), range: slide, park },
        StageAxis { name: "turn".into(), range: turntable, park: None },
    ]
}

fn mm(value: f64) -> Coordinate {
    Coordinate::Linear(Millimetres(value))
}

/// One microstep of the Zaber stage.
const STEP: f64 = 0.000_5;

struct Bench {
    driver: Box<dyn Stage>,
    wire: Wire,
    stage: SimulatedStage,
}

const PROTOCOLS: [&str; 2] = ["grbl", "zaber"];

/// A stage that does `speed` mm a second and knows where it is.
fn bench(protocol: &str, speed: f64) -> Bench {
    let stage = SimulatedStage::new(axes(), speed);
    let device = stage.clone();
    let (mut driver, wire): (Box<dyn Stage>, _) = match protocol {
        "grbl" => {
            let wire = Wire::serial(GrblEmulator::new(device)).unwrap();
            let axes = axes().into_iter().zip([0, 1]).collect();
            (Box::new(Grbl::new(wire.address(), 115_200, axes, PATIENCE)), wire)
        }
        "zaber" => {
            let wire = Wire::serial(ZaberEmulator::new(device, STEP)).unwrap();
            let wired = |(axis, device)| ZaberAxis { axis, device, number: 1, step: STEP };
            let wiring = axes().into_iter().zip([1, 2]).map(wired).collect();
            (Box::new(Zaber::new(wire.address(), 115_200, wiring, PATIENCE)), wire)
        }
        other => panic!("no protocol {other}"),
    };
    let lost = driver.position(0).unwrap_err();
    assert_eq!(lost.kind(), DeviceErrorKind::NotHomed, "{protocol}: {lost}");
    driver.home(LIMIT).unwrap();
    Bench { driver, wire, stage }
}

fn for_each_protocol(test: impl Fn(&'static str) + Sync) {
    common::for_each_protocol(&PROTOCOLS, test);
}

#[test]
fn a_stage_goes_where_it_is_sent_and_parks() {
    for_each_protocol(|protocol| {
        let mut bench = bench(protocol, 200.0);
        bench.driver.move_to(0, mm(12.25), LIMIT).unwrap();
        bench.driver.move_to(1, Coordinate::Rotary(Degrees(-33.5)), LIMIT).unwrap();
        // Where it is in truth: GRBL is sent four decimals, Zaber whole microsteps.
        assert!((bench.stage.at(0) - 12.25).abs() < 1e-3, "{protocol}: {}", bench.stage.at(0));
        assert!((bench.stage.at(1) + 33.5).abs() < 1e-3, "{protocol}: {}", bench.stage.at(1));
        assert_eq!(bench.driver.position(0).unwrap(), mm(12.25), "{protocol}");
        let checks = test_stage(bench.driver.as_mut(), LIMIT);
        assert_eq!(checks.len(), 2);
        assert!(checks.iter().all(|c| c.result == CheckResult::Pass), "{protocol}: {checks:?}");
        bench.driver.park(LIMIT).unwrap();
        assert_eq!(bench.stage.at(0), 7.5, "{protocol}");
        bench.driver.home(LIMIT).unwrap();
        assert_eq!(bench.stage.at(0), 0.0, "{protocol}");
    });
}

#[test]
fn a_move_that_takes_too_long_is_stopped_and_keeps_its_place() {
    for_each_protocol(|protocol| {
        let mut bench = bench(protocol, 20.0);
        let error = bench.driver.move_to(0, mm(90.0), Duration::from_millis(300)).unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Timeout, "{protocol}: {error}");
        let stopped = bench.stage.at(0);
        assert!(stopped > 1.0 && stopped < 80.0, "{protocol}: {stopped}");
        std::thread::sleep(Duration::from_millis(100));
        assert_eq!(bench.stage.at(0), stopped, "{protocol}: it goes on");
        let told = bench.driver.position(0).unwrap().value();
        // Three decimals of a report, or half a microstep.
        assert!((told - stopped).abs() < 1e-3, "{protocol}: {told} {stopped}");
        bench.driver.move_to(0, mm(stopped.floor()), LIMIT).unwrap();
    });
}

#[test]
fn hold_and_halt_stop_it() {
    for_each_protocol(|protocol| {
        for hold in [true, false] {
            let mut bench = bench(protocol, 20.0);
            // Somebody else's move, as if another thread had asked for it.
            let mut direct = bench.stage.clone();
            let mover = std::thread::spawn(move || direct.move_to(0, mm(90.0), LIMIT));
            std::thread::sleep(Duration::from_millis(200));
            if hold {
                bench.driver.hold().unwrap()
            } else {
                bench.driver.halt().unwrap()
            }
            mover.join().unwrap().unwrap();
            assert!(bench.stage.at(0) < 80.0, "{protocol}: {}", bench.stage.at(0));
            // A reset while it moves may lose steps, which GRBL says.
            let lost = protocol == "grbl" && !hold;
            assert_eq!(bench.driver.position(0).is_err(), lost, "{protocol}, hold {hold}");
            let after = bench.driver.move_to(0, mm(1.0), LIMIT);
            assert_eq!(after.is_err(), lost, "{protocol}, hold {hold}: {after:?}");
        }
    });
}

#[test]
fn alarms_stay_until_somebody_has_looked() {
    for (protocol, failure, word) in [
        ("grbl", StageFailure::HitLimit, "limit switch"),
        ("zaber", StageFailure::Stall, "stalled"),
    ] {
        let mut bench = bench(protocol, 100.0);
        bench.stage.fail(failure);
        let error = bench.driver.move_to(0, mm(10.0), LIMIT).unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Fault, "{protocol}: {error}");
        assert!(error.to_string().contains(word), "{protocol}: {error}");
        let place = bench.stage.at(0);
        let again = bench.driver.move_to(0, mm(10.0), LIMIT).unwrap_err();
        assert_eq!(again.kind(), DeviceErrorKind::Fault, "{protocol}: {again}");
        assert_eq!(bench.stage.at(0), place, "{protocol}: it moved in spite of the alarm");
        bench.driver.unlock().unwrap();
        bench.driver.move_to(0, mm(10.0), LIMIT).unwrap();
        assert_eq!(bench.stage.at(0), 10.0, "{protocol}");
    }
}

#[test]
fn a_question_that_goes_wrong_once_is_asked_again() {
    for_each_protocol(|protocol| {
        for fault in
            [WireFault::Silence, WireFault::Garbage, WireFault::Truncated, WireFault::Disconnect]
        {
            let mut bench = bench(protocol, 500.0);
            bench.driver.move_to(0, mm(5.0), LIMIT).unwrap();
            bench.wire.inject(fault);
            let at = bench.driver.position(0);
            if protocol == "grbl" && fault == WireFault::Disconnect {
                // The board restarts when its port is opened again, and has lost its place.
                assert_eq!(at.unwrap_err().kind(), DeviceErrorKind::Fault);
            } else {
                assert_eq!(at.unwrap(), mm(5.0), "{protocol}, {fault:?}");
            }
        }
    });
}

#[test]
fn whatever_goes_wrong_in_a_move_has_a_name_and_an_end() {
    use DeviceErrorKind as K;
    for_each_protocol(|protocol| {
        for fault in
            [WireFault::Silence, WireFault::Garbage, WireFault::Truncated, WireFault::Disconnect]
        {
            for count in [1, 3, 50] {
                let mut bench = bench(protocol, 500.0);
                bench.driver.position(0).unwrap();
                for _ in 0..count {
                    bench.wire.inject(fault);
                }
                let started = Instant::now();
                let limit = Duration::from_secs(2);
                match bench.driver.move_to(0, mm(5.0), limit) {
                    // It said so, so it has to be true.
                    Ok(()) => assert_eq!(bench.stage.at(0), 5.0, "{protocol}, {count} {fault:?}"),
                    Err(error) => {
                        let named =
                            [K::Timeout, K::Protocol, K::Disconnected, K::NotFound, K::Fault];
                        let kind = error.kind();
                        assert!(named.contains(&kind), "{protocol}, {count} {fault:?}: {error}");
                    }
                }
                // The limit, stopping past it, and all attempts of the questions around it.
                let bound = limit + Duration::from_secs(40);
                assert!(started.elapsed() < bound, "{protocol}, {count} {fault:?}");
            }
        }
    });
}

#[test]
fn the_simulated_stage_needs_no_wire() {
    let mut stage = SimulatedStage::new(axes(), 200.0);
    let checks = test_stage(&mut stage, LIMIT);
    assert!(checks.iter().all(|c| c.result == CheckResult::Pass), "{checks:?}");
    let error = stage.move_to(0, mm(101.0), LIMIT).unwrap_err();
    assert_eq!(error.kind(), DeviceErrorKind::Unsupported);
    stage.fail(StageFailure::Stall);
    assert_eq!(stage.move_to(0, mm(5.0), LIMIT).unwrap_err().kind(), DeviceErrorKind::Fault);
    stage.unlock().unwrap();
    stage.park(LIMIT).unwrap();
    assert_eq!(stage.at(0), 7.5);
}
