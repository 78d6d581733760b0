//! From a frame in memory to a file, in one pass.
//!
//! Frames come as fast as the camera is, so nothing is compressed: deflate takes ten times as long
//! as a disk takes the bytes, and saves a quarter of noisy 16-bit pixels. Each piece of the file is
//! made, looked at, hashed and handed to the system while it is in the processor's cache.

use std::io::{self, Write};
use std::path::Path;

use material::FileError;

use crate::frame::KEYWORD;
use crate::survey::Survey;
use crate::{Frame, FrameError, FrameMetadata, PixelRect};

/// The most that a stored block of deflate holds (RFC 1951, section 3.2.4), bytes.
const BLOCK: usize = 65535;
/// Head of a stored block: whether it is the last, and its length twice.
const BLOCK_HEAD: usize = 5;

/// What there is to tell of a frame that was encoded.
pub(crate) struct Encoded {
    /// BLAKE3 of all bytes.
    pub blake3: String,
    pub survey: Survey,
}

/// Why a frame could not be encoded, in a file that is not named yet.
#[derive(Debug)]
pub(crate) enum EncodeError {
    Frame(FrameError),
    Io(io::Error),
}

impl From<io::Error> for EncodeError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Says which file it was.
pub(crate) fn named(error: EncodeError, path: &Path) -> FrameError {
    match error {
        EncodeError::Frame(error) => error,
        EncodeError::Io(source) => {
            FrameError::File(FileError::Io { path: path.into(), action: "write", source })
        }
    }
}

/// Writes a frame as a 16-bit PNG (W3C, third edition) whose pixels are stored, not compressed.
///
/// # Errors
/// The frame does not [`Frame::check`]; then some of it may have been written. Or `out` fails.
pub(crate) fn encode_frame(
    frame: &Frame,
    metadata: &FrameMetadata,
    patch: Option<PixelRect>,
    out: &mut impl Write,
) -> Result<Encoded, EncodeError> {
    frame.check_shape().map_err(EncodeError::Frame)?;
    let text = serde_json::to_string(metadata)
        .map_err(|e| EncodeError::Frame(FrameError::Encode(e.to_string())))?;
    let mut file = Chunks { out, hash: blake3::Hasher::new(), chunk: Vec::new() };
    file.put(b"\x89PNG\r\n\x1a\n")?;
    file.begin(b"IHDR");
    file.chunk.extend(frame.width.to_be_bytes());
    file.chunk.extend(frame.height.to_be_bytes());
    let colour = if frame.channels == 1 { 0 } else { 2 };
    // 16 bits; the only compression, filter method and order that are not exotic.
    file.chunk.extend([16, colour, 0, 0, 0]);
    file.end()?;
    file.begin(b"iTXt");
    file.chunk.extend(KEYWORD.as_bytes());
    // Not compressed, and of no language.
    file.chunk.extend([0, 0, 0, 0, 0]);
    file.chunk.extend(text.as_bytes());
    file.end()?;

    let row_values = frame.width as usize * usize::from(frame.channels);
    let row_bytes = 1 + 2 * row_values;
    let mut pixels = Stored::new(file, row_bytes * frame.height as usize)?;
    let mut survey = Survey::new(frame, patch);
    let mut bytes = vec![0; row_bytes];
    for row in frame.data.chunks_exact(row_values) {
        // The first byte names the row's filter: none.
        let pairs = bytes[1..].as_chunks_mut::<2>().0.iter_mut();
        pairs.zip(row).for_each(|(pair, value)| *pair = value.to_be_bytes());
        survey.row(row).map_err(EncodeError::Frame)?;
        pixels.put(&bytes)?;
    }
    let mut file = pixels.file;
    file.begin(b"IEND");
    file.end()?;
    Ok(Encoded { blake3: file.hash.finalize().to_hex().to_string(), survey })
}

/// Chunks of a PNG on their way out.
struct Chunks<'w, W> {
    out: &'w mut W,
    hash: blake3::Hasher,
    /// Length, name and content of the chunk at hand.
    chunk: Vec<u8>,
}

