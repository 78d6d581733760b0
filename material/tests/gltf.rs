//! The box of a glTF file: closed, its faces looking outwards, as large as the block.

mod common;

use base64::Engine;
use common::{medium, sample};
use material::{Overwrite, SceneUnit, gltf};

#[test]
fn the_box_is_the_block_and_looks_outwards() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("m.gltf");
    let material = sample(&["Y"]);
    gltf::write(&path, &medium(&material, SceneUnit::Millimetre), Overwrite::Refuse).unwrap();
    let document: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let uri = document["buffers"][0]["uri"].as_str().unwrap();
    let (_, box_mesh) = uri.split_once("base64,").unwrap();
    let bytes = base64::engine::general_purpose::STANDARD.decode(box_mesh).unwrap();
    let (floats, indices) = bytes.split_at(2 * 24 * 12);
    let floats: Vec<f64> =
        floats.as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect();
    let vectors: Vec<[f64; 3]> = floats.as_chunks().0.to_vec();
    let (points, normals) = vectors.split_at(24);
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
    let mut volume = 0.0;
    for triangle in indices.as_chunks::<2>().0.as_chunks::<3>().0 {
        let [a, b, c] = triangle.map(|index| usize::from(u16::from_le_bytes(index)));
        let side =
            |to: usize| -> [f64; 3] { std::array::from_fn(|i| points[to][i] - points[a][i]) };
        let (u, v) = (side(b), side(c));
        let turn: [f64; 3] = std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            u[j] * v[k] - u[k] * v[j]
        });
        // Corners go round anticlockwise as seen from where the normal points to.
        for corner in [a, b, c] {
            assert!(dot(turn, normals[corner]) > 0.0 && dot(points[corner], normals[corner]) > 0.0);
        }
        volume += dot(points[a], turn) / 6.0;
    }
    // 0.5 × 1 × 1 mm, in metres; corners are f32.
    assert!((volume / 0.5e-9 - 1.0).abs() < 1e-6, "{volume}");
}
