//! Materials out of other programs' files, and what such a file leaves open.

use std::path::Path;

use crate::header::{ChannelHeader, Header, Optional};
use crate::{Face, FileError, Grid, Material, Optics, Provenance, diffusion_and_absorption};

/// A material, and what had to be assumed because its file does not tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// The material.
    pub material: Material,
    /// In words, one thing each; empty where the file tells everything.
    pub assumed: Vec<String>,
}

/// A material without its voxels, as told or as assumed.
pub(crate) struct Known {
    pub header: Header,
    pub assumed: Vec<String>,
}

impl Known {
    /// From the JSON that our writers leave in other programs' files.
    pub fn told(json: &[u8]) -> Result<Self, String> {
        let header = serde_json::from_slice(json)
            .map_err(|e| format!("what it says of the material cannot be understood: {e}"))?;
        Ok(Self { header, assumed: Vec::new() })
    }

    /// Where there is nothing but volumes of one or three channels: what is said in `assumed`.
    pub fn nothing(grid: Grid, channels: usize) -> Self {
        let names: &[&str] = if channels == 3 { &["R", "G", "B"] } else { &["Y"] };
        let channel = |name: &&str| ChannelHeader { name: (*name).into(), gain: 1.0 };
        let header = Header {
            grid,
            channels: names.iter().map(channel).collect(),
            optics: Optics::from_eta(1.0),
            lit_face: Face::Back,
            provenance: Provenance { software: "unknown".into(), ..Provenance::default() },
        };
        let assumed = vec![
            "refractive index 1 and the boundary convention transport".into(),
            "acquired with light on the back face".into(),
        ];
        Self { header, assumed }
    }

    /// The material, from κ and μ channel by channel in the sample's frame.
    pub fn material(
        self,
        path: &Path,
        kappa: Vec<Vec<f32>>,
        mu: Vec<Vec<f32>>,
    ) -> Result<Reading, FileError> {
        self.whole(path, kappa, mu, Optional::default())
    }

    /// The same with what else the file tells.
    pub fn whole(
        self,
        path: &Path,
        kappa: Vec<Vec<f32>>,
        mu: Vec<Vec<f32>>,
        optional: Optional,
    ) -> Result<Reading, FileError> {
        let material = self.header.material(kappa, mu, optional, path)?;
        Ok(Reading { material, assumed: self.assumed })
    }
}

/// κ in mm and μ in 1/mm from σa and σs' per `unit_mm`, channel by channel.
pub(crate) fn from_sigma(
    sigma_a: &[Vec<f32>],
    sigma_s: &[Vec<f32>],
    unit_mm: f64,
) -> [Vec<Vec<f32>>; 2] {
    let (mut kappa, mut mu) = (Vec::new(), Vec::new());
    for (a, s) in sigma_a.iter().zip(sigma_s) {
        let pairs = a.iter().zip(s);
        let both = pairs.map(|(&a, &s)| {
            diffusion_and_absorption(f64::from(a) / unit_mm, f64::from(s) / unit_mm)
        });
        let (k, m) = both.unzip();
        kappa.push(k);
        mu.push(m);
    }
    [kappa, mu]
}

/// From the renderers' frame to the sample's, or back: half a turn about the x axis.
pub(crate) fn half_turn([nx, ny, nz]: [usize; 3], values: &[f32]) -> Vec<f32> {
    let mut out = Vec::with_capacity(values.len());
    for z in (0..nz).rev() {
        for y in (0..ny).rev() {
            let row = (z * ny + y) * nx;
            out.extend(&values[row..row + nx]);
        }
    }
    out
}
