//! Which device does the work, as it is written on a command line.

use super::{Gpu, GpuError};
use std::str::FromStr;

/// `auto`, `cpu`, `gpu` or `gpu:NAME`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DeviceChoice {
    /// A GPU if there is one in hardware, else the CPU.
    Auto,
    /// The CPU.
    Cpu,
    /// A GPU, the one whose name contains this; one made of software too.
    Gpu(Option<String>),
}

impl FromStr for DeviceChoice {
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

impl DeviceChoice {
    /// The GPU to work on; `None` stands for the CPU.
    ///
    /// # Errors
    /// One was asked for and there is none, or it will not do.
    pub fn gpu(&self) -> Result<Option<Gpu>, GpuError> {
        match self {
            Self::Cpu => Ok(None),
            Self::Auto if !may_have_hardware() => Ok(None),
            Self::Auto => Ok(Gpu::open(None).ok().filter(|gpu| !gpu.is_software())),
            Self::Gpu(name) => Ok(Some(Gpu::open(name.as_deref())?)),
        }
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
    use super::DeviceChoice;

    #[test]
    fn devices_are_read_as_they_are_written() {
        assert_eq!("auto".parse(), Ok(DeviceChoice::Auto));
        assert_eq!("cpu".parse(), Ok(DeviceChoice::Cpu));
        assert_eq!("gpu".parse(), Ok(DeviceChoice::Gpu(None)));
        assert_eq!("gpu:RTX 4090".parse(), Ok(DeviceChoice::Gpu(Some("RTX 4090".into()))));
        for wrong in ["", "gpu:", "cpu:2", "cuda", "GPU"] {
            assert!(wrong.parse::<DeviceChoice>().is_err(), "{wrong}");
        }
    }
}
