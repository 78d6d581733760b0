//! What a parser says about bytes that it does not understand.

use crate::DeviceError;

/// Longer replies are cut before they are shown: no reply of these protocols is half as long.
const SHOWN: usize = 120;

/// Bytes that are no reply of the protocol.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, received \"{}\"", bytes.escape_ascii())]
pub struct ProtocolError {
    /// What the protocol asks for.
    pub expected: &'static str,
    /// What came instead, at most its first 120 bytes.
    pub bytes: Vec<u8>,
}

impl ProtocolError {
    /// `bytes` came where `expected` should have.
    pub fn new(expected: &'static str, bytes: &[u8]) -> Self {
        Self { expected, bytes: bytes.get(..SHOWN).unwrap_or(bytes).to_vec() }
    }

    /// The same, by the name of the device.
    pub fn of(self, device: &str) -> DeviceError {
        DeviceError::Protocol {
            device: device.to_owned(),
            expected: self.expected.to_owned(),
            bytes: self.bytes,
        }
    }
}

/// The text of a reply, if it is printable ASCII.
pub(super) fn printable<'a>(
    expected: &'static str,
    bytes: &'a [u8],
) -> Result<&'a str, ProtocolError> {
    match std::str::from_utf8(bytes) {
        Ok(text) if text.bytes().all(|b| (b' '..=b'~').contains(&b)) => Ok(text),
        _ => Err(ProtocolError::new(expected, bytes)),
    }
}

/// `bytes` without spaces, carriage returns and line feeds at either end.
pub(super) fn trimmed(bytes: &[u8]) -> &[u8] {
    bytes.trim_ascii()
}

/// A number of one to `longest` digits, and nothing else.
pub(super) fn digits(
    expected: &'static str,
    bytes: &[u8],
    longest: usize,
) -> Result<u32, ProtocolError> {
    let wrong = || ProtocolError::new(expected, bytes);
    if !(1..=longest).contains(&bytes.len()) || !bytes.iter().all(u8::is_ascii_digit) {
        return Err(wrong());
    }
    std::str::from_utf8(bytes).ok().and_then(|text| text.parse().ok()).ok_or_else(wrong)
}
