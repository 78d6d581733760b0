//! Numbers from a MATLAB file of version 5: compressed elements that hold one matrix each.

use std::io::Read;

/// The doubles of a matrix, column by column.
pub fn doubles(path: &std::path::Path, name: &str) -> Vec<f64> {
    let file = std::fs::read(path).unwrap();
    let mut rest = &file[128..];
    while rest.len() > 8 {
        let (kind, size) = (number(rest, 0), number(rest, 4));
        let element = &rest[8..8 + size];
        rest = &rest[8 + size..];
        // 15: compressed.
        if kind != 15 {
            continue;
        }
        let mut matrix = Vec::new();
        flate2::read::ZlibDecoder::new(element).read_to_end(&mut matrix).unwrap();
        // Flags, sides, name, numbers.
        let mut parts = Vec::new();
        let mut at = 8;
        while at + 8 <= matrix.len() && parts.len() < 4 {
            let (data, next) = part(&matrix, at);
            parts.push(data);
            at = next;
        }
        if parts.get(2).is_some_and(|found| *found == name.as_bytes()) {
            let (numbers, _) = parts[3].as_chunks::<8>();
            return numbers.iter().map(|b| f64::from_le_bytes(*b)).collect();
        }
    }
    panic!("{}: no {name}", path.display());
}

fn number(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// The bytes of a part, and where the next one starts. Up to four bytes stand in the heading.
fn part(matrix: &[u8], at: usize) -> (&[u8], usize) {
    let (kind, size) = (number(matrix, at), number(matrix, at + 4));
    match kind >> 16 {
        0 => (&matrix[at + 8..at + 8 + size], at + 8 + size.next_multiple_of(8)),
        small => (&matrix[at + 4..at + 4 + small], at + 8),
    }
}
