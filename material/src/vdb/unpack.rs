//! Voxels out of zlib streams that need not be whole.

use flate2::{Decompress, FlushDecompress, Status};

/// Exactly so many bytes out of a zlib stream.
pub(super) fn inflate(
    zlib: &mut Decompress,
    packed: &[u8],
    length: usize,
) -> Result<Vec<u8>, String> {
    // One byte more, to notice a stream that goes on.
    let mut out = Vec::with_capacity(length + 1);
    zlib.reset(true);
    match zlib.decompress_vec(packed, &mut out, FlushDecompress::Finish) {
        Ok(Status::StreamEnd) if out.len() == length => Ok(out),
        Ok(_) => Err(format!("expected {length} bytes of packed voxels, found others")),
        Err(error) => Err(format!("packed voxels are damaged: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(raw: &[u8]) -> Vec<u8> {
        let mut zlib = libdeflater::Compressor::new(libdeflater::CompressionLvl::default());
        let mut out = vec![0; zlib.zlib_compress_bound(raw.len())];
        let length = zlib.zlib_compress(raw, &mut out).unwrap();
        out.truncate(length);
        out
    }

    #[test]
    fn streams_of_another_length_and_damaged_ones_are_refused() {
        let raw: Vec<u8> = (0..200).map(|i: u8| i / 3).collect();
        let stream = packed(&raw);
        let zlib = &mut Decompress::new(true);
        assert_eq!(inflate(zlib, &stream, 200).unwrap(), raw);
        for length in [0, 196, 204, 6144] {
            assert!(inflate(zlib, &stream, length).unwrap_err().contains(&length.to_string()));
        }
        for cut in 0..stream.len() {
            assert!(inflate(zlib, &stream[..cut], 200).is_err(), "cut at {cut}");
        }
        let mut damaged = stream.clone();
        // The checksum.
        *damaged.last_mut().unwrap() ^= 1;
        assert!(inflate(zlib, &damaged, 200).unwrap_err().contains("damaged"));
        // None of it stays behind.
        assert_eq!(inflate(zlib, &stream, 200).unwrap(), raw);
    }
}
