//! `diaphane rig twin`: the simulated rig behind the protocols of real devices.

use crate::Failure;
use crate::commands::init::SimulatedArgs;
use crate::output::Done;
use std::path::PathBuf;

/// A whole rig without hardware, to try the drivers for hardware on
///
/// The simulated rig as a GigE Vision camera on the loopback interface, a projector that is a
/// monitor and is switched over PJLink or Optoma's protocol, a stage with GRBL, and hands that put things in their
/// places. Its rig file is written to the folder once everything is there; it runs until Ctrl-C.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  diaphane rig twin twin --sample marble --seed 7\n  \
    diaphane rig list twin/rig.toml")]
pub(crate) struct Args {
    /// Folder for its rig file
    folder: PathBuf,
    #[command(flatten)]
    simulated: SimulatedArgs,
    /// Monitor that the projector is, of 1024 x 768 pixels, as `rig list` calls it; without one, a
    /// screen in memory (Xvfb)
    #[arg(long)]
    monitor: Option<String>,
    /// Replace a rig file that is there
    #[arg(long)]
    force: bool,
}

#[cfg(all(feature = "aravis", feature = "display", target_os = "linux"))]
pub(super) fn run(args: &Args) -> Result<Done, Failure> {
    use crate::cli::STOP;
    use crate::commands::init::simulated_config;
    use crate::session::Config;
    use material::{Face, Overwrite};
    use serde_json::json;
    use simulator::devices::{Twin, TwinSpec};
    use simulator::{SampleSpec, SimulatedRig};
    use std::sync::atomic::Ordering;
    use std::time::Duration;

    let Config { sample: block, .. } = simulated_config(&args.simulated)?;
    let sample = SampleSpec { kind: args.simulated.sample.kind(), seed: args.simulated.seed };
    let spec = TwinSpec {
        sample,
        lit: block.lit_face,
        transport: args.simulated.transport.into(),
        monitor: args.monitor.clone().map(|monitor| (None, monitor)),
        folder: args.folder.clone(),
    };
    let overwrite = if args.force { Overwrite::Replace } else { Overwrite::Refuse };
    let (columns, rows, square) = SimulatedRig::new(&spec.sample, spec.lit)?.board();
    let ([w, h, d], [nx, ny, nz]) = (block.grid.size_mm(), block.grid.cells());
    let lit = if spec.lit == Face::Front { " --lit front" } else { "" };
    let twin = Twin::start(&spec, overwrite)?;
    let path = twin.rig_file().display().to_string();
    eprintln!(
        "the rig is there: {path}\nend it with Ctrl-C; in another terminal, one after the other:\n  diaphane rig list {path}\n  \
         diaphane init my-twin --rig {path} --size {w}x{h}x{d} --cells {nx}x{ny}x{nz} --board {columns}x{rows} --square {square} --eta {}{lit}",
        block.eta
    );
    while !STOP.load(Ordering::Relaxed) {
        if let Some(error) = twin.failure() {
            eprintln!("the camera gave no frame: {error}");
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(Done::new(json!({ "rig": path }), "the rig is gone"))
}

#[cfg(all(feature = "aravis", feature = "display", target_os = "linux"))]
impl From<simulator::devices::TwinError> for Failure {
    fn from(error: simulator::devices::TwinError) -> Self {
        use simulator::devices::TwinError as E;
        match error {
            E::Device(error) if error.kind() == ::rig::DeviceErrorKind::Busy => {
                Self::other(error).hint("there can be one twin on a machine: end the other one")
            }
            E::Device(error) => Self::other(error),
            E::File(error) => error.into(),
            E::System { what, .. } if what.contains("Xvfb") => Self::other(error).hint(
                "sudo apt-get install xvfb, or name a monitor of 1024 x 768 pixels with --monitor",
            ),
            error => Self::other(error),
        }
    }
}

#[cfg(not(all(feature = "aravis", feature = "display", target_os = "linux")))]
pub(super) fn run(args: &Args) -> Result<Done, Failure> {
    let Args { folder, simulated, monitor, force } = args;
    let _ = (simulated.seed, simulated.transport, monitor, force);
    let error = format!("{}: this program was built without the twin", folder.display());
    Err(Failure::other(error).hint("build it on Linux with the features aravis and display"))
}
