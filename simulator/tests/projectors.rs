//! Each projector driver against its emulator, over a real TCP port or pseudo-terminal: what it
//! can do, and what becomes of everything that may go wrong on the way.
#![cfg(unix)]

mod common;

use std::time::{Duration, Instant};

use common::PATIENCE;
use rig::DeviceErrorKind;
use rig::devices::{
    Benq, CheckResult, Epson, Fault, Optoma, Part, Pjlink, PowerState, ProjectorControl, Severity,
    power_off, power_on, test_projector_control,
};
use simulator::devices::{
    BenqEmulator, EpsonEmulator, OptomaEmulator, PjlinkEmulator, ProjectorSpec, Prompt,
    SimulatedProjector, Wire, WireFault,
};

/// Nothing here takes as long; whoever comes past it hangs.
const FOR_EVER: Duration = Duration::from_secs(30);

/// What a machine with other things to do may add to any wait.
const SLOW: Duration = Duration::from_secs(5);

fn quick() -> SimulatedProjector {
    let spec = ProjectorSpec {
        warm_up: Duration::from_secs(3),
        cool_down: Duration::from_millis(300),
        lamp_hours: 1234,
    };
    SimulatedProjector::new(spec)
}

/// A driver, what it talks to, and how that calls an input that it has.
struct Bench {
    driver: Box<dyn ProjectorControl>,
    wire: Wire,
    projector: SimulatedProjector,
    input: &'static str,
}

const PROTOCOLS: [&str; 6] =
    ["pjlink", "pjlink with a password", "optoma", "epson", "epson, late prompt", "benq"];

fn bench(protocol: &str) -> Bench {
    bench_of(protocol, quick())
}

/// One that is on already.
fn bright(protocol: &str) -> Bench {
    let spec = ProjectorSpec { warm_up: Duration::ZERO, ..ProjectorSpec::default() };
    let mut projector = SimulatedProjector::new(spec);
    projector.set_power(true).unwrap();
    let mut bench = bench_of(protocol, projector);
    assert_eq!(bench.driver.power_state().unwrap(), PowerState::On, "{protocol}");
    bench
}

fn bench_of(protocol: &str, projector: SimulatedProjector) -> Bench {
    let device = projector.clone();
    match protocol {
        "pjlink" | "pjlink with a password" => {
            let password = protocol.contains("password").then_some("JBMIAProjectorLink");
            let wire = Wire::tcp(0, PjlinkEmulator::new(device, password)).unwrap();
            let port = wire.port().unwrap();
            let driver = Pjlink::new("127.0.0.1", port, password.map(str::to_owned), PATIENCE);
            Bench { driver: Box::new(driver), wire, projector, input: "31" }
        }
        "optoma" => {
            let wire = Wire::serial(OptomaEmulator::new(device)).unwrap();
            let driver = Optoma::new(wire.address(), 9600, 0, PATIENCE);
            Bench { driver: Box::new(driver), wire, projector, input: "15" }
        }
        "epson" | "epson, late prompt" => {
            let prompt = if protocol == "epson" { Prompt::AtOnce } else { Prompt::WhenDone };
            let wire = Wire::serial(EpsonEmulator::new(device, prompt)).unwrap();
            let driver = Epson::new(wire.address(), 9600, PATIENCE);
            Bench { driver: Box::new(driver), wire, projector, input: "30" }
        }
        "benq" => {
            let wire = Wire::serial(BenqEmulator::new(device)).unwrap();
            let driver = Benq::new(wire.address(), 115_200, PATIENCE);
            Bench { driver: Box::new(driver), wire, projector, input: "hdmi" }
        }
        other => panic!("no protocol {other}"),
    }
}

fn switch_on(bench: &mut Bench) -> Vec<PowerState> {
    let mut states = Vec::new();
    power_on(bench.driver.as_mut(), FOR_EVER, &mut |state, _| {
        states.push(state);
        true
    })
    .unwrap();
    states
}

