//! The most memory that a part of the run takes, where the system can tell (Linux).

/// Begins to look: the highest mark is set to what is resident now.
pub(crate) fn begin() {
    // Where that cannot be done the mark is that of the whole run, which is no less.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Highest resident size since [`begin`], bytes.
pub(crate) fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kib)
}
