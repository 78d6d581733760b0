//! The way out where a part of a rig cannot be used: what helps depends on what it is and where.

use super::rules::port_rule;
use ::rig::{Address, DeviceErrorKind};
use std::path::Path;

/// What a device of a rig is for.
#[derive(Clone, Copy)]
pub(super) enum Part {
    /// What shows the projector's picture.
    Picture,
    /// What switches the projector.
    Control,
    Stage,
    /// The program that puts things on the bench.
    Hands,
}

impl Part {
    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Picture => "projector",
            Self::Control => "projector control",
            Self::Stage => "stage",
            Self::Hands => "hands",
        }
    }
}

/// A device of a rig that was asked for something.
pub(super) struct Asked<'a> {
    pub part: Part,
    pub address: Option<Address>,
    /// The command that asked.
    pub command: Command,
    /// The rig as it was named, for commands.
    pub rig: &'a Path,
}

/// Commands that ask devices.
#[derive(Clone, Copy)]
pub(super) enum Command {
    List,
    Test,
    Park,
    Halt,
}

impl Asked<'_> {
    /// What to do about what went wrong with it.
    pub fn advice(&self, kind: DeviceErrorKind) -> Option<String> {
        let at_port = match &self.address {
            Some(Address::Serial(path)) => port(kind, path),
            _ => None,
        };
        at_port.or_else(|| match self.part {
            Part::Picture => picture(kind),
            Part::Control => self.control(kind),
            Part::Stage => self.stage(kind),
            Part::Hands => self.hands(kind),
        })
    }

    fn control(&self, kind: DeviceErrorKind) -> Option<String> {
        use DeviceErrorKind as K;
        Some(match (kind, &self.address) {
            (K::NotFound, Some(Address::Tcp(host, _))) => format!(
                "is it plugged in, and its network control switched on in its menu, also in stand-by? Is {host} its address, and the port right?"
            ),
            (K::Timeout | K::Disconnected, Some(Address::Tcp(host, port))) => format!(
                "is {host} the projector's address (its network menu shows it), its network cable plugged in, PJLink switched on in its menu, and no firewall between? Does it answer at all: ping {host}; nc {host} {port} should print PJLINK"
            ),
            (K::Protocol, Some(Address::Tcp(host, port))) => {
                format!("what answers at {host}, port {port}, speaks no PJLink: is that the projector?")
            }
            (K::Declined, Some(Address::Tcp(..))) => {
                "the password of the projector's network menu goes into the rig file: password = \"...\" under [projector.control]".into()
            }
            (K::Timeout | K::Protocol, Some(Address::Serial(_))) => {
                "is it plugged in, its serial port switched on in its menu (also in stand-by), the cable the right one (crossed or not), and baud that of its menu?".into()
            }
            (K::Fault, _) => {
                "look at the projector: its lights and its menu say what is wrong".into()
            }
            (K::Busy, _) => "it is warming up or cooling down: wait a minute".into(),
            _ => return None,
        })
    }

    fn stage(&self, kind: DeviceErrorKind) -> Option<String> {
        use DeviceErrorKind as K;
        Some(match kind {
            // Many forget it again when their port is closed: each command homes for itself.
            K::NotHomed if matches!(self.command, Command::List) => format!(
                "nothing is wrong: a capture homes it by itself where the rig file has [[places]]; to try it: {}",
                self.with("--home")
            ),
            K::NotHomed => format!("see that its way is free, then: {}", self.with("--home")),
            K::Fault => format!(
                "look at the stage; then home it: {}; or, if that cannot be: diaphane rig test {} --unlock",
                self.with("--home"),
                self.rig.display()
            ),
            K::Timeout | K::Protocol => {
                "is its power on, is this its port, and baud the speed of its controller? What is at which port: diaphane rig list".into()
            }
            _ => return None,
        })
    }

    fn hands(&self, kind: DeviceErrorKind) -> Option<String> {
        use DeviceErrorKind as K;
        Some(match kind {
            K::NotFound => {
                "is there such a file? Its full path goes into the rig file: program = \"/...\" under [hands]".into()
            }
            K::NoPermission => {
                "make a program of it: chmod +x, and a first line such as #!/bin/sh".into()
            }
            _ => return None,
        })
    }

    /// The same command, or the one that tries devices, with a flag more.
    fn with(&self, flag: &str) -> String {
        let command = match self.command {
            Command::Park => "park",
            Command::List | Command::Test | Command::Halt => "test",
        };
        format!("diaphane rig {command} {} {flag}", self.rig.display())
    }
}