fn for_each_protocol(test: impl Fn(&'static str) + Sync) {
    common::for_each_protocol(&PROTOCOLS, test);
}

#[test]
fn a_projector_is_switched_on_used_and_switched_off() {
    for_each_protocol(|protocol| {
        let mut bench = bench(protocol);
        assert_eq!(bench.driver.power_state().unwrap(), PowerState::Off, "{protocol}");
        let states = switch_on(&mut bench);
        assert_eq!(states.first(), Some(&PowerState::Off), "{protocol}: {states:?}");
        assert!(states.contains(&PowerState::Warming), "{protocol}: {states:?}");
        assert_eq!(states.last(), Some(&PowerState::On), "{protocol}: {states:?}");

        bench.driver.select_input(bench.input).unwrap();
        assert_eq!(bench.projector.input(), bench.input, "{protocol}");
        for mute in [true, false] {
            bench.driver.set_av_mute(mute).unwrap();
            let mut direct = bench.projector.clone();
            assert_eq!(direct.av_mute().unwrap(), Some(mute), "{protocol}");
            let told = bench.driver.av_mute().unwrap();
            assert!(told.is_none_or(|told| told == mute), "{protocol}");
        }
        assert_eq!(bench.driver.lamp_hours().unwrap(), [1234], "{protocol}");
        assert!(
            bench.driver.faults().unwrap().is_none_or(|faults| faults.is_empty()),
            "{protocol}"
        );
        assert!(!bench.driver.name().unwrap().is_empty());
        let checks = test_projector_control(bench.driver.as_mut(), Some(bench.input));
        assert!(checks.iter().all(|c| c.result != CheckResult::Fail), "{protocol}: {checks:?}");

        power_off(bench.driver.as_mut(), FOR_EVER, &mut |_, _| true).unwrap();
        assert_eq!(bench.driver.power_state().unwrap(), PowerState::Off, "{protocol}");
    });
}

#[test]
fn an_answer_that_goes_wrong_once_is_asked_for_again() {
    for_each_protocol(|protocol| {
        for fault in
            [WireFault::Silence, WireFault::Garbage, WireFault::Truncated, WireFault::Disconnect]
        {
            let mut bench = bright(protocol);
            bench.wire.inject(fault);
            let state = bench.driver.power_state();
            assert_eq!(state.unwrap(), PowerState::On, "{protocol}, {fault:?}");
            bench.wire.inject(fault);
            bench.driver.set_av_mute(true).unwrap_or_else(|e| panic!("{protocol}, {fault:?}: {e}"));
            let mut direct = bench.projector.clone();
            assert_eq!(direct.av_mute().unwrap(), Some(true), "{protocol}, {fault:?}");
        }
    });
}

#[test]
fn what_stays_wrong_is_a_named_error_before_long() {
    use DeviceErrorKind as K;
    for_each_protocol(|protocol| {
        for (fault, allowed) in [
            (WireFault::Silence, vec![K::Timeout]),
            (WireFault::Garbage, vec![K::Protocol, K::Timeout]),
            (WireFault::Truncated, vec![K::Timeout, K::Protocol]),
            (WireFault::Disconnect, vec![K::Disconnected, K::NotFound]),
        ] {
            if protocol == "optoma" && fault == WireFault::Truncated {
                // Where replies need no end, the same half again and again looks whole.
                continue;
            }
            let mut bench = bright(protocol);
            for _ in 0..50 {
                bench.wire.inject(fault);
            }
            let started = Instant::now();
            let error = bench.driver.lamp_hours().unwrap_err();
            assert!(allowed.contains(&error.kind()), "{protocol}, {fault:?}: {error}");
            // Three attempts, each of at most a connection and two replies, and two pauses.
            let bound = 3 * 3 * PATIENCE.reply + 4 * PATIENCE.pause + SLOW;
            assert!(started.elapsed() < bound, "{protocol}, {fault:?}");
        }
    });
}

#[test]
fn busy_is_waited_out_or_said() {
    for_each_protocol(|protocol| {
        let mut bench = bright(protocol);
        bench.projector.be_busy(100);
        let error = bench.driver.set_av_mute(true).unwrap_err();
        // Optoma's F and Epson's ERR do not say why.
        let kind = match protocol {
            "optoma" | "epson" | "epson, late prompt" => DeviceErrorKind::Unsupported,
            _ => DeviceErrorKind::Busy,
        };
        assert_eq!(error.kind(), kind, "{protocol}: {error}");
        bench.projector.be_busy(1);
        if kind == DeviceErrorKind::Busy {
            bench.driver.set_av_mute(true).unwrap();
        }
    });
}

#[test]
fn a_lamp_that_does_not_light_ends_the_wait() {
    for_each_protocol(|protocol| {
        let mut bench = bench(protocol);
        bench.projector.break_lamp();
        let limit = Duration::from_secs(7);
        let started = Instant::now();
        let mut states = Vec::new();
        let error = power_on(bench.driver.as_mut(), limit, &mut |state, _| {
            states.push(state);
            true
        })
        .unwrap_err();
        states.dedup();
        // A lamp that failed is not lit again and again: that is what breaks it.
        let lit = states.iter().filter(|&&state| state == PowerState::Warming).count();
        assert!(lit == 1 || protocol == "benq", "{protocol}: {states:?}");
        // BenQ's protocol has no word for it: there it is only never on.
        let kind = match protocol {
            "benq" => DeviceErrorKind::Timeout,
            _ => DeviceErrorKind::Fault,
        };
        assert_eq!(error.kind(), kind, "{protocol}: {error}");
        // The limit, the last question and a poll's pause.
        assert!(started.elapsed() < limit + SLOW, "{protocol}");
    });
}

#[test]
fn faults_are_passed_on() {
    let fault = Fault { part: Part::Temperature, severity: Severity::Warning };
    let mut bench = bench("pjlink");
    bench.projector.report(fault);
    assert_eq!(bench.driver.faults().unwrap(), Some(vec![fault]));
    let mut bench = self::bench("epson");
    bench.projector.report(fault);
    // Epson's codes know errors only.
    let expected = Fault { severity: Severity::Error, ..fault };
    assert_eq!(bench.driver.faults().unwrap(), Some(vec![expected]));
}

#[test]
fn whoever_waits_can_stop() {
    let mut bench = bench("pjlink");
    let error = power_on(bench.driver.as_mut(), FOR_EVER, &mut |_, _| false).unwrap_err();
    assert_eq!(error.kind(), DeviceErrorKind::Declined);
}

#[test]
fn passwords_are_asked_for_and_checked() {
    let wire = Wire::tcp(0, PjlinkEmulator::new(quick(), Some("secret"))).unwrap();
    let port = wire.port().unwrap();
    for password in [None, Some("wrong".to_owned())] {
        let mut driver = Pjlink::new("127.0.0.1", port, password, PATIENCE);
        let error = driver.power_state().unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Declined, "{error}");
    }
    let mut driver = Pjlink::new("127.0.0.1", port, Some("secret".into()), PATIENCE);
    assert_eq!(driver.power_state().unwrap(), PowerState::Off);
}

