use super::super::scripted::{Step, scripted};
use super::super::{Millimetres, Range};
use super::*;
use crate::DeviceErrorKind;

fn axis() -> (StageAxis, usize) {
    let range = Range::Linear(Millimetres(0.0), Millimetres(100.0));
    (StageAxis { name: "x".into(), range, park: None }, 0)
}

const GREETING: [Step; 4] = [
    Step::Expect(b"?"),
    Step::Reply(b"<Idle|MPos:1.000,2.000,3.000|FS:0,0>\r\n"),
    Step::Expect(b"$$\n"),
    Step::Reply(b"$13=0\r\n$22=1\r\n$110=500.000\r\nok\r\n"),
];

#[test]
fn lines_are_what_the_manual_says() {
    let status = |line: &[u8]| match parse_message(line).unwrap() {
        Message::Status(status) => status,
        other => panic!("{other:?}"),
    };
    let report = status(b"<Hold:0|WPos:-2.500,0.000,11.000|FS:500,8000|WCO:1.0,2.0,3.0|Pn:PZ>\r");
    assert_eq!(report.activity, Activity::Held);
    assert_eq!(report.places, Places::Work([-2.5, 0.0, 11.0]));
    assert_eq!(report.offset, Some([1.0, 2.0, 3.0]));
    assert_eq!(parse_message(b"ALARM:1\r").unwrap(), Message::Alarm(1));
    assert_eq!(parse_message(b"error:20").unwrap(), Message::Error(20));
    assert_eq!(parse_message(b"$110=500.000").unwrap(), Message::Setting(110, 500.0));
    assert_eq!(parse_message(b"Grbl 1.1h ['$' for help]").unwrap(), Message::Startup);
    assert_eq!(parse_message("[MSG:’$H’|’$X’ to unlock]".as_bytes()).unwrap(), Message::Note);
    assert_eq!(parse_message(b">G54G20:ok").unwrap(), Message::Note);
    for bad in [&b"<Idle>"[..], b"<Idle|MPos:1,2>", b"<Idle|MPos:nan,0,0>", b"error:x", b"okay"] {
        assert!(parse_message(bad).is_err(), "{}", bad.escape_ascii());
    }
}

#[test]
fn a_controller_that_boots_is_waited_for() {
    let mut script = vec![
        Step::Expect(b"?"),
        Step::Reply(b"\r\nGrbl 1.1h ['$' for help]\r\n"),
        Step::Expect(b"?"),
        Step::Reply(b"<Idle|MPos:1.000,2.000,3.000|FS:0,0>\r\n"),
    ];
    script.extend(GREETING.into_iter().skip(2));
    for _ in 0..2 {
        script.push(Step::Expect(b"?"));
        script.push(Step::Reply(b"<Idle|MPos:1.000,2.000,3.000|FS:0,0>\r\n"));
    }
    let mut stage = Grbl::over(scripted(script), vec![axis()]);
    assert_eq!(stage.position(0).unwrap(), Coordinate::Linear(Millimetres(1.0)));
}

#[test]
fn places_outside_of_the_range_are_not_even_sent() {
    let mut stage = Grbl::over(scripted(Vec::new()), vec![axis()]);
    let limit = Duration::from_secs(1);
    for to in [Coordinate::Linear(Millimetres(100.1)), Coordinate::Linear(Millimetres(f64::NAN))] {
        let error = stage.move_to(0, to, limit).unwrap_err();
        assert_eq!(error.kind(), DeviceErrorKind::Unsupported);
    }
    let turn = Coordinate::Rotary(super::super::Degrees(1.0));
    assert_eq!(stage.move_to(0, turn, limit).unwrap_err().kind(), DeviceErrorKind::Unsupported);
    let error = stage.move_to(1, Coordinate::Linear(Millimetres(1.0)), limit).unwrap_err();
    assert_eq!(error.kind(), DeviceErrorKind::Unsupported);
}

/// A controller whose port opens, and which never says a word.
struct Mute;

