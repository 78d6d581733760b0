//! `diaphane forward`: the bare forward problem, file in and file out, so that any solver can be
//! compared with ours.

use crate::Failure;
use crate::output::{Done, check_output};
use diffusion::{Batch, DeviceChoice, Forward, Illuminations, Medium, SolveReport};
use material::npz::{self, NpzReader};
use material::{BoundaryConvention, Face, FileError, Grid, LateralBoundary, Optics, Overwrite};
use serde_json::json;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Solve the forward problem of a file of coefficients
///
/// Reads kappa and mu (nz, ny, nx), the light q or q_front (M, ny, nx; on the face z = 0) or q_back
/// (on the face z = nz - 1), and the scalars h and C, from an .npz file. Boundary on all six faces:
/// phi + 2 C kappa dphi/dn = q, exactly as given. Writes phi (M, nz, ny, nx) and the radiance that
/// leaves both faces, radiance_front and radiance_back (M, ny, nx), L = (C / pi) J_n.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  diaphane forward --input p.npz --output phi.npz --rtol 1e-8")]
pub(crate) struct Args {
    /// Problem: an .npz file
    #[arg(long)]
    input: PathBuf,
    /// Answer: an .npz file
    #[arg(long)]
    output: PathBuf,
    /// What does the work: auto (a GPU in hardware, else the CPU), cpu, gpu or gpu:NAME
    #[arg(long, default_value = "auto")]
    device: DeviceChoice,
    /// Largest residual of every field, relative to its right-hand side
    #[arg(long, default_value_t = 1e-6)]
    rtol: f64,
    /// Replace an answer that is there
    #[arg(long)]
    force: bool,
}

/// What a problem file holds.
struct Problem {
    medium: Medium,
    optics: Optics,
    light: Illuminations,
}

pub(crate) fn run(args: &Args) -> Result<Done, Failure> {
    if !(args.rtol > 0.0 && args.rtol < 1.0) {
        let found = args.rtol;
        return Err(Failure::input(format!("--rtol must lie between 0 and 1, found {found}")));
    }
    // Asked before the work, so that it is not done for nothing.
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    check_output(&args.output, overwrite)?;
    let Problem { medium, optics, light } = read(&args.input)?;
    let grid = *medium.grid();

    let (mut solver, device) = crate::compute::solver(&args.device, args.rtol)?;
    let started = Instant::now();
    let mut forward = Forward::new(medium, &optics, &mut solver)?;
    let mut fluence = Batch::zeros(grid.len(), light.count());
    let report = forward.solve(&light, &mut fluence, args.rtol)?;
    let seconds = started.elapsed().as_secs_f64();

    let faces = [("radiance_front", Face::Front), ("radiance_back", Face::Back)]
        .map(|(name, face)| (name, forward.exit_radiance(&light, &fluence, face).concat()));
    write(&args.output, overwrite, &grid, &fluence, &faces)?;
    Ok(done(args, &device, seconds, &report, grid.len()))
}

fn read(path: &Path) -> Result<Problem, Failure> {
    let wrong = |what: &str, error: &dyn Display| {
        Failure::input(format!("{}: {what}{error}", path.display()))
    };
    let mut npz = NpzReader::open(path)?;
    let kappa = npz.array_f64("kappa")?;
    let [nz, ny, nx] = kappa.shape[..] else {
        let (found, expected) = (kappa.shape, "three axes (nz, ny, nx)".to_owned());
        let (path, name) = (path.into(), "kappa".into());
        return Err(FileError::WrongShape { path, name, expected, found }.into());
    };
    let mu = npz.shaped("mu", &[nz, ny, nx])?;
    let (h, boundary_constant) = (npz.scalar("h")?, npz.scalar("C")?);
    if !(boundary_constant.is_finite() && boundary_constant > 0.0) {
        return Err(wrong("C must be positive and finite, found ", &boundary_constant));
    }
    let grid = Grid::new([nx, ny, nz], [h; 3]).map_err(|e| wrong("kappa and h: ", &e))?;
    let medium = Medium::new(grid, kappa.data, mu).map_err(|e| wrong("", &e))?;

    let names = [("q", Face::Front), ("q_front", Face::Front), ("q_back", Face::Back)];
    let given: Vec<_> = names.into_iter().filter(|(name, _)| npz.contains(name)).collect();
    let [(name, face)] = given[..] else {
        let found: Vec<&str> = given.iter().map(|(name, _)| *name).collect();
        let found = if found.is_empty() { "none of them".into() } else { found.join(" and ") };
        return Err(wrong("expected one of q, q_front and q_back, found ", &found));
    };
    let q = npz.array_f64(name)?;
    if q.shape.len() != 3 || q.shape[1..] != [ny, nx] || q.shape[0] == 0 {
        let (expected, found) = (format!("(M, {ny}, {nx}) with M at least 1"), q.shape);
        let (path, name) = (path.into(), name.into());
        return Err(FileError::WrongShape { path, name, expected, found }.into());
    }
    let maps = q.data.chunks(nx * ny).map(<[f64]>::to_vec).collect();
    let light =
        Illuminations::new(&grid, face, maps).map_err(|e| wrong(&format!("{name}: "), &e))?;
    // η plays no part under this convention, which takes C as given.
    let optics = Optics {
        boundary_constant,
        boundary: BoundaryConvention::Wang2008,
        lateral: LateralBoundary::Open,
        ..Optics::from_eta(1.0)
    };
    Ok(Problem { medium, optics, light })
}

fn write(
    path: &Path,
    overwrite: Overwrite,
    grid: &Grid,
    fluence: &Batch,
    faces: &[(&str, Vec<f64>)],
) -> Result<(), FileError> {
    let [nx, ny, nz] = grid.cells();
    let count = fluence.count();
    let mut phi = Vec::with_capacity(count * grid.len());
    (0..count).for_each(|m| phi.extend(fluence.field(m)));
    npz::write(path, overwrite, |npz| {
        npz.array_f64("phi", &[count, nz, ny, nx], &phi)?;
        faces.iter().try_for_each(|(name, map)| npz.array_f64(name, &[count, ny, nx], map))
    })
}

fn done(args: &Args, device: &str, seconds: f64, report: &SolveReport, unknowns: usize) -> Done {
    let fields = report.right_hand_sides;
    let rate = (unknowns * fields) as f64 / seconds;
    let text = format!(
        "{}: {fields} fields of {unknowns} unknowns in {seconds:.3} s on {device}, {} iterations, relative \
         residual {:.1e}, {:.2} million unknowns x right-hand sides a second",
        args.output.display(),
        report.iterations,
        report.relative_residual,
        rate / 1e6
    );
    let json = json!({
        "output": args.output,
        "device": device,
        "seconds": seconds,
        "iterations": report.iterations,
        "relative_residual": report.relative_residual,
        "unknowns_rhs_per_s": rate,
        "unknowns": unknowns,
        "right_hand_sides": fields,
    });
    Done::new(json, text)
}
