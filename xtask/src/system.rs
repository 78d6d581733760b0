//! The system packages that the build needs.

use std::process::{Command, Stdio};

use crate::Stop;

/// A need, and the packages that meet it, best first: names differ between releases.
struct Need {
    packages: &'static [&'static str],
    what_for: &'static str,
}

const NEEDS: &[Need] = &[
    Need { packages: &["g++"], what_for: "compiles the bindings to OpenCV" },
    Need { packages: &["pkg-config", "pkgconf"], what_for: "finds OpenCV" },
    Need { packages: &["libopencv-dev"], what_for: "OpenCV, for calibration" },
    Need { packages: &["clang"], what_for: "reads OpenCV's headers" },
    Need { packages: &["libclang1", "libclang-dev"], what_for: "reads OpenCV's headers" },
    Need { packages: &["libaravis-dev"], what_for: "GigE Vision and USB3 Vision cameras" },
    Need { packages: &["libusb-1.0-0-dev"], what_for: "missing from what libaravis-dev asks for" },
    Need { packages: &["libgphoto2-dev"], what_for: "tethered still cameras" },
    Need { packages: &["linux-libc-dev"], what_for: "video devices (/dev/video0)" },
    Need { packages: &["libvulkan1"], what_for: "Vulkan, for computing on the GPU" },
    Need { packages: &["mesa-vulkan-drivers"], what_for: "Vulkan where there is no GPU" },
    Need { packages: &["libx11-xcb1"], what_for: "the projector's window" },
    Need { packages: &["libxcursor1"], what_for: "the projector's window" },
    Need { packages: &["libxi6"], what_for: "the projector's window" },
    Need { packages: &["libxkbcommon-x11-0"], what_for: "the projector's window" },
    Need { packages: &["xvfb"], what_for: "a screen in memory, for tests and the twin" },
    Need { packages: &["imagemagick"], what_for: "looks at screens, for tests" },
    Need { packages: &["chromium", "chromium-browser"], what_for: "looks at reports, for tests" },
    Need { packages: &["python3-openvdb"], what_for: "reads exported volumes, for tests" },
    Need { packages: &["libopenvdb-tools"], what_for: "reads exported volumes, for tests" },
    Need { packages: &["xserver-xorg-core"], what_for: "two screens in memory, for tests" },
    Need { packages: &["xserver-xorg-video-dummy"], what_for: "two screens in memory, for tests" },
    Need { packages: &["x11-xserver-utils"], what_for: "two screens in memory, for tests" },
];

/// Makes sure that the packages are there: installs them where there is the right to, else
/// says what to type.
pub fn setup() -> Result<(), Stop> {
    match std::env::consts::OS {
        "linux" if succeeds("dpkg-query", &["--version"]) => debian(),
        "linux" => {
            eprintln!(
                "This is no Debian or Ubuntu: please see to it that a C++ compiler, pkg-config, \
                 OpenCV 4 with its contrib modules, clang with libclang, Aravis 0.8.25 or later, \
                 gphoto2, and a Vulkan driver are installed. Going on."
            );
            Ok(())
        }
        "macos" => {
            by_hand("brew install opencv llvm pkg-config molten-vk vulkan-loader");
            Ok(())
        }
        "windows" => {
            by_hand("choco install opencv llvm");
            Ok(())
        }
        other => Err(Stop::usage(format!("expected Linux, macOS or Windows, found {other}"))),
    }
}

fn by_hand(line: &str) {
    eprintln!("Not installed from here and not tested; if the build misses something, try\n");
    eprintln!("    {line}\n");
}

fn debian() -> Result<(), Stop> {
    let missing: Vec<&Need> =
        NEEDS.iter().filter(|need| !need.packages.iter().any(|p| installed(p))).collect();
    if missing.is_empty() {
        return Ok(());
    }
    eprintln!("System packages that are missing:");
    for need in &missing {
        eprintln!("    {:<22}{}", need.packages[0], need.what_for);
    }

    let root = output("id", &["-u"]).is_some_and(|id| id.trim() == "0");
    let prefix: &[&str] = if root {
        &[]
    } else if succeeds("sudo", &["-n", "true"]) {
        &["sudo", "-n"]
    } else {
        let names: Vec<&str> = missing.iter().map(|need| available(need)).collect();
        return Err(Stop::usage(format!(
            "They cannot be installed without a password. Please run\n\n    sudo apt-get update && \
             sudo apt-get install -y --no-install-recommends {}\n\nand then this command again.",
            names.join(" ")
        )));
    };
    apt(prefix, &["update"])?;
    // Only now does apt know which names this release has.
    let names: Vec<&str> = missing.iter().map(|need| available(need)).collect();
    apt(prefix, &[&["install", "-y", "--no-install-recommends"], &names[..]].concat())
}

/// The first of a need's packages that apt can install; the first of all where it knows none.
fn available(need: &Need) -> &'static str {
    let known = |package: &&&str| {
        output("apt-cache", &["policy", package]).is_some_and(|policy| {
            policy.lines().any(|line| {
                line.trim().strip_prefix("Candidate:").is_some_and(|v| v.trim() != "(none)")
            })
        })
    };
    need.packages.iter().find(known).unwrap_or(&need.packages[0])
}

fn installed(package: &str) -> bool {
    let state = output("dpkg-query", &["-W", "-f=${db:Status-Status}\n", package]);
    state.is_some_and(|state| state.lines().any(|line| line == "installed"))
}

fn apt(prefix: &[&str], arguments: &[&str]) -> Result<(), Stop> {
    let words = [prefix, &["env", "DEBIAN_FRONTEND=noninteractive", "apt-get"], arguments].concat();
    let line = words.join(" ");
    eprintln!("$ {line}");
    let status = Command::new(words[0]).args(&words[1..]).stdin(Stdio::null()).status();
    match status {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(Stop::failed(format!("`{line}` ended with {status}"))),
        Err(error) => Err(Stop::failed(format!("`{line}` cannot be started: {error}"))),
    }
}

fn succeeds(program: &str, arguments: &[&str]) -> bool {
    output(program, arguments).is_some()
}

/// What a program prints, if it runs and succeeds. Untranslated, so that it can be read.
fn output(program: &str, arguments: &[&str]) -> Option<String> {
    let mut command = Command::new(program);
    command.args(arguments).env("LC_ALL", "C").stdin(Stdio::null()).stderr(Stdio::null());
    let output = command.output().ok().filter(|output| output.status.success())?;
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}
