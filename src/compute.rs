//! What does the work of a solve: the CPU, or a GPU.

use crate::Failure;
use diffusion::{CpuSolver, Gpu, GpuSolver, LinearSolver};
use std::str::FromStr;

/// `--device auto|cpu|gpu[:name]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Device {
    /// A GPU if there is one in hardware, else the CPU.
    Auto,
    Cpu,
    /// A GPU, the one whose name contains this; one made of software too.
    Gpu(Option<String>),
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            None if text == "auto" => Ok(Self::Auto),
            None if text == "cpu" => Ok(Self::Cpu),
            None if text == "gpu" => Ok(Self::Gpu(None)),
            Some(("gpu", name)) if !name.is_empty() => Ok(Self::Gpu(Some(name.into()))),
            _ => Err("expected auto, cpu, gpu or gpu:NAME".into()),
        }
    }
}

/// The least relative residual that single precision reaches on any block, with some to spare.
const SINGLE: f64 = 3e-7;

impl Device {
    /// The GPU to work on; `None` stands for the CPU.
    ///
    /// # Errors
    /// One was asked for and there is none, or it will not do.
    pub fn gpu(&self) -> Result<Option<Gpu>, Failure> {
        match self {
            Self::Cpu => Ok(None),
            Self::Auto if !may_have_hardware() => Ok(None),
            Self::Auto => Ok(Gpu::open(None).ok().filter(|gpu| !gpu.is_software())),
            Self::Gpu(name) => Ok(Some(Gpu::open(name.as_deref())?)),
        }
    }

    /// A solver for a relative residual, and the name of what it works on.
    ///
    /// # Errors
    /// As [`Device::gpu`].
    pub fn solver(&self, tolerance: f64) -> Result<(Box<dyn LinearSolver>, String), Failure> {
        let gpu = match self {
            Self::Auto if tolerance < SINGLE => None,
            device => device.gpu()?,
        };
        Ok(match gpu {
            None => (Box::new(CpuSolver::<f32>::new()), "CPU".into()),
            Some(gpu) => {
                let name = gpu.name().to_owned();
                (Box::new(GpuSolver::new(gpu)), name)
            }
        })
    }
}

/// Whether looking for a GPU is worth the half second that it takes, and the complaints about
/// displays that drivers made of software have without one.
fn may_have_hardware() -> bool {
    if !cfg!(target_os = "linux") {
        return true;
    }
    let render_node = |entry: std::io::Result<std::fs::DirEntry>| {
        entry.is_ok_and(|e| e.file_name().to_string_lossy().starts_with("renderD"))
    };
    let others = ["/dev/nvidia0", "/dev/nvidiactl", "/dev/dxg"];
    others.iter().any(|path| std::path::Path::new(path).exists())
        || std::fs::read_dir("/dev/dri").is_ok_and(|mut nodes| nodes.any(render_node))
}

#[cfg(test)]
mod tests {
    use super::Device;

    #[test]
    fn devices_are_read_as_they_are_written() {
        assert_eq!("auto".parse(), Ok(Device::Auto));
        assert_eq!("cpu".parse(), Ok(Device::Cpu));
        assert_eq!("gpu".parse(), Ok(Device::Gpu(None)));
        assert_eq!("gpu:RTX 4090".parse(), Ok(Device::Gpu(Some("RTX 4090".into()))));
        for wrong in ["", "gpu:", "cpu:2", "cuda", "GPU"] {
            assert!(wrong.parse::<Device>().is_err(), "{wrong}");
        }
    }
}
