// 1 / (absorption + the six conductances) of every cell.
// Twin: Level::new in diffusion/src/cpu/level.rs.

@group(1) @binding(0) var<storage, read_write> inverse_diagonal: array<f32>;

@compute @workgroup_size(64)
fn invert_diagonal(@builtin(global_invocation_id) place: vec3<u32>) {
    if any(place >= level.cells) {
        return;
    }
    let low = faces_below(place);
    let high = faces_above(place);
    let cell = cell_at(place);
    let faces = face_x[low.x] + face_x[high.x] + face_y[low.y] + face_y[high.y]
        + face_z[low.z] + face_z[high.z];
    inverse_diagonal[cell] = 1.0 / (absorption[cell] + faces);
}
