//! What the memory gives: the bound that every solve is held against.

use rayon::prelude::*;
use std::time::Instant;

/// Values of each array: 256 MB, far beyond any cache.
const LEN: usize = 1 << 26;
/// The best of this many passes counts.
const PASSES: usize = 5;

/// Bytes a second of y += f x on all threads (McCalpin's triad without the third array).
pub(crate) fn of_cpu() -> f64 {
    let (x, mut y) = (vec![1.0f32; LEN], vec![0.5f32; LEN]);
    let mut best = f64::INFINITY;
    for pass in 0..PASSES {
        let factor = pass as f32;
        let began = Instant::now();
        y.par_chunks_mut(1 << 16).zip(x.par_chunks(1 << 16)).for_each(|(y, x)| {
            y.iter_mut().zip(x).for_each(|(y, x)| *y += factor * x);
        });
        best = best.min(began.elapsed().as_secs_f64());
    }
    std::hint::black_box(&y);
    3.0 * 4.0 * LEN as f64 / best
}
