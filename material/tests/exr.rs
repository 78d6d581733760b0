//! Stacks in OpenEXR pictures that are not stored as ours are.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, SmallVec, Vec2, WritableImage,
};
use material::exr_stack;

/// Two slices of κ and μ, 5 × 4 pixels in tiles of 64 × 64.
fn tiled() -> Vec<u8> {
    let channel = |name: &str, value: f32| {
        AnyChannel::new(name, FlatSamples::F32((0..20).map(|i| value + i as f32 / 64.0).collect()))
    };
    let channels: SmallVec<_> =
        [("kappa_z000.Y", 0.25), ("kappa_z001.Y", 1.25), ("mu_z000.Y", 0.5), ("mu_z001.Y", 1.5)]
            .map(|(name, value)| channel(name, value))
            .into_iter()
            .collect();
    let encoding = Encoding { blocks: Blocks::Tiles(Vec2(64, 64)), ..Encoding::UNCOMPRESSED };
    let image = Image::from_encoded_channels((5, 4), encoding, AnyChannels::sort(channels));
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

#[test]
fn tiles_are_read() {
    let reading = exr_stack::read(&tiled(), Path::new("m.exr")).unwrap();
    assert_eq!(reading.material.grid().cells(), [5, 4, 2]);
    let channel = &reading.material.channels()[0];
    assert_eq!(
        (channel.kappa_mm[7], channel.mu_per_mm[19]),
        (0.25 + 7.0 / 64.0, 0.5 + 19.0 / 64.0)
    );
}

/// Room for a tile would be made before it is seen that the file has nothing like it.
#[test]
fn tiles_that_are_larger_than_a_file_can_fill_are_refused() {
    let mut file = tiled();
    let name = b"tiles\0tiledesc\0";
    let at = file.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
    assert_eq!(file[at..at + 4], 64_u32.to_le_bytes());
    let edge = (1_u32 << 14).to_le_bytes();
    file[at..at + 4].copy_from_slice(&edge);
    file[at + 4..at + 8].copy_from_slice(&edge);
    let error = exr_stack::read(&file, Path::new("m.exr")).unwrap_err().to_string();
    assert!(error.contains("m.exr") && error.contains("more pixels"), "{error}");
}