/// What to do about a serial port, whatever is at it.
pub(super) fn port(kind: DeviceErrorKind, path: &str) -> Option<String> {
    use DeviceErrorKind as K;
    Some(match kind {
        K::NoPermission => port_rule(path),
        K::Busy => format!("another program has it; find out which: fuser {path}"),
        K::NotFound | K::Disconnected => {
            "is it plugged in? The ports that are there: diaphane rig list".into()
        }
        K::Unsupported if !path.starts_with("/dev/") => {
            "a port is a device, such as /dev/ttyUSB0; those that are there: diaphane rig list"
                .into()
        }
        _ => return None,
    })
}

/// What to do about the monitor that a projector is.
pub(super) fn picture(kind: DeviceErrorKind) -> Option<String> {
    use DeviceErrorKind as K;
    Some(match kind {
        K::NotFound => {
            "is the projector plugged in and switched on, and a desktop with X running (DISPLAY is its name)? What is there: diaphane rig list".into()
        }
        K::MissingDriver => {
            "build with it: cargo build --release (it is part of the default features, on Linux)".into()
        }
        K::Unsupported => {
            "a Vulkan driver has to be there; where the graphics device has none: sudo apt-get install mesa-vulkan-drivers".into()
        }
        _ => return None,
    })
}

/// Hints for all that went wrong, each with its device's name where there are several.
pub(super) fn together<'a>(hints: impl Iterator<Item = (&'a str, &'a str)>) -> Option<String> {
    let hints: Vec<_> = hints.collect();
    match hints.as_slice() {
        [] => None,
        [(_, hint)] => Some((*hint).to_owned()),
        several => {
            let named: Vec<_> =
                several.iter().map(|(name, hint)| format!("{name}: {hint}")).collect();
            Some(named.join("\n"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use DeviceErrorKind as K;

    #[test]
    fn a_silent_device_is_given_the_advice_of_its_own_kind() {
        let rig = Path::new("my-twin/rig.toml");
        let advice = |part, address, kind| {
            Asked { part, address, command: Command::Test, rig }.advice(kind).unwrap_or_default()
        };
        let serial = || Some(Address::Serial("/dev/ttyUSB0".into()));
        let network = || Some(Address::Tcp("10.0.0.7".into(), 4352));
        for (part, address, kind, words, not) in [
            (Part::Control, network(), K::Timeout, "PJLink switched on", "crossed"),
            (Part::Control, network(), K::NotFound, "10.0.0.7", "home"),
            (Part::Control, network(), K::Declined, "password", "home"),
            (Part::Control, network(), K::Fault, "lights", "home"),
            (Part::Control, serial(), K::Timeout, "crossed", "firewall"),
            (Part::Stage, serial(), K::Timeout, "baud", "crossed"),
            (Part::Stage, serial(), K::NotHomed, "rig test my-twin/rig.toml --home", "--unlock"),
            (Part::Stage, serial(), K::Fault, "rig test my-twin/rig.toml --unlock", "RIG"),
            (Part::Stage, serial(), K::Busy, "fuser /dev/ttyUSB0", "minute"),
            (Part::Hands, None, K::NotFound, "[hands]", "plugged"),
        ] {
            let said = advice(part, address, kind);
            assert!(said.contains(words) && !said.contains(not), "{kind:?}: {said}");
        }
    }

    #[test]
    fn every_device_has_its_hint() {
        let all = together([("camera", "plug it in"), ("stage", "home it")].into_iter());
        assert_eq!(all.as_deref(), Some("camera: plug it in\nstage: home it"));
        let one = together([("camera", "plug it in")].into_iter());
        assert_eq!(one.as_deref(), Some("plug it in"));
        assert_eq!(together(std::iter::empty()), None);
    }
}
