//! Where the test data lies that is not in this repository.

use std::path::{Path, PathBuf};

/// A folder of it; where it is missing says so.
pub fn data(folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("DIAPHANE_TEST_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = root.join(folder);
    if path.is_dir() {
        return Some(path);
    }
    println!(
        "SKIPPED: {} is not there (DIAPHANE_TEST_DATA names the folder of test data)",
        path.display()
    );
    None
}
