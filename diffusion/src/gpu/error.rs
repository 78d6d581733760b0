//! Why the GPU cannot do it.

/// What is wrong with a GPU, or with what was asked of it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// No adapter, or none of that name.
    #[error(
        "no GPU {}was found; this machine has {}",
        wanted.as_ref().map(|name| format!("named {name:?} ")).unwrap_or_default(),
        if found.is_empty() { "none".to_owned() } else { found.join(", ") }
    )]
    NoAdapter {
        /// The name asked for.
        wanted: Option<String>,
        /// Names of the adapters that there are.
        found: Vec<String>,
    },
    /// The adapter lacks something that the kernels need.
    #[error("{adapter} offers {found} {what}, {needed} are needed")]
    Limit {
        /// Name of the adapter.
        adapter: String,
        /// What there is too little of.
        what: &'static str,
        /// How much is needed.
        needed: u64,
        /// How much there is.
        found: u64,
    },
    /// The adapter gave no device, or a call failed.
    #[error("{adapter}: {message}")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// What the driver said.
        message: String,
    },
    /// The memory does not suffice.
    #[error(
        "{adapter} has not the memory to solve {} for {lanes} fields at once: {:.2} GiB are \
         needed, {}; a grid of {} would do with half",
        shape(cells),
        gib(*needed),
        have.map_or("more than it had left".into(), |have| format!("it can hold {:.2} GiB", gib(have))),
        shape(&half(*cells))
    )]
    OutOfMemory {
        /// Name of the adapter.
        adapter: String,
        /// Cells of the grid.
        cells: [usize; 3],
        /// Fields solved at once.
        lanes: usize,
        /// Bytes that are needed.
        needed: u64,
        /// Bytes that there are, where the driver says so.
        have: Option<u64>,
    },
    /// The device was lost (a reset, an unplugged adapter, a driver's time-out).
    #[error("{adapter} was lost: {message}")]
    Lost {
        /// Name of the adapter.
        adapter: String,
        /// What the driver said.
        message: String,
    },
}

fn gib(bytes: u64) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}

fn shape(cells: &[usize; 3]) -> String {
    let [nx, ny, nz] = cells;
    format!("{nx} x {ny} x {nz} cells")
}

/// A grid of the same shape with half the cells.
fn half(cells: [usize; 3]) -> [usize; 3] {
    cells.map(|n| ((n as f64 * 0.5f64.cbrt()) as usize).max(2))
}