impl super::super::Connection for Mute {
    fn read(&mut self, _: &mut [u8], wait: Duration) -> std::io::Result<usize> {
        std::thread::sleep(wait);
        Err(std::io::ErrorKind::TimedOut.into())
    }

    fn write(&mut self, _: &[u8], _: Duration) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_silent_controller_is_opened_once_and_the_whole_wait_is_told() {
    let openings = std::sync::Arc::new(std::sync::atomic::AtomicUsize::new(0));
    let counted = std::sync::Arc::clone(&openings);
    let patience =
        Patience { reply: Duration::from_millis(50), attempts: 3, pause: Duration::from_millis(1) };
    let link = Link::new("mute", patience, move |_| {
        counted.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        Ok(Box::new(Mute))
    });
    let error = Grbl::over(link, vec![axis()]).position(0).unwrap_err();
    // The time to start, and that of a reply; not that of the last of many questions.
    let DeviceError::Timeout { waited_s, .. } = error else { panic!("{error}") };
    assert_eq!(waited_s, 3.05);
    assert_eq!(openings.load(std::sync::atomic::Ordering::Relaxed), 1);
}

#[test]
fn a_controller_that_wants_to_be_homed_says_so_and_one_that_cannot_is_at_fault() {
    for (homing, kind) in [
        (&b"$22=1\r\nok\r\n"[..], DeviceErrorKind::NotHomed),
        (b"$22=0\r\nok\r\n", DeviceErrorKind::Fault),
    ] {
        let locked = Step::Reply(b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n");
        let again = Step::Reply(b"<Alarm|MPos:0.000,0.000,0.000|FS:0,0>\r\n");
        let link = scripted(vec![
            Step::Expect(b"?"),
            locked,
            Step::Expect(b"$$\n"),
            Step::Reply(homing),
            Step::Expect(b"?"),
            again,
        ]);
        let error = Grbl::over(link, vec![axis()]).position(0).unwrap_err();
        assert_eq!(error.kind(), kind, "{error}");
    }
}

#[test]
fn an_alarm_names_itself() {
    let mut script = Vec::from(GREETING);
    script.extend([
        Step::Expect(b"?"),
        Step::Reply(b"<Idle|MPos:1.000,2.000,3.000|FS:0,0>\r\n"),
        Step::Expect(b"G21G90G53G0X9.0000\n"),
        Step::Reply(b"ok\r\n"),
        Step::Expect(b"G4P0.01\n"),
        Step::Reply(b"ALARM:1\r\n[MSG:Reset to continue]\r\n"),
    ]);
    let mut stage = Grbl::over(scripted(script), vec![axis()]);
    let to = Coordinate::Linear(Millimetres(9.0));
    let error = stage.move_to(0, to, Duration::from_secs(1)).unwrap_err();
    assert_eq!(error.kind(), DeviceErrorKind::Fault);
    assert!(error.to_string().contains("limit switch"), "{error}");
}

#[test]
fn a_restart_is_not_taken_for_a_place() {
    let mut script = Vec::from(GREETING);
    script.extend([Step::Expect(b"?"), Step::Close]);
    // Opening the port again restarts it; without switches to home to it says that it is idle at 0.
    script.extend([
        Step::Expect(b"?"),
        Step::Reply(b"Grbl 1.1h ['$' for help]\r\n"),
        Step::Expect(b"?"),
        Step::Reply(b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"),
        Step::Expect(b"$$\n"),
        Step::Reply(b"$13=0\r\n$22=0\r\nok\r\n"),
        Step::Expect(b"?"),
        Step::Reply(b"<Idle|MPos:0.000,0.000,0.000|FS:0,0>\r\n"),
    ]);
    let mut stage = Grbl::over(scripted(script), vec![axis()]);
    let error = stage.position(0).unwrap_err();
    assert_eq!(error.kind(), DeviceErrorKind::Fault);
    assert!(error.to_string().contains("restarted"), "{error}");
}
