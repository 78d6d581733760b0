//! A look at a TIFF's directories before a decoder believes them.
//!
//! The decoders reserve what a field says it needs, and memory that is not there ends the program
//! where nothing can catch it; and they pass over fields that a truncated file has lost, among
//! them such as say where the picture lies. DNG, CR2, NEF and ARW are TIFFs; other files pass.

/// Sub-directories: pictures, EXIF, GPS.
const POINTERS: [u16; 3] = [330, 34665, 34853];

/// Width, height and samples a pixel.
const EXTENT: [u16; 3] = [256, 257, 277];

/// Samples of the largest picture, five times those of the largest sensors: 1 GiB.
const MOST_SAMPLES: u64 = 1 << 29;

/// More directories than any camera writes: the file points in circles.
const MOST: usize = 256;

/// Finds what no whole file has: a field beyond the end, or a picture beyond memory; in words.
pub fn damage(file: &[u8]) -> Option<String> {
    let bytes = Bytes { file, big: file.starts_with(b"MM") };
    if !(bytes.big || file.starts_with(b"II")) || bytes.short(2) != Some(42) {
        return None;
    }
    let mut waiting = vec![bytes.long(4)? as usize];
    for _ in 0..MOST {
        let directory = waiting.pop().filter(|at| *at != 0)?;
        let Some(fields) = bytes.short(directory) else { continue };
        let mut samples = 1_u64;
        for k in 0..usize::from(fields) {
            let at = directory + 2 + 12 * k;
            let (Some(tag), Some(kind), Some(count)) =
                (bytes.short(at), bytes.short(at + 2), bytes.long(at + 4))
            else {
                return Some("a directory that is cut off".into());
            };
            let size = u64::from(count) * size_of_type(kind);
            let from = if size > 4 { u64::from(bytes.long(at + 8)?) } else { 0 };
            if from + size > file.len() as u64 {
                let end = file.len();
                return Some(format!("a field {tag} of {size} bytes at {from} in a file of {end}"));
            }
            if EXTENT.contains(&tag) {
                let value = if size_of_type(kind) == 2 {
                    bytes.short(at + 8).map(u32::from)
                } else {
                    bytes.long(at + 8)
                };
                samples = samples.saturating_mul(u64::from(value?));
            }
            if POINTERS.contains(&tag) {
                // One offset stands in the field itself, several where it points to.
                let from = if count > 1 { bytes.long(at + 8)? as usize } else { at + 8 };
                let few = (count as usize).min(MOST);
                waiting.extend((0..few).filter_map(|i| Some(bytes.long(from + 4 * i)? as usize)));
            }
        }
        if samples > MOST_SAMPLES {
            return Some(format!("a picture of {samples} samples"));
        }
        let next = bytes.long(directory + 2 + 12 * usize::from(fields));
        // The chain's end is 0; it waits below the sub-directories.
        if let Some(next) = next.filter(|next| *next != 0) {
            waiting.insert(0, next as usize);
        }
        waiting.retain(|at| *at != 0);
    }
    None
}

/// Bytes of one value of a TIFF field type (TIFF 6.0, section 2); unknown ones count as 8.
fn size_of_type(kind: u16) -> u64 {
    match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        _ => 8,
    }
}

struct Bytes<'a> {
    file: &'a [u8],
    big: bool,
}

impl Bytes<'_> {
    fn short(&self, at: usize) -> Option<u16> {
        let bytes = *self.file.get(at..)?.first_chunk()?;
        Some(if self.big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn long(&self, at: usize) -> Option<u32> {
        let bytes = *self.file.get(at..)?.first_chunk()?;
        Some(if self.big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }
}
