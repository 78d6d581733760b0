// The right-hand side: what the beam scatters in every cell, and what comes in through the lit face.
// Twin: Forward::right_hand_side in diffusion/src/forward.rs.

@group(1) @binding(1) var<storage, read> source: array<f32>;
@group(1) @binding(2) var<storage, read> irradiance: array<vec4<f32>>; // of the lit face's cells
@group(1) @binding(3) var<storage, read_write> b: array<vec4<f32>>;

fn visit(place: vec3<u32>, cell: u32, i: u32) -> vec4<f32> {
    let column = place.y * level.cells.x + place.x;
    var enters = block.beam * source[cell];
    if place.z == lit_depth(0u) {
        let last = level.cells.z * level.cells.x * level.cells.y;
        enters += block.drive * entrance(face_z[column + select(last, 0u, block.lit_front == 1u)]);
    }
    b[i] = enters * irradiance[column * level.quads + i % level.quads];
    return vec4(0.0);
}

@compute @workgroup_size(64)
fn illuminate(@builtin(global_invocation_id) id: vec3<u32>) {
    walk(id);
}