#[test]
fn a_port_in_use_is_busy_and_one_that_is_not_there_is_not_found() {
    let wire = Wire::serial(EpsonEmulator::new(quick(), Prompt::AtOnce)).unwrap();
    let mut first = Epson::new(wire.address(), 9600, PATIENCE);
    first.power_state().unwrap();
    let mut second = Epson::new(wire.address(), 9600, PATIENCE);
    assert_eq!(second.power_state().unwrap_err().kind(), DeviceErrorKind::Busy);
    drop(first);
    assert_eq!(second.power_state().unwrap(), PowerState::Off);
    let mut nowhere = Epson::new("/dev/there-is-no-such-port", 9600, PATIENCE);
    assert_eq!(nowhere.power_state().unwrap_err().kind(), DeviceErrorKind::NotFound);
    let mut file = Epson::new("/dev/null", 9600, PATIENCE);
    assert_eq!(file.power_state().unwrap_err().kind(), DeviceErrorKind::Unsupported);
}

#[test]
fn the_simulated_projector_needs_no_wire() {
    let mut projector = quick();
    assert_eq!(projector.power_state().unwrap(), PowerState::Off);
    power_on(&mut projector, FOR_EVER, &mut |_, _| true).unwrap();
    let checks = test_projector_control(&mut projector, None);
    assert!(checks.iter().all(|c| c.result == CheckResult::Pass), "{checks:?}");
}
