//! What Optoma projectors send.

use super::super::ProtocolError;
use super::super::protocol_error::{digits, trimmed};

/// What an Optoma projector sends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// `P`: an order was taken.
    Pass,
    /// `F`: it was not, or a question was not understood.
    Fail,
    /// `OK` and what was asked for.
    Value(Vec<u8>),
    /// `INFO` and a digit: 0 stand-by, 1 warming up, 2 cooling down, 3 out of range, 4 lamp,
    /// 6 fan, 7 too hot, 8 lamp nearly used up, 9 cover open.
    Info(u8),
}

/// Parses what came until the line fell quiet: announcements and an answer may follow each other
/// without anything between.
///
/// # Errors
/// It is anything else.
pub fn parse_messages(bytes: &[u8]) -> Result<Vec<Message>, ProtocolError> {
    let wrong = || ProtocolError::new("P, F, OK and a value, or INFO and a digit", bytes);
    let mut rest = trimmed(bytes);
    let mut messages = Vec::new();
    while !rest.is_empty() {
        if let Some(tail) = strip_word(rest, b"INFO") {
            let (&digit, tail) = tail.split_first().ok_or_else(wrong)?;
            if !digit.is_ascii_digit() {
                return Err(wrong());
            }
            messages.push(Message::Info(digit - b'0'));
            rest = tail;
        } else if let Some(tail) = strip_word(rest, b"OK") {
            // Digits, letters of firmware versions, and nothing that looks like an announcement.
            let length = (0..tail.len())
                .find(|&i| tail.get(i..).is_some_and(|t| strip_word(t, b"INFO").is_some()))
                .unwrap_or(tail.len());
            let (value, tail) = tail.split_at_checked(length).ok_or_else(wrong)?;
            let good = |b: &u8| b.is_ascii_alphanumeric() || b"./- ".contains(b);
            if value.is_empty() || !value.iter().all(good) {
                return Err(wrong());
            }
            messages.push(Message::Value(trimmed(value).to_vec()));
            rest = tail;
        } else {
            messages.push(match rest.first() {
                Some(b'P') => Message::Pass,
                Some(b'F') => Message::Fail,
                _ => return Err(wrong()),
            });
            rest = rest.get(1..).unwrap_or_default();
        }
        rest = rest.trim_ascii_start();
    }
    Ok(messages)
}

/// `bytes` after `word`, in whatever case.
fn strip_word<'a>(bytes: &'a [u8], word: &[u8]) -> Option<&'a [u8]> {
    let (head, tail) = bytes.split_at_checked(word.len())?;
    head.eq_ignore_ascii_case(word).then_some(tail)
}

/// Parses the value of `124 1`.
///
/// # Errors
/// It is neither 0 nor 1.
pub fn parse_switch(value: &[u8]) -> Result<bool, ProtocolError> {
    match value {
        b"0" => Ok(false),
        b"1" => Ok(true),
        _ => Err(ProtocolError::new("0 or 1", value)),
    }
}

/// Parses lamp hours.
///
/// # Errors
/// They are not one to five digits.
pub fn parse_hours(value: &[u8]) -> Result<u32, ProtocolError> {
    digits("lamp hours, up to five digits", value, 5)
}

/// The collected answer to `150 1`, as far as all models agree on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Information {
    /// Whether it is on.
    pub on: bool,
    /// Hours of the lamp.
    pub lamp_hours: u32,
}

/// Parses the value of `150 1`: power, lamp hours, input, firmware, display mode, without
/// anything between. Lamp hours have four digits where all of it has up to twelve, else five.
///
/// # Errors
/// It is nothing like that.
pub fn parse_information(value: &[u8]) -> Result<Information, ProtocolError> {
    let wrong = || ProtocolError::new("power, lamp hours, input, firmware and display mode", value);
    let width = match value.len() {
        11 | 12 => 4,
        13..=16 => 5,
        _ => return Err(wrong()),
    };
    let on = parse_switch(value.get(..1).unwrap_or_default()).map_err(|_| wrong())?;
    let hours = value.get(1..=width).ok_or_else(wrong)?;
    Ok(Information { on, lamp_hours: parse_hours(hours).map_err(|_| wrong())? })
}
