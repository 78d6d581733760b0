//! glTF 2.0 (`.gltf`): a box of the block's size with one homogeneous material.
//!
//! `KHR_materials_volume` and `KHR_materials_volume_scatter` carry the average σt and the albedo
//! of multiple scattering; `KHR_materials_ior` the refractive index. glTF's unit is the metre.

use std::io::Write;
use std::path::Path;

use base64::Engine;
use serde_json::{Value, json};

use crate::average::Average;
use crate::header::About;
use crate::{FileError, Overwrite, ScatteringMedium, SceneUnit, atomic_write};

/// Writes the box and its material; what is known of the material stands in `asset.extras`.
///
/// # Errors
/// Another number of channels than 1 or 3, the file is there already and `overwrite` refuses, or
/// the system does.
pub fn write(
    path: &Path,
    medium: &ScatteringMedium<'_>,
    overwrite: Overwrite,
) -> Result<(), FileError> {
    medium.one_or_three(path, "glTF")?;
    atomic_write(path, overwrite, |file| {
        serde_json::to_writer_pretty(&mut *file, &document(medium)?)?;
        file.write_all(b"\n")
    })
}

fn document(medium: &ScatteringMedium<'_>) -> std::io::Result<Value> {
    let metre = SceneUnit::Metre.millimetres();
    let to_metres = metre / medium.unit().millimetres();
    let size = medium.size().map(|length| length / to_metres);
    let average = Average::colours(medium);
    let extinction = average.map(|a| a.sigma_t() * to_metres);
    // One mean free path in the densest channel: colours are then well inside 0 to 1.
    let distance = 1.0 / extinction.into_iter().fold(f64::MIN_POSITIVE, f64::max);
    let attenuation = extinction.map(|sigma_t| (-sigma_t * distance).exp());
    let scatter = average.map(|a| a.multiple_albedo());
    let optics = medium.material().optics();
    let provenance = medium.material().provenance();
    let (buffer, positions) = box_mesh(size);
    let extensions = json!({
        "KHR_materials_volume": {
            "thicknessFactor": size[2],
            "attenuationDistance": distance,
            "attenuationColor": attenuation,
        },
        "KHR_materials_volume_scatter": { "multiscatterColor": scatter, "scatterAnisotropy": 0.0 },
        "KHR_materials_ior": { "ior": optics.eta },
        // Said to be right for media as dense as these.
        "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 1.0 },
    });
    let used: Vec<&String> =
        extensions.as_object().map(|all| all.keys().collect()).unwrap_or_default();
    Ok(json!({
        "asset": {
            "version": "2.0",
            "generator": format!("{} {}", provenance.software, provenance.version),
            "extras": About::of(medium),
        },
        "extensionsUsed": used,
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "block" }],
        "meshes": [{ "primitives": [{
            "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 2, "material": 0
        }] }],
        "materials": [{
            "name": "average",
            "pbrMetallicRoughness": {
                "baseColorFactor": [1.0, 1.0, 1.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.0
            },
            "extensions": extensions,
            "extras": { "sigma_a_per_m": average.map(|a| a.sigma_a * to_metres),
                        "sigma_s_reduced_per_m": average.map(|a| a.sigma_s * to_metres) },
        }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 24, "type": "VEC3",
              "min": positions[0], "max": positions[1] },
            { "bufferView": 1, "componentType": 5126, "count": 24, "type": "VEC3" },
            { "bufferView": 2, "componentType": 5123, "count": 36, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 288, "target": 34962 },
            { "buffer": 0, "byteOffset": 288, "byteLength": 288, "target": 34962 },
            { "buffer": 0, "byteOffset": 576, "byteLength": 72, "target": 34963 },
        ],
        "buffers": [{ "byteLength": buffer.len(), "uri": format!(
            "data:application/octet-stream;base64,{}",
            base64::engine::general_purpose::STANDARD.encode(&buffer)
        ) }],
    }))
}

/// A box about the origin: positions, normals and indices one after the other, and the corners.
fn box_mesh(size: [f64; 3]) -> (Vec<u8>, [[f32; 3]; 2]) {
    let half = size.map(|length| (0.5 * length) as f32);
    let (mut positions, mut normals, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let first = (positions.len() / 3) as u16;
            for (u, v) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                let mut at = [0.0_f32; 3];
                at[axis] = sign * half[axis];
                // Corners go round anticlockwise as seen from outside.
                at[(axis + 1) % 3] = u * sign * half[(axis + 1) % 3];
                at[(axis + 2) % 3] = v * half[(axis + 2) % 3];
                positions.extend(at);
                let mut normal = [0.0_f32; 3];
                normal[axis] = sign;
                normals.extend(normal);
            }
            indices.extend([0, 1, 2, 0, 2, 3].map(|i| first + i));
        }
    }
    let floats = positions.iter().chain(&normals).flat_map(|v: &f32| v.to_le_bytes());
    let buffer = floats.chain(indices.iter().flat_map(|i| i.to_le_bytes())).collect();
    (buffer, [half.map(|h| -h), half])
}
