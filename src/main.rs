//! The `diaphane` command.

fn main() -> std::process::ExitCode {
    diaphane::cli::main()
}
