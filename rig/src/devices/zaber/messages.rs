//! Lines of Zaber's ASCII protocol.

use super::super::ProtocolError;
use super::super::protocol_error::{printable, trimmed};

/// What makes the sum of all bytes between the first character and the `:` zero, modulo 256.
pub(super) fn checksum(body: &[u8]) -> u8 {
    body.iter().fold(0u8, |sum, &b| sum.wrapping_add(b)).wrapping_neg()
}

/// A reply.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// The device in the chain.
    pub device: u8,
    /// Its axis; 0 for all.
    pub axis: u8,
    /// The id of the command, if it had one.
    pub id: Option<u8>,
    /// `OK`, not `RJ`.
    pub accepted: bool,
    /// It moves.
    pub busy: bool,
    /// Two letters, or `--`.
    pub warning: String,
    /// What was asked for, or the reason of a refusal.
    pub data: String,
}

/// One line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Line {
    /// The answer to a command.
    Reply(Reply),
    /// An alert, or a remark.
    Unasked,
}

/// Parses one line, with or without its CR.
///
/// # Errors
/// It is none of the protocol, or its checksum is wrong.
pub fn parse_line(line: &[u8]) -> Result<Line, ProtocolError> {
    const EXPECTED: &str = "@device axis OK|RJ BUSY|IDLE warning data";
    let wrong = || ProtocolError::new(EXPECTED, line);
    let text = printable(EXPECTED, trimmed(line))?;
    let (kind, body) = text.split_at_checked(1).ok_or_else(wrong)?;
    let body = match body.rsplit_once(':') {
        Some((body, sum)) if sum.len() == 2 => {
            let sum = u8::from_str_radix(sum, 16).map_err(|_| wrong())?;
            if sum != checksum(body.as_bytes()) {
                return Err(ProtocolError::new("a line whose checksum is right", line));
            }
            body
        }
        _ => body,
    };
    match kind {
        "@" => parse_reply(body).map(Line::Reply).ok_or_else(wrong),
        "!" | "#" => Ok(Line::Unasked),
        _ => Err(wrong()),
    }
}

fn parse_reply(body: &str) -> Option<Reply> {
    let (device, rest) = body.split_once(' ')?;
    let (axis, rest) = rest.split_once(' ')?;
    let (word, rest) = rest.split_once(' ')?;
    let (id, flag, rest) = match word {
        "OK" | "RJ" => (None, word, rest),
        id => {
            let (flag, rest) = rest.split_once(' ')?;
            (Some(id.parse().ok()?), flag, rest)
        }
    };
    let accepted = match flag {
        "OK" => true,
        "RJ" => false,
        _ => return None,
    };
    let (status, rest) = rest.split_once(' ')?;
    let busy = match status {
        "BUSY" => true,
        "IDLE" => false,
        _ => return None,
    };
    let (warning, data) = rest.split_once(' ').unwrap_or((rest, ""));
    if warning.len() != 2 {
        return None;
    }
    let (device, axis) = (device.parse().ok()?, axis.parse().ok()?);
    let (warning, data) = (warning.to_owned(), data.to_owned());
    Some(Reply { device, axis, id, accepted, busy, warning, data })
}

/// Parses the data of `get pos`: microsteps, with fractions on newer devices.
///
/// # Errors
/// It is no number, or that of several axes.
pub fn parse_position(data: &[u8]) -> Result<f64, ProtocolError> {
    const EXPECTED: &str = "a position in microsteps";
    let text = printable(EXPECTED, data)?;
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(ProtocolError::new(EXPECTED, data)),
    }
}

/// What a warning means that nothing may go on after.
pub(super) fn fault_text(warning: &str) -> Option<String> {
    let text = match warning {
        "FF" => "critical system error",
        "FN" => "a peripheral is not supported",
        "FZ" => "a peripheral is inactive",
        "FH" => "hardware emergency stop",
        "FV" => "over-voltage, or no supply",
        "FO" => "the driver is switched off",
        "FC" => "a current inrush error",
        "FM" => "a motor temperature error",
        "FD" => "the driver is disabled",
        "FQ" => "an encoder error",
        "FI" => "an index error",
        "FA" => "an encoder lost its synchronism",
        "FR" => "driven too hard for too long",
        "FS" => "stalled, and stopped",
        "FT" => "excessive twist",
        "FB" => "a stream left its bounds",
        "FP" => "an interpolated path deviated",
        "FE" => "a limit error",
        other if other.starts_with('F') => "a fault",
        _ => return None,
    };
    Some(format!("{warning}: {text}"))
}
