//! What a session on devices has to know, and where it gets it from.

use super::LitFace;
use crate::Failure;
use crate::devices::Simulated;
use crate::session::{Config, PlanConfig, RigConfig, Sample};
use calibration::{Board, NoiseModel};
use material::{BoundaryConvention, Face, Grid, Illumination, LateralBoundary, Scheme};
use rig::{Chessboard, RigFile};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub(crate) struct DeviceArgs {
    /// The rig's devices: a rig file; a copy of it goes into the session
    #[arg(
        long,
        value_name = "FILE",
        requires_all = ["size", "cells", "board", "square"],
        conflicts_with_all = ["sample", "seed", "transport"]
    )]
    pub rig: Option<PathBuf>,
    /// Width, height and depth of the block as the camera sees it, mm
    #[arg(long, value_name = "WxHxD", allow_hyphen_values = true, value_parser = three::<f64>, requires = "rig")]
    size: Option<[f64; 3]>,
    /// Cells along each, which κ and μ are solved on
    #[arg(long, value_name = "NXxNYxNZ", value_parser = three::<usize>, requires = "rig")]
    cells: Option<[usize; 3]>,
    /// The printed board: inner corners, columns x rows; or charuco:11x8:4x4_50:18
    #[arg(long, requires = "rig")]
    board: Option<String>,
    /// Edge of one of its squares, mm
    #[arg(long, value_name = "MM", requires = "rig")]
    square: Option<f64>,
    /// Refractive index of the block
    #[arg(long, default_value_t = 1.5, requires = "rig")]
    eta: f64,
}

/// Three numbers such as `80x60x12`.
pub(crate) fn three<T: std::str::FromStr>(text: &str) -> Result<[T; 3], String> {
    let parts: Option<Vec<T>> = text.split('x').map(|part| part.trim().parse().ok()).collect();
    parts
        .and_then(|parts| parts.try_into().ok())
        .ok_or_else(|| format!("expected three numbers such as 80x60x12, found {text:?}"))
}

/// The configuration of a rig of devices; asks camera and projector for their sizes.
pub(super) fn config(
    path: &Path,
    args: &DeviceArgs,
    session: &Path,
    lit: LitFace,
) -> Result<Config, Failure> {
    let file = RigFile::read(path)?;
    // Required by clap beside --rig.
    let (Some(size), Some(cells), Some(board), Some(square)) =
        (args.size, args.cells, &args.board, args.square)
    else {
        return Err(Failure::input("--rig needs --size, --cells, --board and --square"));
    };
    let board = Board::parse(board, square)?;
    let (Some(camera), Some(display)) = (&file.camera, &file.projector.display) else {
        let error =
            format!("{}: a session needs a [camera] and a [projector.display]", path.display());
        return Err(Failure::input(error).hint("docs/devices.md has examples"));
    };
    let simulated = Simulated::default();
    let hint =
        format!("what is there, and what is in the way: diaphane rig list {}", path.display());
    let failed = |error: rig::DeviceError| Failure::other(error).hint(hint.clone());
    if let Some(hands) = file.hands.program() {
        hands.find().map_err(failed)?;
    }
    let camera = camera.open(&simulated).map_err(failed)?.info();
    let projector = {
        let mut display = display.open(&simulated).map_err(failed)?;
        let info = display.info();
        // It was opened to be asked, not to be looked at.
        display.park().map_err(failed)?;
        info
    };
    let spacing = [0, 1, 2].map(|axis| size[axis] / cells[axis].max(1) as f64);
    let grid = Grid::new(cells, spacing)?;
    let full_scale = u16::MAX >> 16_u8.saturating_sub(camera.bit_depth);
    let name = session.file_name().map_or("sample".into(), |name| name.to_string_lossy());
    let projector_px = [projector.width, projector.height];
    Ok(Config {
        version: 1,
        sample: Sample {
            name: name.into_owned(),
            grid,
            lit_face: match lit {
                LitFace::Back => Face::Back,
                LitFace::Front => Face::Front,
            },
            eta: args.eta,
            boundary_constant: None,
            boundary: BoundaryConvention::default(),
            lateral: LateralBoundary::default(),
            illumination: Illumination::default(),
            scheme: Scheme::default(),
        },
        rig: RigConfig::Devices { noise: NoiseModel::for_max_value(full_scale), camera, board },
        plan: PlanConfig {
            projector_px,
            projector_board: projected_board(projector_px),
            ..PlanConfig::default()
        },
    })
}

/// The chessboard that the default plan shows, as large on a projector of another size.
fn projected_board([width, height]: [u32; 2]) -> Chessboard {
    let Chessboard { columns, rows, square_px, .. } = PlanConfig::default().projector_board;
    let square_px = (square_px * height / 768).min(square_px * width / 1024).max(1);
    let middle = |size: u32, squares: usize| size.saturating_sub(square_px * squares as u32) / 2;
    Chessboard {
        columns,
        rows,
        square_px,
        x0: middle(width, columns + 1),
        y0: middle(height, rows + 1),
    }
}
