//! The part of a material that is not voxels, as JSON: shared by all formats.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{
    Channel, Face, FileError, Grid, Material, Optics, Provenance, Resolution, ScatteringMedium,
    Surface,
};

/// Its name where a format has named places for text.
pub(crate) const KEY: &str = "diaphane_header";

/// A material without its arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Header {
    pub grid: Grid,
    pub channels: Vec<ChannelHeader>,
    pub optics: Optics,
    pub lit_face: Face,
    pub provenance: Provenance,
}

/// What a material may have beside κ and μ, channel by channel.
#[derive(Default)]
pub(crate) struct Optional {
    pub resolution: Option<Vec<Resolution>>,
    pub surface: Option<Vec<Surface>>,
}

/// A channel without its arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ChannelHeader {
    pub name: String,
    pub gain: f64,
}

impl Header {
    pub(crate) fn of(material: &Material) -> Self {
        let channel = |c: &Channel| ChannelHeader { name: c.name.clone(), gain: c.gain };
        Self {
            grid: *material.grid(),
            channels: material.channels().iter().map(channel).collect(),
            optics: *material.optics(),
            lit_face: material.lit_face(),
            provenance: material.provenance().clone(),
        }
    }

    /// The material again, from κ and μ channel by channel in the sample's frame, and from what else
    /// is known of it; `path` is for messages.
    pub(crate) fn material(
        self,
        kappa: Vec<Vec<f32>>,
        mu: Vec<Vec<f32>>,
        Optional { resolution, surface }: Optional,
        path: &Path,
    ) -> Result<Material, FileError> {
        let Self { grid, channels, optics, lit_face, provenance } = self;
        let channels = channels.into_iter().zip(kappa).zip(mu);
        let channels = channels.map(|((channel, kappa_mm), mu_per_mm)| Channel {
            name: channel.name,
            kappa_mm,
            mu_per_mm,
            gain: channel.gain,
        });
        Material::new(grid, channels.collect(), optics, lit_face, provenance)
            .and_then(|material| match resolution {
                Some(resolution) => material.with_resolution(resolution),
                None => Ok(material),
            })
            .and_then(|material| match surface {
                Some(surface) => material.with_surface(surface),
                None => Ok(material),
            })
            .map_err(|source| FileError::NotAMaterial { path: path.into(), source })
    }

    /// As JSON in ASCII, for formats and programs that lose all other letters.
    pub(crate) fn ascii(&self) -> std::io::Result<String> {
        Ok(escaped(&serde_json::to_string(self)?))
    }
}

/// The same JSON without letters beyond ASCII, which stand in its texts alone.
fn escaped(json: &str) -> String {
    let mut out = String::with_capacity(json.len());
    for unit in json.encode_utf16() {
        match u8::try_from(unit) {
            Ok(byte) if byte.is_ascii() => out.push(char::from(byte)),
            _ => out.push_str(&format!("\\u{unit:04x}")),
        }
    }
    out
}

/// What goes along with a renderer's format, where it has a place for text.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct About {
    /// Symbol of the unit of length.
    pub scene_unit: String,
    /// Values whose scattering was set to zero.
    pub clamped: usize,
    /// The material without its voxels.
    #[serde(flatten)]
    pub header: Header,
}

impl About {
    pub(crate) fn of(medium: &ScatteringMedium<'_>) -> Self {
        let (scene_unit, clamped) = (medium.unit().symbol().into(), medium.clamped());
        Self { scene_unit, clamped, header: Header::of(medium.material()) }
    }

    /// On one line.
    pub(crate) fn json(&self) -> std::io::Result<String> {
        Ok(serde_json::to_string(self)?)
    }

    /// The same in ASCII.
    pub(crate) fn ascii(&self) -> std::io::Result<String> {
        Ok(escaped(&self.json()?))
    }
}
