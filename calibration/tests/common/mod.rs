//! Where the real pictures are that some tests look at.

use std::path::PathBuf;

/// A folder of real test data, or None (said aloud) where it is not at hand.
pub fn data(folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("DIAPHANE_TEST_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let path = root.join(folder);
    if path.is_dir() {
        return Some(path);
    }
    eprintln!("SKIPPED: no real data at {} (set DIAPHANE_TEST_DATA)", path.display());
    None
}
