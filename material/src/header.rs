//! The part of a material that is not voxels, as JSON: shared by the native form and `.npz`.

use serde::{Deserialize, Serialize};

use crate::{Channel, Face, Grid, Material, Optics, Provenance, ScatteringMedium};

/// A material without its arrays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Header {
    pub grid: Grid,
    pub channels: Vec<ChannelHeader>,
    pub optics: Optics,
    pub lit_face: Face,
    pub provenance: Provenance,
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

    /// As JSON in ASCII, for formats and programs that lose all other letters.
    pub(crate) fn ascii(&self) -> std::io::Result<String> {
        let json = serde_json::to_string(self)?;
        let mut out = String::with_capacity(json.len());
        for unit in json.encode_utf16() {
            match u8::try_from(unit) {
                Ok(byte) if byte.is_ascii() => out.push(char::from(byte)),
                _ => out.push_str(&format!("\\u{unit:04x}")),
            }
        }
        Ok(out)
    }
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
}
