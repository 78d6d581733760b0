//! Whoever puts things on the bench, and the stage that takes them to their place.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::controlled::{Shared, lock};
use crate::devices::{Coordinate, Stage};
use crate::{Bench, DeviceError, Target};

/// Time that a stage has for one axis.
const MOVE: Duration = Duration::from_secs(180);
/// Between two looks at whether a program has ended.
const BLINK: Duration = Duration::from_millis(20);

/// A program that is called for every placement, with the target as JSON, and has done it when it
/// returns 0: a robot, a carousel, a message to somebody's telephone.
pub struct HandsProgram {
    program: String,
    limit: Duration,
}

impl HandsProgram {
    /// `program` is looked for as the system does; it is stopped after `limit`.
    pub fn new(program: &str, limit: Duration) -> Self {
        Self { program: program.into(), limit }
    }

    /// Where the program is; it is not called.
    ///
    /// # Errors
    /// `NotFound`, or `NoPermission` where there is a file of that name that is no program.
    pub fn find(&self) -> Result<PathBuf, DeviceError> {
        let device = format!("hands program {}", self.program);
        let named = Path::new(&self.program);
        let mut candidates = if named.components().count() > 1 || named.is_absolute() {
            vec![named.to_owned()]
        } else {
            let path = std::env::var_os("PATH").unwrap_or_default();
            std::env::split_paths(&path).map(|folder| folder.join(named)).collect()
        };
        candidates.retain(|path| path.is_file());
        match candidates.iter().position(|path| may_be_called(path)) {
            Some(found) => Ok(candidates.swap_remove(found)),
            None if candidates.is_empty() => Err(DeviceError::NotFound { device }),
            None => Err(DeviceError::NoPermission { device, path: self.program.clone() }),
        }
    }
}

#[cfg(unix)]
fn may_be_called(path: &Path) -> bool {
    use std::os::unix::fs::PermissionsExt;
    path.metadata().is_ok_and(|there| there.permissions().mode() & 0o111 != 0)
}

#[cfg(not(unix))]
fn may_be_called(_: &Path) -> bool {
    true
}

impl Bench for HandsProgram {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        let device = || self.program.clone();
        let json = serde_json::to_string(target)
            .map_err(|e| DeviceError::Unsupported { device: device(), reason: e.to_string() })?;
        // What it prints is for people; standard output belongs to results.
        let child = Command::new(&self.program)
            .arg(json)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn();
        let mut child = child.map_err(|error| match error.kind() {
            std::io::ErrorKind::PermissionDenied => {
                DeviceError::NoPermission { device: device(), path: self.program.clone() }
            }
            _ => DeviceError::Unsupported {
                device: device(),
                reason: format!("cannot be started: {error}"),
            },
        })?;
        let until = Instant::now() + self.limit;
        loop {
            match child.try_wait() {
                Ok(Some(status)) if status.success() => return Ok(()),
                Ok(Some(status)) => {
                    let reason = format!("{target} was not placed: {status}");
                    return Err(DeviceError::Declined { device: device(), reason });
                }
                Ok(None) if Instant::now() < until => std::thread::sleep(BLINK),
                Ok(None) => {
                    // It may be gone by now, which is as well.
                    let _ = child.kill();
                    let _ = child.wait();
                    // Not a time-out that would be repeated: it may have done half of its work.
                    let reason =
                        format!("{target} was not placed within {} s", self.limit.as_secs_f64());
                    return Err(DeviceError::Declined { device: device(), reason });
                }
                Err(error) => {
                    let reason = format!("cannot be waited for: {error}");
                    return Err(DeviceError::Unsupported { device: device(), reason });
                }
            }
        }
    }
}

/// Where a stage's axes are for a kind of target.
pub(crate) type Places = BTreeMap<&'static str, Vec<(usize, Coordinate)>>;

/// Moves the stage to where the target belongs before it is put there.
pub(crate) struct StagedBench {
    pub hands: Box<dyn Bench>,
    pub stage: Shared<dyn Stage>,
    pub places: Places,
}

impl Bench for StagedBench {
    fn place(&mut self, target: &Target) -> Result<(), DeviceError> {
        for &(axis, to) in self.places.get(target.place()).map_or(&[][..], Vec::as_slice) {
            lock(&self.stage).move_to(axis, to, MOVE)?;
        }
        self.hands.place(target)
    }

    fn park(&mut self) -> Result<(), DeviceError> {
        self.hands.park()?;
        lock(&self.stage).park(MOVE)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DeviceErrorKind;

    /// The program gets the target, and its exit status decides.
    #[test]
    #[cfg(unix)]
    fn a_program_places_things_or_says_no() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hands.sh");
        let told = folder.path().join("told");
        let script = format!(
            "#!/bin/sh\necho \"$1\" >> {}\ncase \"$1\" in *dark*) exit 3;; *flat*) sleep 60;; esac\n",
            told.display()
        );
        std::fs::write(&path, script).unwrap();
        let mut hands = HandsProgram::new(path.to_str().unwrap(), Duration::from_millis(300));
        assert_eq!(hands.place(&Target::Sample).unwrap_err().kind(), DeviceErrorKind::NoPermission);
        assert_eq!(hands.find().unwrap_err().kind(), DeviceErrorKind::NoPermission);
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        assert_eq!(hands.find().unwrap(), path);
        assert!(!told.exists(), "it is looked for, not called");
        hands.place(&Target::Board { pose: 2 }).unwrap();
        let json = std::fs::read_to_string(&told).unwrap();
        let target: Target = serde_json::from_str(json.trim()).unwrap();
        assert_eq!(target, Target::Board { pose: 2 });
        let no = hands.place(&Target::Dark).unwrap_err();
        assert!(no.to_string().contains("exit status: 3"), "{no}");
        let late = hands.place(&Target::Flat).unwrap_err();
        assert_eq!(late.kind(), DeviceErrorKind::Declined);
        assert!(late.to_string().contains("within 0.3 s"), "{late}");
        let mut missing = HandsProgram::new("/not/there", Duration::from_secs(1));
        assert_eq!(missing.find().unwrap_err().kind(), DeviceErrorKind::NotFound);
        assert_eq!(missing.place(&Target::Dark).unwrap_err().kind(), DeviceErrorKind::Unsupported);
        // As the system does: by its name alone on PATH, whatever lies in this folder.
        let shell = HandsProgram::new("sh", Duration::from_secs(1)).find().unwrap();
        assert!(shell.is_absolute() && shell.ends_with("sh"), "{}", shell.display());
        let nowhere = HandsProgram::new("Cargo.toml", Duration::from_secs(1)).find();
        assert_eq!(nowhere.unwrap_err().kind(), DeviceErrorKind::NotFound);
    }
}
