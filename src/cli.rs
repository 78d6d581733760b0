//! The command line: arguments in, exit code out.

use crate::Failure;
use crate::commands::{
    branch, calibrate, capture, convert, demo, doctor, export, forward, import, info, init, merge,
    plan, preview, report, rig, solve, status, study, verify,
};
use crate::output::Done;
use ::rig::devices::Parking;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Turns a block of marble, wax, jade or skin phantom into a material that a renderer can use.
#[derive(Parser)]
#[command(name = "diaphane", version, max_term_width = 100)]
struct Cli {
    /// Print the result as JSON on standard output
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Make a session: on the simulated rig, or with --rig on one of devices
    Init(init::Args),
    /// Check this machine, and a session if one is named
    Doctor(doctor::Args),
    /// The devices of a rig: what is connected, and whether it works
    #[command(subcommand)]
    Rig(rig::Args),
    /// Show what a capture takes, without touching hardware
    Plan(plan::Args),
    /// Show what the camera sees, again and again, while the projector shows lines to align by
    Preview(preview::Args),
    /// Take the pictures that are missing
    Capture(capture::Args),
    /// Go on in another folder with a plan that was changed in the middle
    Branch(branch::Args),
    /// Find out where camera and projector are and what their codes mean
    #[command(subcommand)]
    Calibrate(calibrate::Args),
    /// Make a session from pictures that another rig or a renderer took
    Import(import::Args),
    /// Merge brackets to radiance
    Merge(merge::Args),
    /// Show which steps of a session are done and what comes next
    Status(status::Args),
    /// Find κ and μ of every voxel
    Solve(solve::Args),
    /// Relight the material under every captured pattern and compare
    Verify(verify::Args),
    /// Write the material for other programs
    Export(export::Args),
    /// Write a material that is in one format in another
    Convert(convert::Args),
    /// Tell what a material is like: ranges, impossible voxels, whether diffusion is right for it
    Info(info::Args),
    /// Write one page about a session: how good it is, what it looks like, where it comes from
    Report(report::Args),
    /// Solve the forward problem of a file of coefficients
    Forward(forward::Args),
    /// What a choice costs and brings, measured on the simulated rig
    #[command(subcommand)]
    Study(study::Args),
    /// Acquire a material on the simulated rig, from nothing to a report
    Demo(demo::Args),
    /// The projector's window, as a process of its own; a capture starts it and tells it what to do
    #[command(name = ::rig::devices::display::WINDOW_COMMAND, hide = true)]
    #[command(after_help = "Example:\n  diaphane projector-window HDMI-1 < /dev/null")]
    Window {
        /// Name of the monitor
        monitor: String,
    },
}

/// Set by Ctrl-C; long work ends at the next good place.
pub(crate) static STOP: AtomicBool = AtomicBool::new(false);

/// What a second Ctrl-C puts away before the program ends.
pub(crate) static PARK: Mutex<Option<Parking>> = Mutex::new(None);

/// For the way to one parking place.
const PARKING: Duration = Duration::from_secs(180);

/// Runs the command that the arguments ask for.
pub fn main() -> ExitCode {
    let json = std::env::args().any(|a| a == "--json");
    let mut asked = numbers_may_be_negative(Cli::command());
    let parsed = asked.try_get_matches_from_mut(std::env::args_os()).and_then(|matches| {
        Cli::from_arg_matches(&matches).map_err(|error| error.format(&mut asked))
    });
    let cli = match parsed {
        Ok(cli) => cli,
        Err(error) if error.use_stderr() && json => {
            let text = error.render().to_string();
            let failure = Failure::input(text.trim()).hint("see: diaphane --help");
            println!("{}", failure.json());
            return ExitCode::from(2);
        }
        Err(error) => {
            let code = u8::try_from(error.exit_code()).unwrap_or(2);
            // A closed pipe is the reader's business.
            let _ = error.print();
            return ExitCode::from(code);
        }
    };
    // Without a handler Ctrl-C still works: it just ends the program at once.
    let _ = ctrlc::set_handler(|| {
        if !STOP.swap(true, Ordering::Relaxed) {
            eprintln!("stopping at the next good place; once more to stop now");
            return;
        }
        let parking = PARK.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(parking) = parking {
            eprintln!("putting the devices away");
            for error in parking.park(PARKING) {
                eprintln!("error: {error}");
            }
        }
        std::process::exit(130);
    });
    match run(cli.command) {
        Ok(done) => {
            if !done.text.is_empty() {
                eprintln!("{}", done.text);
            }
            if cli.json {
                println!("{}", done.json);
            }
            ExitCode::SUCCESS
        }
        Err(failure) => {
            // Further lines below the first.
            eprintln!("error: {}", failure.error.replace('\n', "\n       "));
            if let Some(hint) = &failure.hint {
                eprintln!(" hint: {}", hint.replace('\n', "\n       "));
            }
            if cli.json {
                println!("{}", failure.json());
            }
            ExitCode::from(failure.code)
        }
    }
}

/// `--lambda -1` is a value and not a flag, so that what is wrong with it is told.
fn numbers_may_be_negative(command: clap::Command) -> clap::Command {
    let names: Vec<String> =
        command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    let command = command.mut_args(|arg| {
        let takes = arg.get_action().takes_values();
        if takes { arg.allow_negative_numbers(true) } else { arg }
    });
    names
        .into_iter()
        .fold(command, |command, name| command.mut_subcommand(name, numbers_may_be_negative))
}

fn run(command: Command) -> Result<Done, Failure> {
    match command {
        Command::Init(args) => init::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Rig(args) => rig::run(&args),
        Command::Plan(args) => plan::run(&args),
        Command::Preview(args) => preview::run(&args),
        Command::Capture(args) => capture::run(&args),
        Command::Branch(args) => branch::run(&args),
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Status(args) => status::run(&args),
        Command::Solve(args) => solve::run(&args),
        Command::Verify(args) => verify::run(&args),
        Command::Export(args) => export::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Forward(args) => forward::run(&args),
        Command::Study(args) => study::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Window { monitor } => {
            ::rig::devices::display::run_window(&monitor)?;
            Ok(Done::new(serde_json::Value::Null, ""))
        }
    }
}
