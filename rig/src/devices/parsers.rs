//! Every parser of what devices send, by name, for whoever feeds them arbitrary bytes.

use super::{benq, epson, grbl, optoma, pjlink, zaber};

/// Takes any bytes and must return.
pub type Parser = fn(&[u8]);

/// The parsers, one a protocol; each runs all that is made of a reply.
pub fn parsers() -> [(&'static str, Parser); 6] {
    [
        ("pjlink", |bytes| {
            let _ = pjlink::parse_greeting(bytes);
            if let Ok(pjlink::Reply::Value(value)) = pjlink::parse_reply(bytes, b"POWR") {
                let _ = pjlink::parse_power(&value);
            }
            let _ = pjlink::parse_mute(bytes);
            let _ = pjlink::parse_lamps(bytes);
            let _ = pjlink::parse_errors(bytes);
        }),
        ("optoma", |bytes| {
            for message in optoma::parse_messages(bytes).unwrap_or_default() {
                if let optoma::Message::Value(value) = message {
                    let _ = optoma::parse_switch(&value);
                    let _ = optoma::parse_hours(&value);
                    let _ = optoma::parse_information(&value);
                }
            }
            let _ = optoma::parse_information(bytes);
        }),
        ("epson", |bytes| {
            if let Ok(Some(epson::Reply::Value { value, .. })) = epson::parse_reply(bytes) {
                let _ = epson::parse_power(&value);
                let _ = epson::parse_mute(&value);
                let _ = epson::parse_hours(&value);
                let _ = epson::parse_error(&value);
            }
        }),
        ("benq", |bytes| {
            if let Ok(benq::Line::Value { value, .. }) = benq::parse_line(bytes, "*pow=?#") {
                let _ = benq::parse_power(&value);
                let _ = benq::parse_switch(&value);
                let _ = benq::parse_hours(&value);
            }
        }),
        ("grbl", |bytes| {
            let _ = grbl::parse_message(bytes);
        }),
        ("zaber", |bytes| {
            if let Ok(zaber::Line::Reply(reply)) = zaber::parse_line(bytes) {
                let _ = zaber::parse_position(reply.data.as_bytes());
            }
            let _ = zaber::parse_position(bytes);
        }),
    ]
}
