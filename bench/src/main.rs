//! `diaphane-bench`: forward, gradient and inverse on the four grids of W08 Table II, beside the
//! bandwidth of the memory that they are bound by; or forward and gradient on cubes of all sizes.
//!
//! It needs nothing but a Vulkan driver (or none, for `--device cpu`), so that it can be copied to
//! a machine and run there.

mod bandwidth;
mod block;
mod measure;
mod memory;

use clap::Parser;
use diffusion::DeviceChoice;
use measure::{Bench, Row};
use serde_json::json;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// How fast forward, gradient and inverse are on this machine
///
/// On each grid: a forward solve of 16 right-hand sides to a residual of 1e-6, set-up included; the
/// gradient (adjoint solve and contraction); and a whole inverse solve of three channels to the
/// noise of its images, which come from a grid twice as fine, with the memory that takes. The bound is
/// what the memory's bandwidth allows at the number of iterations that were needed.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:\n  diaphane-bench\n  diaphane-bench --device cpu --grids 1 --json\n  diaphane-bench --device cpu --cubes"
)]
struct Args {
    /// What does the work: gpu, gpu:NAME, cpu, or auto (a GPU in hardware, else the CPU)
    #[arg(long, default_value = "gpu")]
    device: DeviceChoice,
    /// How many of the four grids, smallest first
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=4))]
    grids: u8,
    /// Leave the inverse solves out
    #[arg(long)]
    no_inverse: bool,
    /// Cubes of 32³, 64³, 128³ and 256³ cells in their place, without inverse solves; the last takes
    /// 12 GB
    #[arg(long)]
    cubes: bool,
    /// Seconds after which no further grid is begun
    #[arg(long, default_value_t = 480.0)]
    limit: f64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

fn main() -> ExitCode {
    let args = Args::parse();
    match run(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("diaphane-bench: {message}");
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> Result<(), String> {
    let gpu = args.device.gpu().map_err(|e| e.to_string())?;
    let device = gpu.as_ref().map_or("CPU".to_owned(), |gpu| gpu.name().to_owned());
    let bandwidth = match &gpu {
        None => bandwidth::of_cpu(),
        Some(gpu) => gpu.bandwidth().map_err(|e| e.to_string())?,
    };
    if !args.json {
        println!("{device}: {:.0} GB/s", bandwidth / 1e9);
        println!("{}", Row::HEADINGS);
    }
    let began = Instant::now();
    let limit = Duration::try_from_secs_f64(args.limit).map_err(|e| format!("--limit: {e}"))?;
    let bench = Bench::new(gpu, bandwidth);
    let samples = if args.cubes { &block::CUBES } else { &block::TABLE_II };
    let mut samples: Vec<_> = samples.iter().collect();
    samples.sort_by_key(|s| s.cells.iter().product::<usize>());
    let mut rows = Vec::new();
    for sample in samples.into_iter().take(args.grids.into()) {
        if began.elapsed() > limit {
            eprintln!("{:?} and what is larger left out: {} s are over", sample.cells, args.limit);
            break;
        }
        let row = bench.row(sample, !(args.no_inverse || args.cubes))?;
        if !args.json {
            println!("{row}");
        }
        rows.push(row.json());
    }
    if args.json {
        let threads = rayon::current_num_threads();
        let out = json!({
            "device": device,
            "threads": threads,
            "bandwidth_bytes_per_s": bandwidth,
            "seed": measure::SEED,
            "grids": rows,
        });
        println!("{out:#}");
    }
    Ok(())
}
