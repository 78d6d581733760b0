//! NumPy's `.npy` header, format 1.0 to 3.0: a Python dictionary of three known keys.
//!
//! Read by hand, because the crates for it either take the shape at its word (and then
//! allocate or multiply themselves into a crash on a bad file) or bring an array library.

use super::Kind;

const MAGIC: &[u8] = b"\x93NUMPY";
/// NumPy itself refuses longer headers unless it is told that the file can be trusted.
const LONGEST_HEADER: usize = 10_000;

/// What the header of an array says.
#[derive(Debug, PartialEq)]
pub(super) struct NpyHeader {
    pub kind: Kind,
    pub big_endian: bool,
    pub fortran_order: bool,
    pub shape: Vec<usize>,
    /// Bytes before the data.
    pub length: usize,
}

/// Parses the header at the start of `bytes`; the error says what is wrong in words.
pub(super) fn parse(bytes: &[u8]) -> Result<NpyHeader, String> {
    let short = || "the .npy header is cut short".to_owned();
    if !bytes.starts_with(MAGIC) {
        return Err("expected a .npy array, found something else".into());
    }
    let byte = |at: usize| bytes.get(at).map(|&b| usize::from(b)).ok_or_else(short);
    let (start, length) = match byte(6)? {
        1 => (10, byte(8)? | byte(9)? << 8),
        2 | 3 => (12, byte(8)? | byte(9)? << 8 | byte(10)? << 16 | byte(11)? << 24),
        other => return Err(format!("expected .npy format 1 to 3, found {other}")),
    };
    if length > LONGEST_HEADER {
        return Err(format!("expected a .npy header below {LONGEST_HEADER} bytes, found {length}"));
    }
    let text = bytes.get(start..start + length).ok_or_else(short)?;
    let text = std::str::from_utf8(text).map_err(|_| "the .npy header is not text".to_owned())?;
    let (kind, big_endian, fortran_order, shape) = dictionary(text)?;
    Ok(NpyHeader { kind, big_endian, fortran_order, shape, length: start + length })
}

fn dictionary(text: &str) -> Result<(Kind, bool, bool, Vec<usize>), String> {
    let wrong = || format!("the .npy header makes no sense: {:?}", text.trim());
    let (mut descr, mut fortran, mut shape) = (None, None, None);
    let mut rest = text.trim().strip_prefix('{').ok_or_else(wrong)?.trim_start();
    while !rest.starts_with('}') {
        let (key, after) = quoted(rest).ok_or_else(wrong)?;
        let value = after.trim_start().strip_prefix(':').ok_or_else(wrong)?.trim_start();
        rest = match key {
            "descr" if value.starts_with('[') => {
                return Err("expected an array of plain numbers, found a structured one".into());
            }
            "descr" => {
                let (code, after) = quoted(value).ok_or_else(wrong)?;
                descr = Some(element(code)?);
                after
            }
            "fortran_order" => {
                let truth = |word, is| value.strip_prefix(word).map(|after| (is, after));
                let (is, after) =
                    truth("True", true).or(truth("False", false)).ok_or_else(wrong)?;
                fortran = Some(is);
                after
            }
            "shape" => {
                let (inside, after) = value
                    .strip_prefix('(')
                    .and_then(|value| value.split_once(')'))
                    .ok_or_else(wrong)?;
                let axes = inside.split(',').map(str::trim).filter(|axis| !axis.is_empty());
                // Python 2 wrote long integers with an L.
                let axes = axes.map(|axis| axis.trim_end_matches('L').parse());
                shape = Some(axes.collect::<Result<Vec<usize>, _>>().map_err(|_| wrong())?);
                after
            }
            _ => return Err(wrong()),
        };
        rest = rest.trim_start();
        rest = match rest.strip_prefix(',') {
            Some(after) => after.trim_start(),
            None if rest.starts_with('}') => rest,
            None => return Err(wrong()),
        };
    }
    match (descr, fortran, shape) {
        (Some((kind, big)), Some(fortran), Some(shape)) => Ok((kind, big, fortran, shape)),
        _ => Err(wrong()),
    }
}

/// A quoted word at the start of `text`, and what comes after it.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text[1..].split_once(quote)
}

/// The element type of a code such as `<f4`, and whether it is big-endian.
fn element(code: &str) -> Result<(Kind, bool), String> {
    let (order, name) = match code.split_at_checked(1) {
        Some((order @ ("<" | ">" | "|" | "="), name)) => (order, name),
        _ => ("<", code),
    };
    let kind = match name {
        "f4" => Kind::F32,
        "f8" => Kind::F64,
        "i4" => Kind::I32,
        "i8" => Kind::I64,
        "u1" => Kind::U8,
        _ => match name.strip_prefix('U').and_then(|n| n.parse().ok()) {
            Some(characters) => Kind::Text(characters),
            None => {
                return Err(format!(
                    "expected float32, float64, int32, int64, uint8 or text, found type {code:?}"
                ));
            }
        },
    };
    Ok((kind, order == ">"))
}

/// The header of a little-endian array in C order, padded so that data starts at a multiple of 64.
pub(super) fn header(descr: &str, shape: &[usize]) -> Vec<u8> {
    let axes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    // A tuple of one needs its comma; others go without, as NumPy writes them.
    let axes = if shape.len() == 1 { axes.trim_end() } else { axes.trim_end_matches(", ") };
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({axes}), }}");
    let padded = (10 + text.len() + 1).next_multiple_of(64);
    text.extend(std::iter::repeat_n(' ', padded - 10 - text.len() - 1));
    text.push('\n');
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    // At most a few dozen axes of 20 digits: far below the 65535 that format 1.0 can say.
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_text(text: &str) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes
    }

    #[test]
    fn headers_round_trip() {
        for shape in [&[][..], &[3], &[2, 5, 7]] {
            let bytes = header("<f4", shape);
            assert_eq!(bytes.len() % 64, 0);
            let parsed = parse(&bytes).unwrap();
            assert_eq!((parsed.kind, parsed.shape.as_slice()), (Kind::F32, shape));
            assert_eq!(parsed.length, bytes.len());
        }
        assert!(String::from_utf8_lossy(&header("<f8", &[3])).contains("'shape': (3,), "));
        assert!(String::from_utf8_lossy(&header("<f8", &[3, 4])).contains("'shape': (3, 4), "));
    }

    #[test]
    fn other_writers_headers() {
        let text = r#"{"shape": (2L, 3L), "descr": ">i8", "fortran_order": True}"#;
        let parsed = parse(&with_text(text)).unwrap();
        assert_eq!(parsed.kind, Kind::I64);
        assert!(parsed.big_endian && parsed.fortran_order);
        assert_eq!(parsed.shape, [2, 3]);
    }

    #[test]
    fn nonsense_is_an_error() {
        for text in [
            "",
            "{",
            "{}",
            "{'descr': '<f4'}",
            "{'descr': '<c8', 'fortran_order': False, 'shape': ()}",
            "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': ()}",
            "{'descr': '<f4', 'fortran_order': Maybe, 'shape': ()}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999999,)}",
            "{'descr': 'é', 'fortran_order': False, 'shape': (1,)}",
            "{é: 1}",
        ] {
            assert!(parse(&with_text(text)).is_err(), "{text}");
        }
        assert!(parse(b"\x93NUMPY\x02\x00\xff\xff\xff\xff").is_err());
        assert!(parse(b"\x93NUMPY").is_err());
        assert!(parse(b"").is_err());
    }
}
