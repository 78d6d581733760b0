//! Lines that GRBL 1.1 sends.

use super::super::protocol_error::trimmed;
use super::ProtocolError;

/// What the controller is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// Nothing.
    Idle,
    /// Moving, or slowing down.
    Moving,
    /// Held, and at rest.
    Held,
    /// Locked.
    Alarm,
    /// Door, check mode, sleep.
    Other,
}

/// Where X, Y and Z are, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Places {
    /// In machine coordinates.
    Machine([f64; 3]),
    /// In work coordinates: machine less offset.
    Work([f64; 3]),
}

/// A status report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Status {
    /// What it is doing.
    pub activity: Activity,
    /// Where it is.
    pub places: Places,
    /// Offset of the work coordinates, mm; only now and then.
    pub offset: Option<[f64; 3]>,
}

/// One line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// Nothing.
    Blank,
    /// A line was understood.
    Ok,
    /// A line was refused.
    Error(u16),
    /// It stopped itself.
    Alarm(u16),
    /// It has just started.
    Startup,
    /// The answer to `?`.
    Status(Status),
    /// One of the answers to `$$`: number and value.
    Setting(u16, f64),
    /// News that nobody has to act on.
    Note,
}

/// Parses one line, with or without its CR.
///
/// # Errors
/// It is no line that GRBL sends.
pub fn parse_message(line: &[u8]) -> Result<Message, ProtocolError> {
    let wrong = || ProtocolError::new("a line of GRBL 1.1", line);
    // Feedback may quote anything, also what is not ASCII.
    let text = trimmed(line);
    match text {
        [] => return Ok(Message::Blank),
        [b'[', .., b']'] | [b'>', ..] => return Ok(Message::Note),
        _ => {}
    }
    let text = std::str::from_utf8(text).map_err(|_| wrong())?;
    if text == "ok" {
        return Ok(Message::Ok);
    }
    if let Some(number) = text.strip_prefix("error:") {
        return number.parse().map(Message::Error).map_err(|_| wrong());
    }
    if let Some(number) = text.strip_prefix("ALARM:") {
        return number.parse().map(Message::Alarm).map_err(|_| wrong());
    }
    if text.starts_with("Grbl ") {
        return Ok(Message::Startup);
    }
    if let Some(report) = text.strip_prefix('<').and_then(|t| t.strip_suffix('>')) {
        return parse_status(report).map(Message::Status).ok_or_else(wrong);
    }
    if let Some((number, value)) = text.strip_prefix('$').and_then(|t| t.split_once('=')) {
        // Start-up lines, $N0=…, hold G-code.
        if number.starts_with('N') {
            return Ok(Message::Note);
        }
        let number = number.parse().map_err(|_| wrong())?;
        let value: f64 = value.parse().map_err(|_| wrong())?;
        return Ok(Message::Setting(number, value));
    }
    Err(wrong())
}

fn parse_status(report: &str) -> Option<Status> {
    let mut fields = report.split('|');
    let activity = parse_activity(fields.next()?)?;
    let mut places = None;
    let mut offset = None;
    for field in fields {
        // Fields that are not known belong to later versions.
        match field.split_once(':')? {
            ("MPos", at) => places = Some(Places::Machine(parse_places(at)?)),
            ("WPos", at) => places = Some(Places::Work(parse_places(at)?)),
            ("WCO", at) => offset = Some(parse_places(at)?),
            _ => {}
        }
    }
    Some(Status { activity, places: places?, offset })
}

fn parse_activity(text: &str) -> Option<Activity> {
    Some(match text {
        "Idle" => Activity::Idle,
        "Run" | "Jog" | "Home" | "Hold:1" => Activity::Moving,
        "Hold" | "Hold:0" => Activity::Held,
        "Alarm" => Activity::Alarm,
        "Check" | "Sleep" => Activity::Other,
        door if door.starts_with("Door") => Activity::Other,
        _ => return None,
    })
}

/// Three numbers, or more for machines with more axes.
fn parse_places(text: &str) -> Option<[f64; 3]> {
    let mut numbers = text.split(',').map(|number| number.parse::<f64>().ok());
    let mut next = || numbers.next().flatten().filter(|v| v.is_finite());
    Some([next()?, next()?, next()?])
}

/// What an alarm means.
pub fn alarm_text(number: u16) -> String {
    let text = match number {
        1 => "a limit switch was hit; the place is probably lost",
        2 => "a move would have left the machine's travel (soft limit); the place is kept",
        3 => "it was reset while it moved; the place is probably lost",
        4 | 5 => "a probe failed",
        6 => "homing was interrupted by a reset",
        7 => "homing was interrupted by the safety door",
        8 => "homing did not get clear of the limit switch",
        9 => "homing did not find the limit switch",
        _ => "the alarm is not one of GRBL 1.1",
    };
    format!("alarm {number}: {text}")
}

/// What a refused line is refused for.
pub fn error_text(number: u16) -> String {
    let text = match number {
        1 => "no letter where one is due",
        2 => "not a number",
        3 => "no such $ command",
        5 => "homing is switched off",
        8 => "not while it is busy",
        9 => "locked by an alarm, or jogging",
        10 => "soft limits need homing",
        11 => "the line is too long",
        13 => "the safety door is open",
        15 => "beyond the machine's travel",
        20 => "no such G-code",
        22 => "no feed rate",
        33 => "no such target",
        _ => "see GRBL's list of errors",
    };
    format!("error {number}, {text}")
}