impl<W: Write> Chunks<'_, W> {
    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hash.update(bytes);
        self.out.write_all(bytes)
    }

    fn begin(&mut self, name: &[u8; 4]) {
        self.chunk.clear();
        self.chunk.extend([0; 4]);
        self.chunk.extend(name);
    }

    fn end(&mut self) -> io::Result<()> {
        let length = u32::try_from(self.chunk.len() - 8)
            .map_err(|_| io::Error::new(io::ErrorKind::FileTooLarge, "a chunk beyond 4 GB"))?;
        self.chunk[..4].copy_from_slice(&length.to_be_bytes());
        let check = crc32fast::hash(&self.chunk[4..]);
        self.chunk.extend(check.to_be_bytes());
        self.hash.update(&self.chunk);
        self.out.write_all(&self.chunk)
    }
}

/// Pixels as a zlib stream of stored blocks (RFC 1950, 1951), one block a chunk.
struct Stored<'w, W> {
    file: Chunks<'w, W>,
    adler: simd_adler32::Adler32,
    /// Bytes that are still to come, beyond those of the block at hand.
    left: usize,
    /// Bytes that the block at hand still lacks.
    lacks: usize,
}

impl<'w, W: Write> Stored<'w, W> {
    fn new(file: Chunks<'w, W>, bytes: usize) -> io::Result<Self> {
        let mut new = Self { file, adler: simd_adler32::Adler32::new(), left: bytes, lacks: 0 };
        new.file.begin(b"IDAT");
        // Deflate with the largest window, in no hurry: what all readers take.
        new.file.chunk.extend([0x78, 0x01]);
        new.block();
        Ok(new)
    }

    /// Begins a block.
    fn block(&mut self) {
        let length = self.left.min(BLOCK);
        self.left -= length;
        self.lacks = length;
        let length = length as u16;
        let mut head = [u8::from(self.left == 0); BLOCK_HEAD];
        head[1..3].copy_from_slice(&length.to_le_bytes());
        head[3..5].copy_from_slice(&(!length).to_le_bytes());
        self.file.chunk.extend(head);
    }

    fn put(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        self.adler.write(bytes);
        while !bytes.is_empty() {
            let (now, later) = bytes.split_at(bytes.len().min(self.lacks));
            self.file.chunk.extend_from_slice(now);
            self.lacks -= now.len();
            bytes = later;
            if self.lacks > 0 {
                break;
            }
            let last = self.left == 0;
            if last {
                self.file.chunk.extend(self.adler.finish().to_be_bytes());
            }
            self.file.end()?;
            if last {
                break;
            }
            self.file.begin(b"IDAT");
            self.block();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::survey::tests::frame;
    use crate::{Pattern, Purpose, Target, read_frame};

    fn metadata() -> FrameMetadata {
        FrameMetadata {
            shot: "white".into(),
            purpose: Purpose::Fit,
            target: Target::Sample,
            pattern: Pattern::White,
            exposure_index: 0,
            repeat: 0,
            requested_s: 0.5,
            exposure_s: 0.5,
            bit_depth: 12,
            camera: "cämera".into(),
            projector: "none".into(),
        }
    }

    /// Read back by the png crate, which checks all sums. Sizes around the length of a stored block:
    /// just less, just that, just more, and twice.
    #[test]
    fn what_is_stored_is_what_is_read() {
        let folder = tempfile::tempdir().unwrap();
        for (i, (width, height, channels)) in
            [(1, 1, 1), (7, 5, 3), (32767, 1, 1), (2, 13107, 1), (2, 13108, 1), (2, 26214, 1)]
                .into_iter()
                .enumerate()
        {
            let frame = frame(width, height, channels);
            let path = folder.path().join(format!("{i}.png"));
            let mut bytes = Vec::new();
            let encoded = encode_frame(&frame, &metadata(), None, &mut bytes).unwrap();
            std::fs::write(&path, &bytes).unwrap();
            assert_eq!(encoded.blake3, blake3::hash(&bytes).to_hex().to_string());
            let (back, about) = read_frame(&path).unwrap();
            assert_eq!((back, about), (frame.clone(), metadata()), "{width} x {height}");
        }
    }

    #[test]
    fn values_that_no_camera_gives_are_refused_by_place() {
        let mut frame = frame(50, 9, 3);
        frame.data[751] = 4096;
        let error = encode_frame(&frame, &metadata(), None, &mut Vec::new()).err().unwrap();
        assert!(
            matches!(
                error,
                EncodeError::Frame(FrameError::Value { max: 4095, index: 751, value: 4096 })
            ),
            "{error:?}"
        );
    }
}
